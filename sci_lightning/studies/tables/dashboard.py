"""Runs side by side in TensorBoard, from their ``metrics.json`` alone: also runs that other machines trained."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.plain_text import file_name
from sci_lightning.studies.tables.run import ScoredRun


def check_dashboard(folder: str | Path) -> None:
    """Check that a dashboard can be written into a folder; beside an older one, TensorBoard would show runs twice.

    Raises:
        BadInput: something is there already.
    """
    folder = Path(folder)
    if folder.exists() and not (folder.is_dir() and next(folder.iterdir(), None) is None):
        raise BadInput(f"{folder} is there already, and would show its runs beside these; give another out=")


def write_dashboard(runs: Sequence[ScoredRun], folder: str | Path) -> None:
    """Write a TensorBoard log (tab "HParams"): every run is a trial, with its settings, scores and mask's score.

    Args:
        runs: in the order of the trials.
        folder: of the log, see :func:`check_dashboard`; every run has a folder in it, named after encoder, bits,
            decoder and seed.
    """
    from torch.utils.tensorboard import SummaryWriter
    from torch.utils.tensorboard.summary import hparams

    taken: Counter[Path] = Counter()
    for run in runs:
        path = Path(folder, _name(run))
        taken[path] += 1
        if taken[path] > 1:  # of another size, or tested behind another encoder
            path = path.with_name(f"{path.name}_{taken[path]}")
        scores = _scores(run)
        with SummaryWriter(str(path)) as writer:
            for summary in hparams(_settings(run), scores):
                writer.file_writer.add_summary(summary)
            for tag, score in scores.items():
                writer.add_scalar(tag, score, run.training_steps or 0)


def _name(run: ScoredRun) -> Path:
    fields = run.fields
    return Path(file_name(f"{fields['encoder']}_{fields['bits']}bit_{fields['decoder']}"), f"seed{run.seed}")


def _settings(run: ScoredRun) -> dict[str, Any]:
    """Return what tells runs apart; TensorBoard's table shows the first five in the order of the alphabet at once."""
    settings = {
        "decoder": run.fields["decoder"],
        "encoder": run.fields["encoder"],
        "encoder_tested": run.fields["test_encoder"],
        "mask_bits": run.fields["bits"],
        "seed": run.seed,
        "setting": str(run.setting),
        "trained_parameters": run.parameters,
        "training_steps": run.training_steps,
    }
    return {key: value for key, value in settings.items() if value is not None}


def _scores(run: ScoredRun) -> dict[str, float]:
    scores = {f"test/{metric}": score for metric, score in run.scores.items()}
    return scores if run.mask_score is None else {**scores, "mask_score": run.mask_score}
