"""What users of Lightning expect: plain loaders, other metrics, a data module, scores, hyper-parameters, loading."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import lightning as L
import pytest
import torch
from torch.utils.data import DataLoader, TensorDataset
from torchmetrics import MeanSquaredError, Metric
from torchmetrics.image import StructuralSimilarityIndexMeasure

from sci_lightning.data import Clips, Scene
from sci_lightning.decoder import E2ECNN
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.mask import LearnedStructural
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.errors import BadInput
from sci_lightning.metrics import PSNR
from sci_lightning.training.callbacks.progress import Progress
from sci_lightning.training.system import System
from sci_lightning.training.training_checkpoint import TrainingCheckpointIO
from sci_lightning.training.video_data import VideoData

pytestmark = pytest.mark.filterwarnings("ignore")
VIDEOS = torch.rand(4, 4, 16, 16, generator=torch.Generator().manual_seed(0))


class Few(Clips):
    def __len__(self) -> int:
        return len(VIDEOS)

    def __getitem__(self, index: int) -> torch.Tensor:
        return VIDEOS[index % len(VIDEOS)]


class Two:
    """A source of two scenes."""

    def clips(self) -> Clips:
        return Few()

    def scenes(self) -> list[Scene]:
        return [Scene("one", VIDEOS[:2]), Scene("other", VIDEOS[2:])]


def system(**settings: Any) -> System:
    torch.manual_seed(0)
    encoder = Encoder(LearnedStructural(bits=2, frames=4, size=(16, 16)), ClipQuantise(bit_depth=8))
    return System(encoder, E2ECNN(4, 4, 1), **settings)


def trainer(folder: Path, epochs: int = 1, plugins: Sequence[Any] = (), checkpoints: bool = False) -> L.Trainer:
    return L.Trainer(
        accelerator="cpu",
        max_epochs=epochs,
        default_root_dir=folder,
        logger=False,
        enable_checkpointing=checkpoints,
        enable_progress_bar=False,
        enable_model_summary=False,
        plugins=list(plugins),
    )


class Plain(torch.utils.data.Dataset[torch.Tensor]):
    def __len__(self) -> int:
        return len(VIDEOS)

    def __getitem__(self, index: int) -> torch.Tensor:
        return VIDEOS[index]


@pytest.mark.parametrize("dataset", [Plain(), TensorDataset(VIDEOS)])
def test_plain_loaders(dataset: Any, tmp_path: Path) -> None:
    loader, ours = DataLoader(dataset, batch_size=2), system()
    fit = trainer(tmp_path)
    fit.fit(ours, loader, loader)
    assert fit.global_step == 2 and float(fit.callback_metrics["val/psnr"]) > 0
    (scores,) = fit.test(ours, loader, verbose=False)
    assert scores["test/psnr"] == pytest.approx(float(fit.callback_metrics["test/psnr"])) and scores["test/ssim"] < 1
    assert scores["test_psnr/all"] == scores["test/psnr"]


def test_batches_that_are_none(tmp_path: Path) -> None:
    pairs = DataLoader(TensorDataset(VIDEOS, torch.zeros(4)))
    with pytest.raises(BadInput, match=r"one tensor of videos \(N, T, H, W\)"):
        trainer(tmp_path).test(system(), pairs, verbose=False)
    with pytest.raises(BadInput, match=r"one tensor of clips \(N, T, h, w\)"):
        trainer(tmp_path).fit(system(), pairs)


def test_a_data_module_and_the_scores_of_every_scene(tmp_path: Path) -> None:
    ours, data = system(metrics={"psnr": PSNR()}), VideoData(Two(), batch_size=2)
    run = trainer(tmp_path)
    run.fit(ours, data)
    (scores,) = run.test(ours, data, verbose=False)
    assert scores.keys() == {"test/psnr", "test_psnr/one", "test_psnr/other"}
    assert scores["test/psnr"] == pytest.approx((scores["test_psnr/one"] + scores["test_psnr/other"]) / 2)
    assert data.hparams == {"batch_size": 2, "workers": 0}


def test_other_metrics_are_means_over_frames(tmp_path: Path) -> None:
    metrics: dict[str, Metric] = {"mse": MeanSquaredError(), "ssim": StructuralSimilarityIndexMeasure(data_range=1.0)}
    ours = system(metrics=metrics)
    (scores,) = trainer(tmp_path).test(ours, DataLoader(Plain(), batch_size=4), verbose=False)
    expected = torch.nn.functional.mse_loss(ours(VIDEOS), VIDEOS)
    assert scores["test/mse"] == pytest.approx(float(expected), rel=1e-5) and "test/ssim" in scores
    assert ours.state_dict().keys() == system().state_dict().keys()  # a metric's weights are not the system's


class Pair(Metric):
    def update(self, *images: torch.Tensor) -> None:
        """Nothing is kept."""

    def compute(self) -> torch.Tensor:
        return torch.zeros(2)


@pytest.mark.parametrize(("metric", "line"), [(5, "metrics.x: an int"), (Pair(), "metrics.x: Pair .* one number")])
def test_metrics_that_are_none(metric: Any, line: str, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=line):
        trainer(tmp_path).test(system(metrics={"x": metric}), DataLoader(Plain()), verbose=False)


def test_loading_honours_settings_and_refuses_others(tmp_path: Path) -> None:
    ours = system(lr=1e-3, loss="rmse")
    assert (ours.hparams["lr"], ours.hparams["loss"]) == (1e-3, "rmse")
    run = trainer(tmp_path, checkpoints=True)
    run.fit(ours, DataLoader(Plain()))
    path = run.checkpoint_callback.best_model_path  # type: ignore[union-attr]
    other = system()
    parts: dict[str, Any] = {"encoder": other.encoder, "decoder": other.decoder}
    loaded = System.load_from_checkpoint(path, **parts, lr=5e-4)
    assert (loaded.hparams["lr"], loaded.rates.lr, loaded.hparams["loss"]) == (5e-4, 5e-4, "rmse")
    assert all(torch.equal(value, loaded.state_dict()[key]) for key, value in ours.state_dict().items())
    with pytest.raises(BadInput, match=r"system\.lrr"):
        System.load_from_checkpoint(path, **parts, lrr=1.0)
    with pytest.raises(BadInput, match="does not fit"):
        System.load_from_checkpoint(path, encoder=other.encoder, decoder=E2ECNN(4, 8, 1))


def test_a_checkpoint_of_ours_is_not_begun_anew_by_a_plain_trainer(tmp_path: Path) -> None:
    ours, data, path = system(), VideoData(Two(), batch_size=2), tmp_path / "last.ckpt"
    run = trainer(tmp_path, plugins=[TrainingCheckpointIO(ours)])
    run.fit(ours, data)
    run.save_checkpoint(path)
    with pytest.raises(BadInput, match="TrainingCheckpointIO"):
        trainer(tmp_path, 2).fit(system(), VideoData(Two(), batch_size=2), ckpt_path=path)
    later = system()
    run = trainer(tmp_path, 2, plugins=[TrainingCheckpointIO(later)])
    run.fit(later, VideoData(Two(), batch_size=2), ckpt_path=path)
    assert run.global_step == 4


def test_the_bar_says_of_what_it_shows_a_part() -> None:
    assert Progress()._in_words(0.99, training=True) == "99% of this step computed"
    assert Progress()._in_words(0.5, training=False) == "50% of this validation snapshot computed"
