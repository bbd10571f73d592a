"""``python -m sci_lightning.tables.mask_ranking``: scores of many masks, and what a network reaches behind them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sci_lightning.cli.composition import Composition, plain
from sci_lightning.cli.settings import StudySettings
from sci_lightning.configuration.bounds import Depth, ExistingPath, Frames, Pixels, Positive, Seed, Width
from sci_lightning.console import PlainConsole

FILE = "mask_ranking.json"


@dataclass(frozen=True)
class MaskRankingSettings(StudySettings):
    root: ExistingPath
    val_root: ExistingPath
    frames: Frames
    side: Pixels
    channels: Width
    blocks: Depth
    first_estimate: Literal["published", "linear"]
    seconds: Positive
    seed: Seed


def mask_ranking(composition: Composition) -> None:
    """Train behind every mask that has no record yet, and write ``mask_ranking.json``.

    Raises:
        MachineFailure: masks failed; the others have their records.
    """
    from scipy.stats import spearmanr

    from sci_lightning.files.json_file import write_json
    from sci_lightning.studies import mask_ranking as study
    from sci_lightning.studies.engine import FailedCase, Records, run_cases

    cfg, console, out = composition.cfg, PlainConsole(), Path(composition.cfg.out)
    settings, records = plain(cfg), Records(out / "cases", study.RankedMask)
    cases = [study.MaskCase(name, settings) for name in study.masks(cfg.frames, cfg.side, cfg.seed)]
    missing = records.missing(cases, cfg.job)
    for ended in run_cases(study.rank, missing, records, cfg.workers, cfg.threads, cfg.job):
        if not isinstance(ended, FailedCase):
            console.print(f"{ended.mask}: score {ended.score_dB:.2f} dB, trained {ended.psnr_dB:.2f} dB")
    if not (rows := records.all_of(cases, console.print)):
        return
    rank, p_value = spearmanr([row.score_dB for row in rows], [row.psnr_dB for row in rows])
    content = {"rank_correlation": float(rank), "p_value": float(p_value), "settings": cases[0].describe()["settings"]}
    shown = [row.model_dump(include={"mask", "score_dB", "psnr_dB"}) for row in rows]
    write_json({**content, "masks": shown}, out / FILE)
    console.print(f"rank correlation of {len(rows)} masks: {rank:.2f} (p = {p_value:.2g}); {out / FILE}")
