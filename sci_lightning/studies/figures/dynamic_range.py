"""Dynamic range: how many steps of a grey wedge an encoder tells apart, and a colour checker as decoders recover it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from matplotlib.figure import Figure
from torch.nn import functional as F

from sci_lightning.configuration.build import build
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.sensor import ClipQuantise, Ideal
from sci_lightning.operator import SnapshotOperator
from sci_lightning.pipeline import Pipeline
from sci_lightning.plain_text import file_name, in_figure
from sci_lightning.runs.checkpoint import read_checkpoint
from sci_lightning.studies.figures.mosaic import usable
from sci_lightning.studies.tables.grid import Grid
from sci_lightning.studies.tables.run import ScoredRun

STEPS = 256
"""Of the wedge, from black to what fills the sensor's range when fully transmitted."""


def wedges(encoders: Mapping[str, Mapping[str, Any]], sensor: Mapping[str, float]) -> dict[str, torch.Tensor]:
    """Return what each encoder records of the wedge, see :func:`wedge`, with its mask as it starts, nothing learned.

    Args:
        encoders: plain configurations by name.
        sensor: noise of those encoders that have a sensor response, ``full_well`` and ``read_noise``.
    """
    recorded = {}
    for name, config in encoders.items():
        noise = {key: value for key, value in sensor.items() if key in config["sensor"]}
        recorded[name] = wedge(build({**config, "sensor": {**config["sensor"], **noise}}, f"encoder={name}"))
    return recorded


@torch.no_grad()
def wedge(encoder: Encoder, steps: int = STEPS) -> torch.Tensor:
    """Brightness of even grey scenes as the encoder's pixels report it, ``(steps, pixels)``.

    Each step is a motionless scene of its own; a pixel's report is its measurement over the aperture and the sum of its
    mask, in which every mask's own pattern is cancelled. Pixels that never open report nothing and are left out.
    """
    torch.manual_seed(0)  # of the sensor's noise
    mask = encoder.transmittance()
    levels = torch.linspace(0, 1, steps)
    video = levels[:, None, None, None].expand(-1, *mask.shape)
    reported = SnapshotOperator(mask).mean_frame(encoder.normalised(encoder.record(video, mask)))
    return reported[:, mask.sum(0) > 0]


def distinguishable_steps(reported: torch.Tensor) -> int:
    """How many steps of a wedge ``(steps, pixels)`` can be told apart.

    From black on, the next one is the first whose mean over the pixels exceeds the last one's by more than the noise:
    the standard deviation of the difference of two pixels, one of each step.
    """
    mean, variance = reported.mean(1).tolist(), reported.var(1).tolist()
    last = [0]
    for step in range(1, len(mean)):
        if mean[step] - mean[last[-1]] > (variance[step] + variance[last[-1]]) ** 0.5:
            last.append(step)
    return len(last)


def dynamic_range_table(recorded: Mapping[str, torch.Tensor], sensor: Mapping[str, float]) -> Grid:
    """A row for each encoder."""
    rows = [[name, str(distinguishable_steps(reported)), str(len(reported))] for name, reported in recorded.items()]
    noise = f"full well {sensor['full_well']:g} electrons, read noise {sensor['read_noise']:g} DN"
    notes = [
        f"Simulated, single pixels: steps whose means differ by more than the noise of two pixels. Sensors: {noise}.",
        "RBw/oSR has no sensor: no noise, no limit to its range.",
    ]
    title = "Dynamic range: steps of a grey wedge told apart"
    return Grid("dynamic_range", title, ["encoder", "told apart", "of"], rows, notes)


def dynamic_range_figure(recorded: Mapping[str, torch.Tensor]) -> Figure:
    """Heat maps: how often a pixel reports which brightness of which step."""
    figure = Figure(figsize=(3.6 * len(recorded), 3.7), layout="constrained")
    axes = figure.subplots(1, len(recorded), squeeze=False)[0]
    for panel, (name, reported) in zip(axes, recorded.items(), strict=True):
        bins = 64
        shares = torch.stack([torch.histc(step.clamp(0, 1.25), bins, 0, 1.25) for step in reported]) / reported.shape[1]
        image = panel.imshow(shares.T, origin="lower", extent=(0, 1, 0, 1.25), aspect="auto", cmap="magma", vmax=0.5)
        panel.set(title=f"{name}: {distinguishable_steps(reported)} steps told apart", xlabel="brightness of the step")
    axes[0].set_ylabel("brightness that pixels report")
    figure.colorbar(image, ax=axes, label="share of pixels")
    return figure


LUMINANCE = torch.tensor(
    [
        [10.1, 35.8, 19.3, 13.3, 24.3, 43.1],
        [30.1, 12.0, 19.8, 6.6, 44.3, 43.1],
        [6.1, 23.4, 12.0, 59.1, 19.8, 19.8],
        [90.0, 59.1, 36.2, 19.8, 9.0, 3.1],
    ]
)
"""Luminance of the 24 patches, row by row, in percent of a perfect white. Source: McCamy, Marcus and Davidson, "A
color-rendition chart", J. Applied Photographic Engineering 1976."""

