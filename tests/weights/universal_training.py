"""Train the universal network, whose weights come along: ``python -m tests.weights.universal_training OUT SECONDS``.

Worker processes draw snapshots without end, of clips whose licence lets weights be passed on, behind a mask of another
kind every time, and keep GAP-TV's estimates of them, which take longer than a step of the training. One process learns
from all that are there. Interrupted in whatever way, the same line goes on from the last minutes' weights; with more
seconds, a training that has ended goes on as well. ``OUT/universal.safetensors`` is what
``sci_lightning/weights/`` holds.
"""

from __future__ import annotations

import itertools
import json
import multiprocessing
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn import functional as F

from sci_lightning.cli.composition import compose, plain
from sci_lightning.configuration.build import build
from sci_lightning.encoder.mask import moved_pattern
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.training.muon import Muon, is_large
from tests.conftest import SHARED
from tests.weights.ship import ship

CLIPS = (
    *("bigbuckbunny", "davis-blackswan", "davis-bmx-trees", "davis-car-roundabout", "davis-car-shadow"),
    *("davis-car-turn", "davis-cows", "davis-dog", "davis-elephant", "davis-flamingo", "davis-goat"),
    *("davis-horsejump-high", "davis-mallard-water", "davis-paragliding-launch", "davis-tennis"),
)
"""Of ``train/``; all of ``train_more/`` may be used."""
SIDE, GROUP, GROUPS = 128, 4, 8
"""Pixels of a crop; snapshots behind one mask; masks of one file."""
FRAMES, FRAMES_SHARES = (8, 4, 6, 10, 12, 16), (0.7, 0.05, 0.05, 0.08, 0.04, 0.08)
KINDS = ("binary", "density", "gray", "structural", "gray structural", "shifting")
KINDS_SHARES = (0.4, 0.15, 0.1, 0.1, 0.1, 0.15)
RATE, SMALL_RATE = 0.005, 0.0005
"""Learning rates: of Muon for large weights, and of Adam for the others."""
DECAY = 0.3
"""Part of the time in which the learning rates fall to 0."""
Snapshots = dict[str, torch.Tensor]


def clips(folder: Path = SHARED / "data") -> list[torch.Tensor]:
    """Return the training clips ``(frames, H, W)``, uint8, whose licence lets weights be passed on."""
    files = [*(folder / "train" / f"{name}.npz" for name in CLIPS), *sorted((folder / "train_more").glob("*.npz"))]
    return [torch.from_numpy(np.load(file)["frames"]) for file in files]


def draw_mask(frames: int, rng: np.random.Generator) -> torch.Tensor:
    """Return a mask ``(T, H, W)`` in steps of 1/255; a third is blurred a little, as a relay does."""
    kind, noise = rng.choice(KINDS, p=KINDS_SHARES), torch.rand(frames, SIDE, SIDE)
    if kind == "gray":
        mask = noise
    elif kind == "structural":
        mask = torch.zeros_like(noise).scatter_(0, noise.argmax(0, keepdim=True), 1.0)
    elif kind == "gray structural":
        shares = noise ** (1 + 4 * rng.random())
        mask = shares / shares.sum(0)
    elif kind == "shifting":
        pattern = (torch.rand(SIDE + frames, SIDE + frames) < 0.5).float()
        mask = moved_pattern(pattern, frames, (SIDE, SIDE), ((0, 1), (0, -1), (1, 0))[rng.integers(3)])
    else:
        mask = (noise < (0.5 if kind == "binary" else 0.3 + 0.4 * rng.random())).float()
    if rng.random() < 1 / 3:
        part, padded = 0.5 * rng.random(), F.pad(mask[None], (1, 1, 1, 1), mode="replicate")
        mask = (1 - part) * mask + part * F.avg_pool2d(padded, 3, stride=1)[0]
    return (mask * 255).round() / 255


