"""Dynamic range: how many steps of a grey wedge each encoder tells apart, from simulation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from matplotlib.figure import Figure

from sci_lightning.configuration.build import build
from sci_lightning.encoder import Encoder
from sci_lightning.operator import SnapshotOperator
from sci_lightning.studies.tables.grid import Grid

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
