from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def shared():
    """Real data beside the checkout, where there is some."""
    folder = Path(__file__).parents[2].parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder}")
    return folder


@pytest.fixture
def noise():
    """Makes uint8 (F, H, W) of noise: every frame and every pixel differs from the others."""

    def make(frames=12, height=40, width=48, seed=0):
        return np.random.default_rng(seed).integers(0, 256, (frames, height, width), dtype=np.uint8)

    return make


@pytest.fixture
def tree(tmp_path, noise):
    """A folder of five clips of 12 to 16 frames."""
    root = tmp_path / "clips"
    root.mkdir()
    for i in range(5):
        np.savez(root / f"clip{i}.npz", frames=noise(12 + i, seed=i))
    return root


@pytest.fixture
def davis(tmp_path, noise):
    """A folder above a miniature of DAVIS 2017: three sequences to train on and two to validate."""
    from PIL import Image

    folder = tmp_path / "data" / "DAVIS"
    (folder / "ImageSets" / "2017").mkdir(parents=True)
    for subset, names in {"train": ["bear", "bus", "car"], "val": ["camel", "goat"]}.items():
        (folder / "ImageSets" / "2017" / f"{subset}.txt").write_text("\n".join(names) + "\n")
        for name in names:
            sequence = folder / "JPEGImages" / "480p" / name
            sequence.mkdir(parents=True)
            for i, frame in enumerate(noise(9)):
                Image.fromarray(frame).convert("RGB").save(sequence / f"{i:05}.jpg")
    return folder.parent
