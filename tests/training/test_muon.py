"""Muon: orthogonal steps of large weights, Adam's for the rest, and a training that resumes with both."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from sci_lightning.decoder import E2ECNN
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.mask import LearnedStructural
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.errors import BadInput
from sci_lightning.training import learning_rates
from sci_lightning.training.learning_rates import LearningRates
from sci_lightning.training.muon import Muon, is_large, orthogonalised
from sci_lightning.training.system import System
from tests.training.small_training import check_chain, system_and_trainer, train

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.mark.parametrize("shape", [(16, 40), (40, 16)])
def test_a_step_is_nearly_orthogonal(shape: tuple[int, int]) -> None:
    matrix = torch.randn(shape, generator=torch.Generator().manual_seed(0))
    values = torch.linalg.svdvals(orthogonalised(matrix))
    assert values.min() > 0.5 and values.max() < 1.4
    u, _, v = torch.linalg.svd(matrix, full_matrices=False)
    assert torch.nn.functional.cosine_similarity(orthogonalised(matrix).flatten(), (u @ v).flatten(), dim=0) > 0.97


def test_first_and_last_layers_and_biases_are_left_to_adam() -> None:
    large = {name for name, weight in E2ECNN(8).named_parameters() if is_large(weight)}
    assert {"encode.0.layers.0.weight", "latent.2.weight"} <= large and len(large) == 22
    assert not {"first.weight", "last.weight", "latent.2.bias"} & large


def test_small_weights_get_adams_steps() -> None:
    torch.manual_seed(0)
    one, other = torch.nn.Linear(20, 20), torch.nn.Linear(20, 20)
    other.load_state_dict(one.state_dict())
    adam = torch.optim.Adam(one.parameters(), lr=0.1)
    muon = Muon([{"params": [other.bias]}, {"params": [other.weight], "muon": True}], lr=0.1)
    x = torch.rand(5, 20)
    for layer, optimizer in ((one, adam), (other, muon)):
        layer(x).square().sum().backward()
        optimizer.step()
    assert torch.equal(one.bias, other.bias) and not torch.equal(one.weight, other.weight)


def test_decay_keeps_norms_below_one_over_it() -> None:
    """A gradient that always points the same way: without decay the norm grows with every step."""
    norms = []
    for decay in (0.0, 0.5):
        layer = torch.nn.Linear(16, 16, bias=False)
        muon = Muon([{"params": [layer.weight], "muon": True}], lr=0.1, decay=decay)
        for _ in range(100):
            layer.weight.grad = -torch.eye(16)
            muon.step()
        norms.append(float(torch.linalg.matrix_norm(layer.weight.detach(), 2)))
    assert norms[0] > 6 and norms[1] < 1.4 / 0.5  # a step is orthogonal to within 40 %


def test_a_killed_training_with_muon_ends_as_one_that_never_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning_rates, "is_large", lambda weight: weight.ndim == 4)  # the test's decoder is tiny
    options = {"muon_lr": 0.02, "warmup": 0.2}
    whole = train(tmp_path / "whole", **options)
    assert whole is not None and "momentum_buffer" in str(whole["optimizer_states"][0]["state"][2].keys())
    check_chain(tmp_path / "killed", whole, [(3, "before the checkpoint"), (7, "in validation")], **options)
    with pytest.raises(BadInput, match="its optimizer's state"):
        train(tmp_path / "killed")


@pytest.mark.parametrize("warmup", [0.0, 0.5])
def test_learning_rates_rise_to_theirs_and_fall(tmp_path: Path, warmup: float) -> None:
    system, trainer, _ = system_and_trainer(tmp_path, warmup=warmup, max_steps=8, max_epochs=-1)
    system.trainer, rates = trainer, []
    made = system.configure_optimizers()
    schedule = made["lr_scheduler"]["scheduler"]
    for _ in range(9):
        rates.append(schedule.get_last_lr()[0])
        made["optimizer"].step()
        schedule.step()
    assert max(rates) == rates[4 if warmup else 0] == pytest.approx(1e-2)
    assert rates[-1] == pytest.approx(1e-5)
    if warmup:
        assert rates[:5] == pytest.approx([1e-4, 2.5e-3, 5e-3, 7.5e-3, 1e-2])


def test_rates_that_stay_until_the_cooldown() -> None:
    rates = LearningRates(1e-2, 1e-3, None, None, 0.0, warmup=0.1, cooldown=0.2)
    assert [rates.factor(done) for done in (0.05, 0.1, 0.5, 0.8)] == pytest.approx([0.5, 1, 1, 1])
    assert [rates.factor(done) for done in (0.9, 1.0)] == pytest.approx([0.55, 0.1])
    for cooldown in (0.0, 0.95):
        with pytest.raises(BadInput, match=rf"system\.cooldown={cooldown}"):
            LearningRates(1e-2, 1e-3, None, None, 0.0, warmup=0.1, cooldown=cooldown)


def test_a_warmup_that_is_no_part_of_the_run() -> None:
    with pytest.raises(BadInput, match="from 0 to below 1"):
        System(Encoder(LearnedStructural(2, 2, (4, 4)), ClipQuantise()), E2ECNN(2, 4, 1), warmup=1.0)
