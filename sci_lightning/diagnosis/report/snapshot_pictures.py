"""Figures of a diagnosis of snapshots of unknown scenes."""

from __future__ import annotations

import torch
from matplotlib.figure import Figure

from sci_lightning.decoder import GAP
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.denoiser import TotalVariation
from sci_lightning.diagnosis.blind.blind_diagnosis import BlindDiagnosis
from sci_lightning.diagnosis.blind.held_out_pixels import PairedComparison
from sci_lightning.diagnosis.blind.prior import BLOCK
from sci_lightning.diagnosis.blind.snapshots import textured_window
from sci_lightning.diagnosis.report.corrected_camera import effective_mask, encoder_of
from sci_lightning.diagnosis.report.svg import AFTER, BEFORE, FAINT, style
from sci_lightning.encoder import Encoder
from sci_lightning.figures.figure import NotebookFigure
from sci_lightning.operator import SnapshotOperator

SIDE_PX = 192
"""Side of the part of a snapshot that is reconstructed for the report."""
FRAMES_SHOWN = 3
WHITE = 0.99
"""Quantile of a snapshot's light that is shown to the decoder as 1, the brightest that decoders expect."""


def snapshot_figures(result: BlindDiagnosis) -> dict[str, Figure]:
    """Draw the figures that lie beside the report, by file name; what there is nothing to draw for is left out."""
    drawn, seen = {}, result.predicted
    if result.effects or any(result.rounds[:1]):
        drawn["evidence.png"] = gain_figure(result)
    if result.effects and result.prediction is not None and seen is not None:
        before, after = (
            encoder_of(seen, result.model.path(fit.hypothesis)) for fit in (result.ideal, result.corrected)
        )
        numbers = tuple(seen.number.tolist())
        behind_most = (seen.sequence == seen.sequence.mode().values).tolist()
        shown = max(range(len(seen)), key=lambda n: (behind_most[n], numbers[n] in result.verification, -n))
        drawn["prediction.png"] = prediction_figure(result.prediction.gap, numbers, result.verification)
        drawn["reconstruction.png"] = reconstruction_figure(seen.dn[shown] / seen.full_scale, before, after)
    return drawn


def gain_figure(result: BlindDiagnosis) -> Figure:
    """Draw how many nats per pixel every snapshot gains by the corrected camera, and what the candidates would gain."""
    first = sorted(result.rounds[0].items(), key=lambda entry: entry[1]) if result.rounds else []
    count = bool(result.effects) + bool(first)
    with style():
        figure = NotebookFigure(figsize=(3.3 * max(count, 1.5), 3.0), layout="constrained")
        panels = list(figure.subplots(1, count, squeeze=False)[0])
        if result.effects:
            axes = panels.pop(0)
            gained = (result.corrected.log_likelihood - result.ideal.log_likelihood).nanmean(0) / BLOCK**2
            axes.bar(range(len(gained)), gained.nan_to_num(0.0).numpy(), color=AFTER)
            axes.set_xticks(range(len(gained)), [str(number) for number in result.observation.number.tolist()])
            axes.set(xlabel="snapshot", ylabel="nats per pixel gained", title="by snapshot")
        if first:
            axes = panels.pop(0)
            colours = [AFTER if name in result.names else FAINT for name, _ in first]
            axes.barh([name for name, _ in first], [max(nats, 0.0) for _, nats in first], color=colours)
            axes.set(xlabel="calibrated nats", title="candidates of the first round")
    return figure


def prediction_figure(comparison: PairedComparison, numbers: tuple[int, ...], verification: tuple[int, ...]) -> Figure:
    """Draw the prediction error of every snapshot before and after.

    Args:
        comparison: of the camera as it was given and the corrected one.
        numbers: of the snapshots in their file.
        verification: those of them that no fit has seen.
    """
    with style():
        figure = NotebookFigure(figsize=(1.6 + 0.75 * len(numbers), 2.8), layout="constrained")
        axes = figure.subplots()
        for shift, colour, which in ((-0.19, BEFORE, 0), (0.19, AFTER, 1)):
            heights = [pair[which] for pair in comparison.by_capture]
            places = [place + shift for place in range(len(numbers))]
            axes.bar(places, heights, 0.36, color=colour, label=("before", "after")[which])
        names = [f"{number}\n(verifies)" if number in verification else str(number) for number in numbers]
        axes.set_xticks(range(len(numbers)), names)
        axes.set(xlabel="snapshot", ylabel="prediction error")
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
        return figure


@torch.no_grad()
def reconstruction_figure(
    measurement: torch.Tensor, before: Encoder, after: Encoder, decoder: Decoder | None = None
) -> Figure:
    """Draw a part of one snapshot, and frames of it as reconstructed by two cameras.

    Args:
        measurement: ``(H, W)``, normalised by full scale.
        before, after: the camera as it was given, and the corrected one.
        decoder: None for GAP-TV, frame by frame, with little smoothing: it has no notion of time.
    """
    decoder = decoder or GAP(TotalVariation(steps=3), strengths=(0.02,), iterations=(25,))
    rows, columns = textured_window(measurement[None], SIDE_PX)
    origin = rows.start, columns.start
    part = measurement[None, rows, columns].float()
    videos = []
    for encoder in (before, after):
        mask = effective_mask(encoder)[:, rows, columns]
        scale = (part.quantile(WHITE) / SnapshotOperator(encoder.mask()).total().mean()).clamp(min=1e-9)
        videos.append(decoder(encoder.linearise(part, origin) / scale, mask)[0])
    slots = torch.linspace(0, len(videos[0]) - 1, FRAMES_SHOWN).round().long().tolist()
    top = max(float(video[slots].quantile(0.995)) for video in videos)
    with style():
        figure = NotebookFigure(figsize=(1.65 * (FRAMES_SHOWN + 1), 3.7), layout="constrained")
        axes = figure.subplots(2, FRAMES_SHOWN + 1)
        for line, (name, video) in zip(axes, zip(("before", "after"), videos, strict=True), strict=True):
            line[0].imshow(part[0], cmap="gray", interpolation="nearest")
            line[0].set_title("snapshot", loc="left")
            line[0].set_ylabel(name)
            for place, slot in zip(line[1:], slots, strict=True):
                place.imshow(video[slot], cmap="gray", vmin=0, vmax=top, interpolation="nearest")
                place.set_title(f"slot {slot}", loc="left")
        for place in axes.ravel():
            place.set_xticks([])
            place.set_yticks([])
            place.spines[:].set_visible(False)
        return figure
