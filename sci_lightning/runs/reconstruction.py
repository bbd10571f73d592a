"""Reconstruct snapshots that a camera took: read, check, linearise, decode, and write what can be looked at."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sci_lightning.captures.light_scale import bright_end, doubtful_brightness, resolve_aperture
from sci_lightning.captures.mask_check import mask_warning
from sci_lightning.captures.mask_fit import mask_of_snapshots
from sci_lightning.captures.snapshots import read_snapshot
from sci_lightning.configuration.bounds import CHANNELS
from sci_lightning.data.video_array import read_video_array
from sci_lightning.decoder import Decoder
from sci_lightning.decoder.complexity import count_parameters
from sci_lightning.decoder.tiling.tile_choice import TileChoice
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.sensor import Ideal
from sci_lightning.encoder.sensor.bayer import check_bayer, demosaiced, demosaicing, sub_lattices
from sci_lightning.errors import BadInput, InputWarning
from sci_lightning.figures.animation import write_frames, write_gif, write_mp4, write_overview
from sci_lightning.files.array_file import array_names
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.mask_file import doubtful_axes
from sci_lightning.files.memory_bound import check_memory
from sci_lightning.files.npy_file import write_npy
from sci_lightning.files.packed_file import RawLayout
from sci_lightning.files.tiff_file import BAYER
from sci_lightning.measurement import Measurement, linear_with_mask
from sci_lightning.metrics import PSNR, SSIM
from sci_lightning.metrics.colour import in_colour
from sci_lightning.pipeline import Pipeline
from sci_lightning.runs.device import resolve_device
from sci_lightning.runs.precision import describe_precision, mixed_precision, resolve_precision
from sci_lightning.runs.results import number

GIVE_MASK = "give the mask that the snapshot was taken with: mask=FILE"
FILES = ("video.gif", "video.mp4", "overview.png")
"""What is written beside the frames."""
SEEN = (0.6, 1.2)
"""Bright ends of a video that can be looked at as it is; others are scaled in pictures."""


@dataclass(frozen=True)
class Reconstruction:
    """What a decoder made of snapshots.

    Attributes:
        video: float32 ``(N, T, H, W)``, in colour ``(N, T, H, W, 3)``, white is 1; read from ``reconstruction.npy`` as
            needed where that was written.
        measurement: ``(N, H, W)``, fractions of full scale.
        mask: ``(T, H, W)``, as the decoder got it.
        full_scale: the number in the file that is 1.0 in ``measurement``.
        aperture: light scale: ``measurement`` is near the aperture times the sum over time of mask times frame;
            ``(N,)`` where every snapshot has its own.
        warnings: what speaks against mask, numbers or result, a line each; empty if nothing does.
        white: the value of ``video`` that pictures show as white.
        scores: in colour, PSNR in dB and SSIM of red, green and blue, where the file has the frames as well.
    """

    video: np.ndarray
    measurement: torch.Tensor
    mask: torch.Tensor
    full_scale: float
    aperture: float | torch.Tensor
    warnings: tuple[str, ...] = ()
    white: float = 1.0
    scores: dict[str, float] = field(default_factory=dict)

    def save(self, folder: str | Path, fps: float = 8.0) -> list[str]:
        """Write ``frames/`` (PNG), ``video.gif``, ``video.mp4`` and ``overview.png``; return what to know about them.

        The animations and the overview are of bounded size. Without PyAV there is no ``video.mp4``.

        Args:
            folder: is made if it is not there.
            fps: frames per second of the animations.
        """
        folder = Path(folder)
        write_frames(self.video, folder / "frames", self.white)
        smaller = write_gif(self.video, folder / "video.gif", fps, self.white)
        has_mp4 = write_mp4(self.video, folder / "video.mp4", fps, self.white)
        write_overview(self.measurement, self.video, folder / "overview.png", self.white)
        notes = [f"video.gif shows {smaller}: frames/ has all"] if smaller else []
        if not has_mp4:
            (folder / "video.mp4").unlink(missing_ok=True)  # of an earlier video
            notes.append("no video.mp4: PyAV is not installed (pip install 'sci-lightning[video]')")
        if self.white != 1:
            notes.append(f"pictures are scaled to be seen: their white is {self.white:.3g}; reconstruction.npy is not")
        return notes


def reconstruct(
    measurement: str | Path | np.ndarray | torch.Tensor,
    decoder: Decoder,
    encoder: Encoder | None = None,
    *,
    mask: str | Path | None = None,
    key: str | None = None,
    mask_key: str | None = None,
    mask_step: Sequence[float] | None = None,
    mask_origin: Sequence[int] | None = None,
    mask_slots: int | None = None,
    mask_dark: float | None = None,
    mask_white: float | None = None,
    raw: RawLayout | None = None,
    bayer: str | None = None,
    full_scale: float | None = None,
    aperture: float | str | torch.Tensor | None = None,
    tile: str | Sequence[int] = "auto",
    device: str = "auto",
    precision: str | int = "auto",
    out: str | Path | None = None,
    fps: float = 8.0,
    frames: int | None = None,
    say: Callable[[str], object] = print,
    warn: Callable[[str], object] | None = None,
    watch: Callable[[float, str], object] | None = None,
) -> Reconstruction:
    """Decode snapshots that a camera took, as the command ``reconstruct`` does.

    The decoder gets the encoder's effective mask, and the snapshots with those of its effects undone that can be.

    >>> import numpy as np, torch
    >>> import sci_lightning as sci
    >>> mask = sci.masks.RandomBinary(frames=4, size=(32, 32))
    >>> np.save("snapshot.npy", (200 * mask().mean(0)).round().byte().numpy())  # what a camera of 8 bits wrote
    >>> np.save("mask.npy", mask().numpy())
    >>> decoder = sci.load_decoder("gap_tv", ["decoder.iterations=[4]"])
    >>> result = sci.reconstruct("snapshot.npy", decoder, mask="mask.npy", say=lambda line: None)
    >>> result.video.shape, result.full_scale, round(result.aperture, 1)
    ((1, 4, 32, 32), 255.0, 0.5)

    Args:
        measurement: a file (TIFF, PNG, NPY, MAT, HDF5), or the numbers themselves, ``(H, W)`` or ``(N, H, W)``; a
            :class:`.Measurement` says its full scale and aperture by itself.
        decoder: as of :func:`sci_lightning.load_decoder` or of a checkpoint.
        encoder: that took the snapshots, as of a checkpoint; None for an ideal one with the mask of ``mask``.
        mask: file of the mask, which takes the place of the encoder's.
        key, mask_key: names of the arrays in MAT or HDF5 files.
        mask_step, mask_origin, mask_slots: see :func:`~sci_lightning.captures.mask_fit.mask_of_snapshots`.
        mask_dark, mask_white: numbers in the mask's file that are transmittance 0 and 1, see
            :func:`~sci_lightning.files.mask_file.transmittance`.
        raw: how a file of raw numbers without a header is packed.
        bayer: colours of 2 x 2 pixels of the snapshots, row by row, such as ``rggb``; None: of the encoder's sensor.
        full_scale: the number that is 1.0; None: of the encoder's sensor, or chosen from the numbers.
        aperture: light scale; ``auto`` for an exposure that a white scene fills; None: what the measurement
            carries (``(N,)`` where every snapshot has its own), that of the encoder's sensor, or chosen from the
            numbers, see :mod:`sci_lightning.captures.light_scale`.
        tile: see :class:`~sci_lightning.decoder.tiling.tile_choice.TileChoice`.
        device, precision: as the settings of the commands, ``auto`` or such as ``cuda:1`` and ``bf16``.
        out: folder for ``reconstruction.npy``, frames, animations and an overview; None writes nothing.
        fps: frames per second of the animations, up to 50.
        frames: T that the mask must have; None for any.
        say: gets lines about what was chosen.
        warn: gets the warnings; None for ``say``, as lines that begin with ``warning:``.
        watch: gets how much is done, from 0 to 1, and a few words, again and again.

    Raises:
        BadInput: no mask, files that cannot be read, sizes that do not fit, or more memory is needed than there is.
    """
    if not isinstance(decoder, Decoder):
        raise BadInput(f"decoder={decoder!r}: expected a decoder, such as sci.load_decoder('gap_tv')")
    if mask is not None and not isinstance(mask, (str, Path)):
        raise BadInput(
            "mask= is the path of a file; of a tensor give sci.Encoder(mask, sci.sensors.Ideal()) as encoder"
        )
    if isinstance(measurement, Measurement):
        if measurement.is_linear:
            raise BadInput("sensor and aperture of this measurement are undone already: give what the camera recorded")
        aperture = measurement.aperture if aperture is None else aperture
        full_scale = 1.0 if full_scale is None else full_scale
        measurement = measurement.recorded()
    torch_device = resolve_device(device)
    networks = count_parameters(decoder) > 0
    computed_in = resolve_precision(precision, torch_device, networks)
    bit_depth = None if encoder is None else encoder.sensor.bit_depth
    if bayer is None and encoder is not None:
        bayer = encoder.sensor.pattern
    with _quiet_about_colour(bayer):
        snapshot = read_snapshot(measurement, key=key, full_scale=full_scale, bit_depth=bit_depth, raw=raw)
    patterns, rows, columns = None, slice(None), slice(None)
    placed: dict[str, Any] = {"key": mask_key, "step": mask_step, "origin": mask_origin, "slots": mask_slots}
    of_mask = {**placed, "dark": mask_dark, "white": mask_white}
    if mask is None and (unused := [name for name, value in of_mask.items() if value is not None]):
        raise BadInput(f"mask_{unused[0]}={of_mask[unused[0]]}: belongs to a mask; give mask=FILE as well")
    if mask is not None:
        levels = (mask_dark, mask_white)
        with _quiet_about_colour(bayer):
            read, rows, columns = mask_of_snapshots(mask, snapshot.measurement.numpy(), **placed, levels=levels)
        patterns = torch.from_numpy(np.ascontiguousarray(read))
    if encoder is None:
        if patterns is None:
            raise BadInput(f"nothing says which mask the snapshot was taken with; {GIVE_MASK}, or an encoder")
        encoder = Encoder(patterns, Ideal(), aperture=1.0)
    pipeline = Pipeline(encoder, decoder.eval(), bayer=bayer)
    own = patterns is None
    with torch.no_grad():
        patterns = pipeline.decoder_mask() if patterns is None else patterns
    if bit_depth is None and aperture is None:
        snapshot = snapshot.as_sum(float(patterns.sum(0).max()))
    values = snapshot.measurement[:, rows, columns]
    _check_fit(patterns, values, decoder, frames, f"mask={mask}" if mask else "the encoder's mask", snapshot.name)
    if bayer is not None:
        check_bayer(bayer, values.shape[1:])
        if (rows.start or 0) % 2 or (columns.start or 0) % 2:
            raise BadInput(f"bayer={bayer}: the mask begins inside a cell of 2 x 2 pixels; give an even mask_origin=")
        demosaicing()  # refused before anything is decoded
    truth = None if bayer is None else _true_colours(measurement, (len(values), *patterns.shape), rows, columns)
    light, why = resolve_aperture(aperture, encoder, patterns, float(values.max()), own)
    exposure = bit_depth is not None or float(values.max()) <= 1
    scales = torch.as_tensor(light).reshape(-1, 1, 1)
    darkest, lightest = (float(scale) for scale in scales.aminmax())
    doubt = snapshot.doubt(1.0 if exposure else max(1.0, lightest * float(patterns.sum(0).max())))

    pipeline.to(torch_device)
    patterns = patterns.to(torch_device)
    done, doubts = 0, []

    def show(state: object) -> None:
        if watch is not None:
            watch(done / len(values), str(state))

    def doubted(line: str) -> None:
        doubts.append(f"{snapshot.name}: {line}")
        (warn or (lambda text: say(f"warning: {text}")))(doubts[-1])

    def in_gray(image: torch.Tensor) -> torch.Tensor:
        return image if bayer is None else sub_lattices(image)[1 if bayer[0] != "g" else 0]

    def decoded() -> Iterator[np.ndarray]:
        nonlocal done
        for one in linear:
            video = pipeline.decode(one[None].to(torch_device), patterns, choice).float().cpu()
            yield (video if bayer is None else demosaiced(video, bayer).movedim(1, -1))[0].numpy()
            done += 1
            show("decoded")

    choice = TileChoice(tile, say, None if decoder.global_steps else lambda part, of: show(f"tile {part} of {of}"))
    earlier, decoder.watch = decoder.watch, show
    try:
        with torch.no_grad(), mixed_precision(computed_in, torch_device):  # refused before anything else takes its time
            choice.tiling(decoder, in_gray(values[:1]).to(torch_device), in_gray(patterns))
        with torch.no_grad():
            linear, patterns = linear_with_mask(pipeline.linearise(values.to(torch_device), light), patterns)
            linear = linear.cpu()
        in_words = f"{darkest:.4g}" if darkest == lightest else f"{darkest:.4g} to {lightest:.4g}"
        say(f"full_scale={snapshot.full_scale:g} ({snapshot.chosen or 'as given'}), aperture={in_words} ({why})")
        if networks:
            say(describe_precision(computed_in, torch_device))
        for line in (doubt, mask_warning(in_gray(linear * scales), in_gray(patterns.cpu()))):
            if line:
                doubted(line)
        with torch.no_grad(), mixed_precision(computed_in, torch_device):
            shape = (len(values), *patterns.shape, *([] if bayer is None else [len(CHANNELS)]))
            video = _kept(decoded(), shape, None if out is None else Path(out))
    finally:
        decoder.watch = earlier
    bright = bright_end(video)
    if not doubts and (line := doubtful_brightness(bright, snapshot.full_scale, lightest)):
        doubted(line)
    white = bright if bright > 0 and not SEEN[0] <= bright <= SEEN[1] else 1.0
    scores = {} if truth is None else _scores(video, truth)
    if scores:
        say("compared with orig: " + ", ".join(f"{key} {number(key, value)}" for key, value in scores.items()))
    result = Reconstruction(video, values, patterns.cpu(), snapshot.full_scale, light, tuple(doubts), white, scores)
    for note in [] if out is None else result.save(out, fps):
        say(note)
    return result


@contextmanager
def _quiet_about_colour(bayer: str | None) -> Iterator[None]:
    """Say nothing of a mosaic in a file whose colours are known: the warning asks for them."""
    with warnings.catch_warnings():
        if bayer is not None:
            warnings.filterwarnings("ignore", f".*{re.escape(BAYER)}", InputWarning)
        yield


def _check_fit(
    mask: torch.Tensor, values: torch.Tensor, decoder: Decoder, frames: int | None, named: str, name: str
) -> None:
    """Refuse a mask that is dark, or does not fit the snapshots, the decoder or what is said of it."""
    if not mask.any():
        raise BadInput(f"{named} is dark: every value is 0; {GIVE_MASK}")
    if frames is not None and frames != len(mask):
        raise BadInput(
            f"frames={frames}, but {named} has {len(mask)} slots: leave frames= out, or give the snapshot's own mask"
        )
    if mask.shape[1:] != values.shape[1:]:
        raise BadInput(
            f"{name}: the snapshot is {tuple(values.shape[1:])}, the mask {tuple(mask.shape[1:])} "
            f"(H, W); {doubtful_axes(mask.shape, values.shape[1:]) or GIVE_MASK}"
        )
    if decoder.frames not in (None, len(mask)):
        raise BadInput(
            f"{named} has {len(mask)} slots, and this {type(decoder).__name__} was built and trained for "
            f"{decoder.frames} frames: give a mask of {decoder.frames}, or a decoder for any number of frames, such as "
            "decoder=gap_tv or linear"
        )


def _true_colours(source: object, shape: tuple[int, ...], rows: slice, columns: slice) -> np.ndarray | None:
    """Return the frames ``(N, T, H, W, 3)`` that a file of snapshots holds as well, as ``orig``; None for none.

    Raises:
        BadInput: they are not in colour, or not those of the snapshots.
    """
    if not isinstance(source, (str, Path)) or "orig" not in array_names(source):
        return None
    frames = read_video_array(source, "orig", colour=True)[: shape[0] * shape[1], rows, columns]
    if frames.shape != (shape[0] * shape[1], *shape[2:], len(CHANNELS)):
        raise BadInput(f"{source}: orig is {frames.shape[:3]}, the snapshots show {shape} (N, T, H, W); leave it out")
    return frames.reshape(*shape, len(CHANNELS))


def _scores(video: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Return PSNR in dB and SSIM of videos ``(N, T, H, W, 3)``, of each channel and their means."""
    metrics = in_colour({"psnr": PSNR()} | ({"ssim": SSIM()} if min(truth.shape[2:4]) >= SSIM.smallest else {}))
    for pair in zip(video, truth, strict=True):
        for metric in metrics.values():
            metric.update(*(torch.from_numpy(np.array(frames)).movedim(-1, 0) for frames in pair))
    return {name: float(metric.compute()) for name, metric in metrics.items()}


def _kept(parts: Iterator[np.ndarray], shape: tuple[int, ...], out: Path | None) -> np.ndarray:
    """Return the videos of all snapshots ``(N, T, H, W)``: in memory, or written part by part and read as needed."""
    if out is None:
        check_memory("the video", 8 * math.prod(shape))
        return np.stack(list(parts))
    with atomic_write(out / "reconstruction.npy") as temporary:
        write_npy(temporary, shape, parts)
    return np.asarray(np.load(out / "reconstruction.npy", mmap_mode="r"))
