"""``precision=``: what a device multiplies natively decides, networks alone are concerned, the rest keeps every bit."""

from __future__ import annotations

import doctest
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from sci_lightning import full_precision
from sci_lightning.decoder import E2ECNN, GAP, GAPNet
from sci_lightning.decoder.denoiser import WNNM, FFDNet
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.effects import MaskShift, OpticalBlur, VeilingGlare
from sci_lightning.encoder.mask import LearnedStructural
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.errors import BadInput
from sci_lightning.metrics import PSNR, SSIM
from sci_lightning.pipeline import Pipeline
from sci_lightning.runs.checkpoint import Checkpoint
from sci_lightning.runs.precision import describe_precision, multiplies_bfloat16, resolve_precision
from sci_lightning.runs.resume import check_same_run
from sci_lightning.training.run import _with_precision

CPU = torch.device("cpu")


@pytest.fixture(params=[True, False], ids=["native", "lacking"])
def native(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether the processor of the test multiplies bfloat16."""
    monkeypatch.setattr("sci_lightning.runs.precision.multiplies_bfloat16", lambda device: request.param)
    return bool(request.param)


def test_what_names_stand_for(native: bool) -> None:
    assert resolve_precision("auto", CPU) == ("bf16-mixed" if native else "32-true")
    assert resolve_precision("auto", CPU, networks=False) == "32-true"
    assert resolve_precision(32, CPU) == resolve_precision(None, CPU) == "32-true"
    assert resolve_precision("bf16-mixed", CPU) == "bf16-mixed", "Lightning's name is taken where it is emulated"
    for name in (16, "16-mixed"):
        with pytest.raises(BadInput, match=f"precision={name}: .*float16"):
            resolve_precision(name, CPU)
    assert resolve_precision(16, torch.device("cuda")) == "16-mixed"
    if native:
        assert resolve_precision("bf16", CPU) == "bf16-mixed"
    else:
        with pytest.raises(BadInput, match=r"precision=bf16: .*precision=32"):
            resolve_precision("bf16", CPU)


def test_one_line_says_it(native: bool) -> None:
    line = describe_precision(resolve_precision("auto", CPU), CPU)
    if native:
        assert line.startswith("precision: networks in bfloat16") and "precision=32" in line
    else:
        assert line.startswith("precision: float32")


@pytest.mark.parametrize(
    ("capability", "expected"), [("amx_bf16", True), ("avx512_bf16", True), ("bf16", True), ("avx512_f", False)]
)
def test_what_torch_reports_of_the_processor(capability: str, expected: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {capability: True, "avx2": True}, raising=False)
    assert multiplies_bfloat16(CPU) is expected
    assert not multiplies_bfloat16(torch.device("mps"))


def test_camera_and_metrics_keep_every_bit() -> None:
    """Blurs, resampling and SSIM are convolutions, which autocast would round."""
    effects = [MaskShift(dx=0.4), OpticalBlur(sigma=0.8), VeilingGlare(fraction=0.1)]
    encoder = Encoder(LearnedStructural(frames=4, size=(24, 24), bits=2), ClipQuantise(bit_depth=8), effects=effects)
    pipeline = Pipeline(encoder, E2ECNN(4, 4, 1))
    video, estimate = torch.rand(2, 4, 24, 24), torch.rand(2, 4, 24, 24)

    def computed() -> list[torch.Tensor]:
        torch.manual_seed(0)
        recorded = pipeline.record(video)
        scores = [metric(estimate, video) for metric in (PSNR(), SSIM())]
        return [recorded, pipeline.linearise(recorded), pipeline.decoder_mask(), *scores]

    expected = computed()
    with torch.autocast("cpu", torch.bfloat16):
        for now, then in zip(computed(), expected, strict=True):
            assert torch.equal(now, then)


@torch.no_grad()
def test_algorithms_without_networks_keep_every_bit() -> None:
    decoder = GAP(WNNM(), strengths=[0.1], iterations=[2])
    mask = torch.rand(4, 16, 16)
    measurement = (mask * torch.rand(1, 4, 16, 16)).sum(1)
    expected = decoder(measurement, mask)
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(decoder(measurement, mask), expected)


@torch.no_grad()
def test_data_steps_are_exact_around_a_network_in_bfloat16() -> None:
    """After the projection the estimate explains the measurement to the rounding of float32, not of bfloat16."""
    mask = torch.rand(4, 16, 16) + 0.1
    measurement = (mask * torch.rand(1, 4, 16, 16)).sum(1)
    residuals: list[torch.Tensor] = []
    decoder = GAP(FFDNet(8, 3), strengths=[0.1], iterations=[1])
    decoder.denoiser.register_forward_pre_hook(
        lambda module, arguments: residuals.append(decoder.operator(mask)(arguments[0]) - measurement)
    )
    unfolding = GAPNet(4, 2, (4, 6, 8))
    next(unfolding.children()).register_forward_pre_hook(
        lambda module, arguments: residuals.append(unfolding.operator(mask)(arguments[0]) - measurement)
    )
    with torch.autocast("cpu", torch.bfloat16):
        estimates = [decoder(measurement, mask), *unfolding.stages(measurement, mask)]
    assert all(estimate.dtype == torch.float32 for estimate in estimates)
    assert len(residuals) == 2 and all(float(residual.abs().max()) < 1e-5 for residual in residuals)


def test_a_training_goes_on_in_the_precision_that_it_began_with(native: bool) -> None:
    """``auto`` asks for none, so that another machine, or an earlier version of this program, changes nothing."""
    config = {"precision": "auto", "trainer": {"precision": "auto", "accelerator": "cpu"}}
    for earlier in ("32-true", "bf16-mixed"):
        before = {"trainer": {"precision": earlier, "accelerator": "cpu"}}
        assert check_same_run("last.ckpt", before, config) == []
        checkpoint = Checkpoint(Path("last.ckpt"), before, {})
        now, _ = _with_precision(config, checkpoint)
        assert now["trainer"]["precision"] == earlier
        fresh, _ = _with_precision(config, replace(checkpoint, resumable=False))
        assert fresh["trainer"]["precision"] == ("bf16-mixed" if native else "32-true")
    asked = {**config, "trainer": {**config["trainer"], "precision": "32-true"}}
    with pytest.raises(BadInput, match=r"trainer\.precision=bf16-mixed, .*32-true"):
        check_same_run("last.ckpt", before, _with_precision(asked, checkpoint)[0])


def test_full_precision() -> None:
    assert doctest.testmod(full_precision).failed == 0


def test_bad_input(refused: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "none.tiff").touch()
    for name in ("train", "evaluate", "reconstruct", "benchmark"):
        more = [f"measurement={tmp_path}/none.tiff"] if name == "reconstruct" else []
        assert "precision=fp8: expected auto, 32, bf16, 16" in refused(name, "precision=fp8", *more)
    small = ["scale=smoke", "decoder=e2e_cnn", "trainer.accelerator=cpu", "out=run"]
    for words in (("train", *small), ("benchmark", "device=cpu")):
        assert re.search("precision=16: .*float16", refused(*words, "precision=16"))
