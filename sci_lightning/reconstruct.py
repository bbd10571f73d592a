"""``python -m sci_lightning.reconstruct``: decode a snapshot that a camera took."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rich.progress import Progress

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, group_members
from sci_lightning.cli.console import PlainConsole, styled, warn

if TYPE_CHECKING:
    import numpy as np

GIVE_MASK = "give the mask that the snapshot was taken with: mask=FILE"


def reconstruct(composition: Composition) -> None:
    """Write the reconstructed frames as PNG, an animated GIF and a float32 ``reconstruction.npy`` (N, T, H, W).

    The decoder gets the encoder's effective mask, and the snapshot with those of its effects undone that can be.

    Args:
        composition: of ``conf/reconstruct.yaml``.
    """
    import numpy as np
    import torch

    from sci_lightning.cli.encoder_and_decoder import resolve_camera, resolve_checkpoint, resolve_encoder
    from sci_lightning.cli.next_command import browser, print_next
    from sci_lightning.decoder import kernels
    from sci_lightning.decoder.complexity import count_parameters
    from sci_lightning.decoder.iterative import Iterative
    from sci_lightning.encoder.mask.measured import read_mask
    from sci_lightning.errors import BadInput
    from sci_lightning.files.atomic_file import atomic_write
    from sci_lightning.files.mask_file import doubtful_axes
    from sci_lightning.files.npy_file import write_npy
    from sci_lightning.files.packed_file import raw_layout
    from sci_lightning.imaging.animation import write_frames, write_gif
    from sci_lightning.imaging.mask_check import mask_warning
    from sci_lightning.imaging.pipeline import Pipeline
    from sci_lightning.imaging.snapshot import read_snapshot
    from sci_lightning.imaging.tile_choice import TileChoice
    from sci_lightning.runs.device import resolve_device
    from sci_lightning.runs.precision import describe_precision, mixed_precision, resolve_precision

    cfg = composition.cfg
    kernels.use(cfg.kernels)
    out, console, frames = Path(cfg.out), PlainConsole(), cfg.frames
    checkpoint = resolve_checkpoint("reconstruct", composition)
    if cfg.ckpt_path is None and cfg.mask is None and not _mask_is_known(composition):
        raise BadInput(
            "nothing says which mask the snapshot was taken with, and a random one would decode noise: give mask=FILE "
            "(MAT, NPY, H5), encoder=FOUND/encoder.yaml or ckpt_path=RUN/checkpoints/last.ckpt"
        )
    decoder = checkpoint.decoder()
    device = resolve_device(cfg.device)
    networks = count_parameters(decoder) > 0
    precision = resolve_precision(cfg.precision, device, networks)
    encoder, _ = resolve_encoder(composition, checkpoint)
    encoder = resolve_camera(composition, checkpoint) or encoder
    bit_depth = getattr(encoder.sensor, "bit_depth", None)
    snapshot = read_snapshot(
        cfg.measurement,
        key=cfg.key,
        full_scale=cfg.full_scale,
        bit_depth=8 if bit_depth is None else bit_depth,
        raw=raw_layout(cfg.raw_format, cfg.raw_size),
    )
    measurement = snapshot.measurement
    pipeline = Pipeline(encoder, decoder.eval())
    with torch.no_grad():
        mask = (
            pipeline.decoder_mask()
            if cfg.mask is None
            else read_mask(
                cfg.mask,
                cfg.mask_key,
                "mask_key",
                field=measurement.shape[1:],
                frames=frames,
                dark=cfg.mask_dark,
                white=cfg.mask_white,
            )
        )
    named = f"mask={cfg.mask}" if cfg.mask else "the encoder's mask"
    if not mask.any():
        raise BadInput(f"{named} is dark: every value is 0; {GIVE_MASK}")
    if cfg.mask is not None and frames is not None and frames != len(mask):
        raise BadInput(
            f"frames={frames}, but {named} has {len(mask)} slots: leave frames= out, or give the snapshot's own mask"
        )
    if mask.shape[1:] != measurement.shape[1:]:
        raise BadInput(
            f"{cfg.measurement}: the snapshot is {tuple(measurement.shape[1:])}, the mask {tuple(mask.shape[1:])} "
            f"(H, W); {doubtful_axes(mask.shape, measurement.shape[1:]) or GIVE_MASK}"
        )
    aperture = encoder.aperture if cfg.aperture is None else cfg.aperture
    if not aperture > 0:
        raise BadInput(f"aperture must be positive, got {aperture}")

    pipeline.to(device)
    mask = mask.to(device)
    n, (t, h, w) = len(measurement), mask.shape
    progress = Progress(console=console, transient=True)
    bar = progress.add_task("Decoding", total=n)

    def show(state: object) -> None:
        progress.update(bar, description=f"Decoding: {state}")

    watch = None if isinstance(decoder, Iterative) else lambda tile, of: show(f"tile {tile} of {of}")
    if isinstance(decoder, Iterative):
        decoder.watch = show
    choice = TileChoice(cfg.tile, say=console.print, watch=watch)
    with (
        torch.no_grad(),
        mixed_precision(precision, device),
    ):  # what cannot be decoded is refused before anything else takes its time
        choice.tiling(decoder, measurement[:1].to(device), mask)
    with torch.no_grad():
        linear = pipeline.linearise(measurement.to(device), aperture).cpu()
    brightest = max(1.0, aperture * float(mask.sum(0).max())) if bit_depth is None else 1.0
    for line in (snapshot.doubt(brightest), mask_warning(linear * aperture, mask.cpu())):
        if line:
            warn(line if line.startswith(str(snapshot.path)) else f"{snapshot.path}: {line}")
    if networks:
        console.say(describe_precision(precision, device))
    with torch.no_grad(), mixed_precision(precision, device), progress:

        def decoded() -> Iterator[np.ndarray]:
            for one in linear:
                yield pipeline.decode(one[None].to(device), mask, choice)[0].float().cpu().numpy()
                progress.advance(bar)

        with atomic_write(out / "reconstruction.npy") as temporary:
            write_npy(temporary, (n, t, h, w), decoded())
    video = np.load(out / "reconstruction.npy", mmap_mode="r")
    write_frames(video, out / "frames")
    write_gif(video, out / "video.gif", cfg.fps)
    level = f"mean level {float(measurement.mean()):.3f} of full scale, aperture {aperture:.3g}"
    console.print(f"{n} snapshot(s) of {h} x {w} ({level}) decoded into {t} frames each")
    console.say(styled(out), ": frames/, video.gif, reconstruction.npy")
    print_next(console, browser(out / "video.gif"))


def _mask_is_known(composition: Composition) -> bool:
    """Return whether the decoder's encoder reads its mask from a file, or is itself described by a file."""
    cfg = composition.cfg
    place, settings = ("encoder@camera", cfg.get("camera")) if cfg.get("camera") else ("encoder", cfg.get("encoder"))
    if not settings or "mask" not in settings:
        return False
    return composition.choice(place) not in group_members("encoder") or settings.mask.get("file") is not None


if __name__ == "__main__":
    run("reconstruct", reconstruct)
