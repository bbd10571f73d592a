"""Folders of clips as each source of data reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch


def clips(folder: Path, source: str) -> Path:
    """A tree of clips that the named source can read."""
    from PIL import Image
    from scipy.io import savemat

    folder.mkdir(exist_ok=True)
    frames = (torch.rand(48, 64, 64) * 255).byte().numpy()
    if source in ("sixscenes", "benchmark"):
        for scene in ("kobe", "traffic", "runner", "drop", "crash", "aerial"):
            savemat(folder / f"{scene}_cacti.mat", {"orig": frames.transpose(1, 2, 0)})
    elif source == "davis":
        for split, name in (("train", "bear"), ("val", "camel")):
            sequence = folder / "JPEGImages" / "480p" / name
            sequence.mkdir(parents=True)
            for number, frame in enumerate(frames[:10]):
                Image.fromarray(frame).save(sequence / f"{number:05d}.jpg")
            (folder / "ImageSets" / "2017").mkdir(parents=True, exist_ok=True)
            (folder / "ImageSets" / "2017" / f"{split}.txt").write_text(f"{name}\n")
    else:
        for number in range(3):
            np.savez(folder / f"clip{number}.npz", frames=frames[number : number + 12])
    return folder
