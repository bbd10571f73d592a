"""``python -m sci_lightning.reconstruct``: decode a snapshot that a camera took."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Interval
from rich.progress import Progress

from sci_lightning.cli.composition import Composition, group_members, plain
from sci_lightning.cli.settings import Aperture, CommandSettings, Kernels, Name, NamedOrPath, Offset, Precision
from sci_lightning.configuration.bounds import (
    BayerPattern,
    ExistingPath,
    Frames,
    NonNegative,
    Positive,
    Seed,
    Size,
    Step,
)
from sci_lightning.console import PlainConsole, styled, warn

SETTINGS = (
    *("mask", "key", "mask_key", "mask_step", "mask_origin", "mask_slots", "mask_dark", "mask_white", "full_scale"),
    *("bayer", "aperture", "tile", "device", "precision", "out", "fps"),
)
"""What the library function takes as the user says it."""

LINE_SECONDS = 15.0
"""Where the output is no terminal, a line says at least that often how far it is."""


@dataclass(frozen=True)
class ReconstructSettings(CommandSettings):
    ckpt_path: ExistingPath | None
    weights: NamedOrPath | None
    trusted: Sequence[Name]
    measurement: ExistingPath
    key: Name | None
    raw_format: Name | None
    raw_size: Size | None
    bayer: BayerPattern | None
    mask: NamedOrPath | None
    mask_key: Name | None
    mask_dark: NonNegative | None
    mask_white: Positive | None
    mask_step: Step | None
    mask_origin: Offset | None
    mask_slots: Frames | None
    full_scale: Positive | None
    aperture: Aperture | None
    frames: Frames | None
    size: Size | None
    seed: Seed | None
    fps: Annotated[float, Interval(ge=0.1, le=50)]
    tile: Any
    device: Name
    precision: Precision
    kernels: Kernels


def reconstruct(composition: Composition) -> None:
    """Write the reconstructed frames as PNG, animations, an overview and ``reconstruction.npy`` (N, T, H, W), float32.

    Args:
        composition: of ``conf/reconstruct.yaml``.
    """
    from omegaconf import OmegaConf

    from sci_lightning.cli.encoder_and_decoder import resolve_camera, resolve_checkpoint, resolve_encoder
    from sci_lightning.cli.next_command import browser, print_next
    from sci_lightning.decoder.layers import kernels
    from sci_lightning.errors import BadInput
    from sci_lightning.files.array_file import array_names
    from sci_lightning.files.mask_file import MASK_FILES
    from sci_lightning.files.packed_file import raw_layout
    from sci_lightning.runs.reconstruction import FILES
    from sci_lightning.runs.reconstruction import reconstruct as decode_snapshots
    from sci_lightning.weights import ANY_MASK, BEST

    cfg = composition.cfg
    out, console, frames = Path(cfg.out), PlainConsole(), cfg.frames
    if cfg.get("decoder") is None and cfg.ckpt_path is None and cfg.weights is None:
        cfg.weights = BEST
        console.print(f"weights={BEST}: come along and decode behind any mask; decoder= or ckpt_path= choose another")
    checkpoint = resolve_checkpoint("reconstruct", composition)
    mask_of_training = (cfg.ckpt_path or cfg.weights) and checkpoint.config["names"]["encoder"] != ANY_MASK
    if not mask_of_training and cfg.mask is None and not _mask_is_known(composition):
        if not {"mask", "mask_bayer"} & array_names(cfg.measurement):
            raise BadInput(
                f"no snapshot can be decoded without the mask that it was taken with: give mask=FILE ({MASK_FILES}), "
                "encoder=FOUND/encoder.yaml or ckpt_path=RUN/checkpoints/last.ckpt; docs/how-to/reconstruct.md, 'I "
                "have a snapshot without a mask', says how to record one"
            )
        cfg.mask = cfg.measurement
    decoder = checkpoint.decoder()
    kernels.use(decoder, cfg.kernels)
    encoder, _ = resolve_encoder(composition, checkpoint)
    encoder = resolve_camera(composition, checkpoint) or encoder
    settings = plain(OmegaConf.masked_copy(cfg, list(SETTINGS)))
    with Progress(console=console, transient=True) as progress:
        bar, said = progress.add_task("Decoding", total=1), time.monotonic()

        def watch(done: float, state: str) -> None:
            nonlocal said
            if not console.is_terminal and time.monotonic() - said > LINE_SECONDS:
                said = time.monotonic()
                share = f", {done:.0%}" if done else ""  # of several snapshots, or of tiles
                console.print(f"decoding{share}: {state}")
            progress.update(bar, completed=done, description=f"Decoding: {state}")

        result = decode_snapshots(
            cfg.measurement,
            decoder,
            encoder,
            frames=frames if cfg.mask is not None else None,
            raw=raw_layout(cfg.raw_format, cfg.raw_size),
            say=console.print,
            warn=warn,
            watch=watch,
            **settings,
        )
    n, t, h, w = result.video.shape[:4]
    level = f"mean level {float(result.measurement.mean()):.3f} of full scale"
    console.print(f"{n} snapshot(s) of {h} x {w} ({level}) decoded into {t} frames each")
    written = [name for name in ("frames", *FILES, "reconstruction.npy") if (out / name).exists()]
    console.say(styled(out), ": ", ", ".join(written))
    print_next(console, browser(out / "video.gif"))


def _mask_is_known(composition: Composition) -> bool:
    """Return whether the decoder's encoder reads its mask from a file, or is itself described by a file."""
    cfg = composition.cfg
    group, settings = ("encoder@camera", cfg.get("camera")) if cfg.get("camera") else ("encoder", cfg.get("encoder"))
    if not settings or "mask" not in settings:
        return False
    return composition.choice(group) not in group_members("encoder") or settings.mask.get("file") is not None