def draw_video(sources: list[torch.Tensor], frames: int, rng: np.random.Generator) -> torch.Tensor:
    """Return a clip ``(T, H, W)``, gray levels: as it is or reduced, every frame or every other, at times darker."""
    while True:
        clip, step = sources[rng.integers(len(sources))], int(rng.choice([1, 1, 1, 2]))
        side = min(int(SIDE * rng.choice([1.0, rng.uniform(1, 1.9)])), *clip.shape[1:])
        if (span := (frames - 1) * step + 1) > len(clip):
            continue
        first, top, left = (int(rng.integers(n - m + 1)) for n, m in zip(clip.shape, (span, side, side), strict=True))
        video = clip[first : first + span : step, top : top + side, left : left + side].float()
        if side != SIDE:
            video = F.interpolate(video[None], (SIDE, SIDE), mode="bilinear", antialias=True)[0]
        video = (video.clamp(0, 255) * (rng.uniform(0.4, 1) if rng.random() < 0.3 else 1)).round()
        if video[0].std() > 3:
            return video


def draw_snapshots(sources: list[torch.Tensor], rng: np.random.Generator) -> Snapshots:
    """Return snapshots with the estimates that the network begins with; half have noise, some an offset."""
    start = build(plain(compose("train", ["decoder=gap_tv"]).cfg.decoder), "decoder")
    frames = int(rng.choice(FRAMES, p=FRAMES_SHARES))
    kept: dict[str, list[torch.Tensor]] = {"video": [], "mask": [], "measurement": [], "estimate": []}
    for _ in range(GROUPS):
        mask = draw_mask(frames, rng)
        video = torch.stack([draw_video(sources, frames, rng) for _ in range(GROUP)])
        measurement = (mask * video / 255).sum(1)
        level = measurement.mean()
        if rng.random() < 0.5:
            measurement += 2 * 10 ** rng.uniform(-3.2, -1.7) * level * torch.randn_like(measurement)
        else:
            measurement = (measurement * 512).round() / 512
        if rng.random() < 0.2:
            measurement += rng.uniform(0, 0.02) * level  # of a black level that was not taken off
        with torch.no_grad():
            estimate = start(measurement, mask)
        values = (video.byte(), (mask * 255).round().byte()[None], measurement, estimate.half())
        for part, value in zip(kept.values(), values, strict=True):
            part.append(value)
    return {key: torch.cat(values) for key, values in kept.items()}


def keep_drawing(folder: Path, worker: int) -> None:
    """Write files of snapshots until the process ends."""
    torch.set_num_threads(1)
    os.nice(5)
    sources = clips()
    for number in itertools.count():
        path = folder / f"{worker:02d}_{number:05d}.pt"
        if not path.exists():
            torch.manual_seed(1000 * number + worker)
            drawn = draw_snapshots(sources, np.random.default_rng([worker, number]))
            with atomic_write(path) as temporary:
                torch.save(drawn, temporary)


def batch(data: list[Snapshots], groups: int, rng: np.random.Generator) -> list[torch.Tensor]:
    """Return measurement, mask, estimate and video of some snapshots, turned and mirrored in space and time."""
    file = data[rng.integers(len(data))]
    parts: list[list[torch.Tensor]] = []
    for _ in range(groups):
        group, turns, mirror, back = (int(rng.integers(n)) for n in (GROUPS, 4, 2, 2))
        first = GROUP * group + 2 * int(rng.integers(2))
        two = slice(first, first + 2)
        mask = file["mask"][group : group + 1].expand(2, -1, -1, -1).float() / 255
        images = [file["measurement"][two, None], mask, file["estimate"][two].float(), file["video"][two].float() / 255]
        images = [torch.rot90(image, turns, (-2, -1)) for image in images]
        images = [image.flip(-1) if mirror else image for image in images]
        parts.append([image.flip(1) if back else image for image in images])
    measurement, *others = (torch.cat(part) for part in zip(*parts, strict=True))
    return [measurement[:, 0], *others]


def psnr(estimate: torch.Tensor, video: torch.Tensor) -> float:
    return float((-10 * (estimate.clamp(0, 1) - video).square().mean((1, 2, 3)).log10()).mean())


