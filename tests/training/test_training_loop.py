"""What a training step does beside the network: nothing that is not needed, and the same numbers as the plain way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch

from sci_lightning.encoder import Encoder
from sci_lightning.encoder.mask import LearnedBinary, LearnedStructural, Mask, RandomStructural
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.errors import TrainingDiverged
from sci_lightning.training.step import seed_step
from sci_lightning.training.system import System
from tests.training.small_training import BATCHES, Small, check_chain, scenes, system_and_trainer, train

pytestmark = pytest.mark.filterwarnings("ignore")

SIZE = (12, 10)
MASKS = [
    LearnedStructural(3, 4, SIZE),
    LearnedStructural(1, 4, SIZE),
    LearnedStructural(3, 4, SIZE, tile=(4, 3)),
    LearnedBinary(4, SIZE, tile=(5, 5)),
    RandomStructural(2, 4, SIZE),
]


@pytest.mark.parametrize("mask", MASKS, ids=str)
def test_a_window_of_the_mask_has_the_values_and_the_gradient_of_the_whole(mask: Mask) -> None:
    encoder, light = Encoder(mask, ClipQuantise()), torch.rand(4, 6, 5)
    window, whole = encoder.transmittance_window(3, 4, 6, 5), encoder.transmittance()[:, 3:9, 4:9]
    assert torch.equal(window, whole)
    for weight in mask.parameters():
        part, full = (torch.autograd.grad((m * light).sum(), weight)[0] for m in (window, whole))
        assert torch.equal(part, full)


def test_a_step_structures_only_the_window_that_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[int, ...]] = []
    from sci_lightning.encoder.mask import learned_structural

    plain = learned_structural.structure
    monkeypatch.setattr(learned_structural, "structure", lambda m, bits: seen.append(m.shape) or plain(m, bits))
    System(Encoder(LearnedStructural(2, 2, (64, 64)), ClipQuantise()), Small()).training_step(torch.rand(1, 2, 8, 8), 0)
    assert seen == [(2, 8, 8)]


def test_each_step_of_each_seed_draws_random_numbers_of_its_own() -> None:
    """A generator of torch on a CPU keeps 32 bits of a seed."""

    def drawn(seed: int, step: int, testing: bool) -> tuple[float, ...]:
        seed_step(seed, step, 0, torch.device("cpu"), testing)
        return tuple(torch.rand(4).tolist())

    steps = [(seed, step, testing) for seed in (0, 1, 2**40) for step in (0, 7) for testing in (False, True)]
    assert len({drawn(*step) for step in steps}) == len(steps)
    assert drawn(*steps[-1]) == drawn(*steps[-1])


def test_numbers_are_logged_in_the_steps_that_ask_for_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    system, trainer, clips = system_and_trainer(tmp_path, max_epochs=4, log_every_n_steps=7)
    logged: list[tuple[str, int]] = []
    plain = System.log

    def log(self: System, name: str, *args: Any, **kwargs: Any) -> None:
        logged.append((name, trainer.fit_loop.total_batch_idx))
        plain(self, name, *args, **kwargs)

    monkeypatch.setattr(System, "log", log)
    trainer.fit(system, clips, scenes())
    steps = {n for n in range(4 * BATCHES) if n % BATCHES in (0, BATCHES - 1) or n % 7 == 6}
    for name in ("train/loss", "train/gradient_norm", "train/lr"):
        assert {step for key, step in logged if key == name} == steps


@pytest.mark.parametrize(("precision", "fused"), [("32-true", False), ("bf16-mixed", True)])
def test_adam_is_fused_where_the_last_bits_do_not_count(tmp_path: Path, precision: Any, fused: bool) -> None:
    system, trainer, clips = system_and_trainer(tmp_path, max_steps=1, precision=precision)
    trainer.fit(system, clips)
    assert trainer.optimizers[0].defaults["fused"] is fused


@pytest.mark.parametrize("algorithm", ["norm", "value"])
def test_gradients_are_clipped_as_torch_clips_them(tmp_path: Path, algorithm: str) -> None:
    system, trainer, clips = system_and_trainer(
        tmp_path, max_steps=1, gradient_clip_val=1e-3, gradient_clip_algorithm=algorithm
    )
    trainer.fit(system, clips)
    gradients = [p.grad for p in system.parameters() if p.grad is not None]
    if algorithm == "norm":
        assert float(torch.nn.utils.get_total_norm(gradients)) == pytest.approx(1e-3, rel=1e-3)
    else:
        assert max(float(g.abs().max()) for g in gradients) == pytest.approx(1e-3)


@pytest.mark.parametrize(("factor", "what"), [(float("nan"), "the loss became nan"), (1e38, "the gradient's norm")])
def test_a_loss_or_gradient_that_is_not_finite_ends_the_training(tmp_path: Path, factor: float, what: str) -> None:
    system, trainer, clips = system_and_trainer(tmp_path)
    plain = system.loss

    def poisoned(stages: Any, video: torch.Tensor) -> torch.Tensor:
        loss = plain(stages, video)
        return loss.detach() * min(factor, 1.0) + (loss - loss.detach()) * factor * 1e10

    system.loss = poisoned  # type: ignore[assignment]
    with pytest.raises(TrainingDiverged, match=rf"{what}.* smaller system\.lr \(it is "):
        trainer.fit(system, clips)


def test_a_killed_training_in_bfloat16_ends_as_one_that_never_was(tmp_path: Path) -> None:
    whole = train(tmp_path / "whole", precision="bf16-mixed")
    assert whole is not None
    check_chain(
        tmp_path / "killed", whole, [(3, "before the checkpoint"), (7, "in validation")], precision="bf16-mixed"
    )
