"""``python -m tests.studies.figures.motion_aware_masks VALIDATION``: are motion-aware masks decoded better?

It computes the mean measurement behind every mask of docs/results/mask-ranking.json, on the validation clips on which
the networks there were scored, and how it ranks beside what they reached.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from scipy.stats import spearmanr

from sci_lightning.data import Folder
from tests.conftest import ROOT
from tests.studies.figures.motion_aware import awareness
from tests.studies.mask_ranking import masks

FRAMES, SIDE, SEED = 8, 64, 0


def correlate(validation: Path) -> None:
    """Print the rank correlation of what the mean measurement has and what the networks reached."""
    ranking = json.loads((ROOT / "docs/results/mask-ranking.json").read_text())["rows"]
    reached = {row["mask"].replace(" ", "_"): row["psnr"] for row in ranking}
    size = (SIDE, SIDE)
    scenes = Folder(validation, FRAMES, size, size, SEED, val_root=validation, clips_per_epoch=1).scenes()
    made = masks(FRAMES, SIDE, SEED)
    aware = [awareness(make(), scenes)["frames"] for make in made.values()]
    rank, p_value = spearmanr(aware, [reached[name] for name in made])
    print(f"rank correlation with the PSNR that was reached {rank:.2f} (p = {p_value:.2g})")


if __name__ == "__main__":
    correlate(Path(sys.argv[1]))
