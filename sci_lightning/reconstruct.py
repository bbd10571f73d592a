"""``python -m sci_lightning.reconstruct``: decode a snapshot that a camera took."""

from __future__ import annotations

from pathlib import Path

from omegaconf import DictConfig
from rich.progress import Progress

from sci_lightning.command import run
from sci_lightning.console import PlainConsole, styled


def reconstruct(cfg: DictConfig) -> None:
    """Write the reconstructed frames as PNG, an animated GIF and a float32 ``reconstruction.npy`` (N, T, H, W).

    The decoder gets the encoder's effective mask, and the snapshot with those of its effects undone that can be.

    Args:
        cfg: ``conf/reconstruct.yaml``, composed.
    """
    import numpy as np
    import torch

    from sci_lightning.animation import write_frames, write_gif
    from sci_lightning.atomic_file import whole_file
    from sci_lightning.chosen_checkpoint import chosen_checkpoint
    from sci_lightning.chosen_encoder import chosen_camera, chosen_encoder
    from sci_lightning.decoder.iterative import Iterative
    from sci_lightning.device import chosen_device
    from sci_lightning.encoder.mask import Measured
    from sci_lightning.errors import BadInput
    from sci_lightning.snapshot import read_snapshot

    out, console = Path(cfg.out), PlainConsole()
    checkpoint = chosen_checkpoint("reconstruct", cfg)
    decoder = checkpoint.decoder()
    encoder, _ = chosen_encoder(cfg, checkpoint)
    encoder = chosen_camera(cfg, checkpoint) or encoder
    measurement = read_snapshot(
        cfg.measurement, key=cfg.key, full_scale=cfg.full_scale, bit_depth=getattr(encoder.sensor, "bit_depth", 8)
    )
    with torch.no_grad():
        mask = encoder.decoder_mask(encoder.transmittance()) if cfg.mask is None else Measured(cfg.mask)()
    if mask.shape[1:] != measurement.shape[1:]:
        raise BadInput(
            f"{cfg.measurement}: the snapshot is {tuple(measurement.shape[1:])}, the mask {tuple(mask.shape[1:])} "
            "(H, W); give the mask the snapshot was taken with: mask=FILE"
        )
    aperture = encoder.aperture if cfg.aperture is None else cfg.aperture
    if not aperture > 0:
        raise BadInput(f"aperture must be positive, got {aperture}")

    with torch.no_grad():
        linear = encoder.linearise(measurement) / aperture
    device = chosen_device(cfg.device)
    decoder.eval().to(device)
    mask = mask.to(device)
    with torch.no_grad(), Progress(console=console, transient=True) as progress:
        bar = progress.add_task("Decoding", total=len(linear))
        if isinstance(decoder, Iterative):
            decoder.watch = lambda iteration: progress.update(bar, description=f"Decoding: {iteration}")
        videos = []
        for one in linear:
            videos.append(decoder(one[None].to(device), mask).cpu())
            progress.advance(bar)
    video = torch.cat(videos)

    write_frames(video, out / "frames")
    write_gif(video, out / "video.gif", cfg.fps)
    with whole_file(out / "reconstruction.npy") as temporary:
        np.save(temporary, video.numpy())
    n, t, h, w = video.shape
    level = f"mean level {float(measurement.mean()):.3f} of full scale, aperture {aperture:.3g}"
    console.print(f"{n} snapshot(s) of {h} x {w} ({level}) decoded into {t} frames each")
    console.say(styled(out), ": frames/, video.gif, reconstruction.npy")


if __name__ == "__main__":
    run("reconstruct", reconstruct)
