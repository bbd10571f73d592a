"""``python -m sci_lightning.demo``: a first result in a minute, snapshots and the frames decoded from them."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Interval

from sci_lightning.cli.composition import Composition
from sci_lightning.cli.settings import CommandSettings
from sci_lightning.configuration.bounds import ExistingPath
from sci_lightning.console import PlainConsole, styled

CAMERA = "lsw_sr"
"""The weights that come along of a camera whose mask and decoder were trained together."""


@dataclass(frozen=True)
class DemoSettings(CommandSettings):
    video: ExistingPath | None
    snapshots: Annotated[int, Interval(ge=1, le=16)]


def demo(composition: Composition) -> None:
    """Record a moving scene with the trained camera that comes along, decode it, and draw both side by side."""
    import torch

    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.cli.notebook import load_decoder
    from sci_lightning.data.synthetic import Synthetic
    from sci_lightning.data.video import load_video
    from sci_lightning.figures.animation import write_side_by_side
    from sci_lightning.figures.figure import plot
    from sci_lightning.files.atomic_file import atomic_write
    from sci_lightning.metrics import psnr
    from sci_lightning.weights import load_weights

    cfg, console, out = composition.cfg, PlainConsole(), Path(composition.cfg.out)
    camera = load_weights(CAMERA)
    encoder, decoder = camera.encoder(), camera.decoder()
    if cfg.get("decoder") is not None:
        own = [override for override in composition.overrides if override.startswith("decoder.")]
        decoder = load_decoder(composition.choice("decoder"), own)
    frames, size = encoder.mask.frames, encoder.size
    if cfg.video is None:
        (scene,) = Synthetic(frames, size, scenes_count=1, snapshots_per_scene=cfg.snapshots).scenes()
        video = torch.stack([scene.video[n] for n in range(cfg.snapshots)])
    else:
        video = load_video(cfg.video, frames, size=size, snapshots=cfg.snapshots)
    console.print(f"{len(video)} snapshots of {frames} frames, {size[0]} x {size[1]} pixels, 8 bits; decoding them ..")
    begun = time.perf_counter()
    with torch.no_grad():
        snapshots = encoder(video)
        parts = [decoder(snapshots[n : n + 1], encoder.transmittance()) for n in range(len(video))]
    estimate = torch.cat(parts).clamp(0, 1)
    console.print(
        f"decoded in {time.perf_counter() - begun:.1f} s: {float(psnr(estimate, video).mean()):.1f} dB, "
        f"mean over the frames; {float(psnr(snapshots[:, None].expand_as(video), video).mean()):.1f} dB if every "
        "frame were its snapshot"
    )
    out.mkdir(parents=True, exist_ok=True)
    with atomic_write(out / "demo.png") as temporary:
        plot(snapshots[:1], video[:1], estimate[:1]).savefig(temporary, format="png", dpi=120)
    write_side_by_side(snapshots, estimate, out / "demo.gif")
    console.say(styled(out / "demo.gif"), ", ", styled(out / "demo.png"))
    print_next(
        console,
        invocation("reconstruct", "measurement=SNAPSHOT.tiff", "mask=MASK.mat"),
        invocation("train", "experiment=quickstart"),
    )