BITS = 8
"""Of the sensor that records the checker for networks that were trained without one."""

DRAWN = (48, 72)
"""Points of a surface that is drawn."""


def checker(frames: int, size: tuple[int, int]) -> torch.Tensor:
    """Return the motionless checker ``(T, H, W)``: 4 x 6 patches on black, the white one at 1."""
    height, width = size
    row, column = (torch.arange(side) * count / side for side, count in zip(size, LUMINANCE.shape, strict=True))
    patches = (LUMINANCE / LUMINANCE.max())[row.long()][:, column.long()]
    inside = ((row.frac() - 0.5).abs() < 0.4)[:, None] & ((column.frac() - 0.5).abs() < 0.4)
    return (patches * inside).expand(frames, height, width)


def colour_checkers(
    runs: Sequence[ScoredRun], side: int, left_out: Callable[[str], None]
) -> Iterator[tuple[str, Figure]]:
    """A file's name and a figure for every scale and decoder of which two or more encoders were trained.

    Every encoder is shown with its mask of most bits. A network that was trained without a sensor response is tested
    through a sensor of 8 bits with automatic aperture, as a real camera would have it.

    Source: the paper's figure of dynamic range, the mean of the recovered frames as a 3-D heat map.

    Args:
        runs: of any seed; the first seed's are shown.
        side: of the checker that is shown, in pixels.
        left_out: called with a line for every checkpoint that is of no use; the others are shown.
    """
    groups: dict[tuple[str, str], dict[str, Path]] = {}
    for run in sorted(runs, key=lambda run: (run.fields["encoder"], -int(run.fields["bits"]), run.seed)):
        if run.checkpoint and run.fields["test_encoder"] == run.fields["encoder"]:
            rows = groups.setdefault((run.setting.scale, str(run.fields["decoder"])), {})
            rows.setdefault(str(run.fields["encoder"]), run.checkpoint)
    for (scale, decoder), rows in groups.items():
        frames = usable(rows, lambda path: recovered(path, side), left_out)
        if len(frames) > 1:
            yield file_name(f"colour_checker_{scale}_{decoder}"), _checker_figure(f"{decoder}, scale {scale}", frames)


@torch.no_grad()
def recovered(path: str | Path, side: int) -> torch.Tensor:
    """Return the mean ``(H, W)`` of the frames that a checkpoint's camera and decoder recover of the checker."""
    checkpoint = read_checkpoint(path)
    encoder, decoder = checkpoint.encoder().eval(), checkpoint.decoder()
    if isinstance(encoder.sensor, Ideal):
        encoder = Encoder(encoder.mask, ClipQuantise(BITS)).eval()
    height, width = (min(side, full) for full in encoder.size)
    mask = encoder.transmittance()[:, :height, :width]
    pipeline = Pipeline(encoder, decoder)
    torch.manual_seed(0)  # of the sensor's noise
    measurement = pipeline.record(checker(encoder.mask.frames, (height, width))[None], mask)
    return pipeline.decode(pipeline.linearise(measurement), pipeline.decoder_mask(mask))[0].mean(0)


def patch_error(frame: torch.Tensor) -> float:
    """Return the r.m.s. error of the means of the 24 patches of a recovered frame ``(H, W)``, as a part of white."""
    truth = checker(1, (frame.shape[0], frame.shape[1]))[0]
    inside = truth > 0
    rows, columns = LUMINANCE.shape
    means = []
    for image in (frame * inside, truth, inside.float()):
        means.append(F.adaptive_avg_pool2d(image[None, None], (rows, columns))[0, 0])
    return float(((means[0] - means[1]) / means[2]).square().mean().sqrt())


def _checker_figure(title: str, frames: dict[str, torch.Tensor]) -> Figure:
    """A surface of the truth, then one for every encoder."""
    truth = checker(1, next((frame.shape[0], frame.shape[1]) for frame in frames.values()))[0]
    panels = {"ground truth": truth}
    panels |= {f"{name}: error {100 * patch_error(frame):.1f} % of white": frame for name, frame in frames.items()}
    figure = Figure(figsize=(3.4 * len(panels), 3.4))
    figure.suptitle(in_figure(f"A colour checker recovered through an {BITS}-bit sensor: {title}", 120), fontsize=10)
    for place, (label, frame) in enumerate(panels.items(), 1):
        axes = figure.add_subplot(1, len(panels), place, projection="3d")
        heights = F.interpolate(frame[None, None], DRAWN, mode="nearest")[0, 0].clamp(0, 1.2).numpy()
        y, x = torch.meshgrid(torch.arange(DRAWN[0]), torch.arange(DRAWN[1]), indexing="ij")
        axes.plot_surface(
            x.numpy(), y.numpy(), heights, cmap="turbo", vmin=0, vmax=1, rstride=1, cstride=1, antialiased=False
        )
        axes.set(zlim=(0, 1.1), xticks=[], yticks=[])
        axes.view_init(elev=50, azim=-70)
        axes.set_title(in_figure(label), fontsize=9)
    return figure