def train(out: Path, seconds: float, workers: int, groups: int = 2) -> None:
    """Train for so many seconds beyond those of earlier calls, and write the weights."""
    folder, state_file = out / "snapshots", out / "state.pt"
    folder.mkdir(parents=True, exist_ok=True)
    drawing = [multiprocessing.Process(target=keep_drawing, args=(folder, n), daemon=True) for n in range(workers)]
    for process in drawing:
        process.start()
    words = ["encoder=rbw_osr", "encoder.mask.tile=[8,8]", "decoder=universal", "frames=8", "size=[256,256]", "seed=0"]
    config: dict[str, Any] = {
        **{key: plain(compose("train", words).cfg)[key] for key in ("encoder", "decoder", "frames", "size", "seed")},
        "crop": [SIDE, SIDE],
        "names": {"encoder": "rbw_osr", "decoder": "universal"},
    }
    encoder = build(config["encoder"], "encoder").state_dict()
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    torch.manual_seed(0)
    decoder = build(config["decoder"], "decoder").to(device, memory_format=torch.channels_last)
    steps, earlier = 0, 0.0
    if state_file.is_file():
        state = torch.load(state_file, weights_only=True)
        decoder.load_state_dict(state["decoder"])
        steps, earlier = state["steps"], state["seconds"]
    large = [weight for weight in decoder.parameters() if is_large(weight)]
    small = [weight for weight in decoder.parameters() if not is_large(weight)]
    optimizer = Muon([{"params": large, "muon": True, "lr": RATE}, {"params": small, "lr": SMALL_RATE}], lr=RATE)
    rng, data, gains, begin, said = np.random.default_rng(steps), {}, [], time.monotonic(), 0.0
    while (passed := time.monotonic() - begin) < seconds:
        if not data or passed - said > 60:
            data |= {path: torch.load(path) for path in folder.glob("*.pt") if path not in data}
        if not data:
            time.sleep(1)
            continue
        factor = min(1.0, (len(gains) + 1) / 50, (seconds - passed) / (DECAY * seconds))
        for group, rate in zip(optimizer.param_groups, (RATE, SMALL_RATE), strict=True):
            group["lr"] = factor * rate
        measurement, mask, estimate, video = (x.to(device) for x in batch(list(data.values()), groups, rng))
        with torch.autocast(device.type, torch.bfloat16):
            stages = decoder.corrected(measurement, mask, estimate)
        errors = [((stage - video).square().mean((1, 2, 3)) + 1e-6).sqrt().mean() for stage in stages]
        optimizer.zero_grad()
        (errors[-1] + 0.2 * sum(errors[:-1])).backward()
        optimizer.step()
        gains.append(psnr(stages[-1].detach(), video) - psnr(estimate, video))
        steps += 1
        if passed - said > 60:
            said = passed
            _keep(out, config, decoder, encoder, steps, earlier + passed)
            gain = sum(gains[-500:]) / len(gains[-500:])
            print(f"{passed:.0f} s, step {steps}, {len(data) * GROUP * GROUPS} snapshots: {gain:+.3f} dB", flush=True)
    _keep(out, config, decoder, encoder, steps, earlier + seconds)
    for process in drawing:
        process.terminate()


def _keep(out: Path, config: dict[str, Any], decoder: Any, encoder: Snapshots, steps: int, seconds: float) -> None:
    """Write the weights, those that come along in float16, and how far the training is."""
    state = {key: value.detach().cpu() for key, value in decoder.state_dict().items()}
    with atomic_write(out / "state.pt") as temporary:
        torch.save({"decoder": state, "steps": steps, "seconds": seconds}, temporary)
    both = {**{f"encoder.{k}": v for k, v in encoder.items()}, **{f"decoder.{k}": v for k, v in state.items()}}
    ship(out / "universal.safetensors", config, both, any_mask=True)
    with atomic_write(out / "training.json") as temporary:
        temporary.write_text(json.dumps({"steps": steps, "seconds": round(seconds)}))


if __name__ == "__main__":
    train(Path(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 1)
