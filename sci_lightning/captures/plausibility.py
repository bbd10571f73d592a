"""Checks for the most frequent mistakes in a recipe, made while a folder is packed.

Impossible values are refused; unlikely ones give one line that says what to check. Captures files that are
already packed are not checked here, because their format permits more than is likely.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sci_lightning.captures.recipe import CaptureEntry, Top

FAR = 10.0
"""Ratio of measured and predicted level above which the recipe is more likely to be wrong than the camera."""

FAR_ALIKE = 1.8
"""The same ratio where it is the median of all captures: no gain is so wrong, but an aperture that was forgotten is."""

BRIGHT_SCENE = 2.0
"""Irradiance above which a scene may be in percent or DN: 1.0 fills the sensor's range."""

TOO_BRIGHT = 5.0
"""Ratio of predicted and measured level above which such a scene is refused."""

LARGEST_SCALE = 1e6
"""Aperture or exposure that no camera has, relative to nominal."""

DIM_PATTERN = 0.25
"""Largest transmittance below which ``pattern_levels`` is likely to be wrong."""

VISIBLE = 0.05
"""Part of full scale below which a level is not compared: offsets and noise are as large."""

INVERTED = -0.3
"""Correlation of measurement and prediction below which the patterns look inverted."""

WRONG_NOISE = 4.0
"""Ratio of the stated and the measured read noise from which the datasheet is likely to mean another number. Smaller
ones are left to a diagnosis."""

ROUNDING = 12**-0.5
"""Standard deviation, in DN, of what rounding to whole numbers adds."""

FULL_WELLS = (100.0, 1e7)
"""Electrons at full scale between which cameras lie."""

MOST_NAMED = 3
"""Largest number of entries that one warning names."""


@dataclass(frozen=True)
class Entry:
    """An entry of ``captures.yaml`` with the arrays that it names.

    Attributes:
        node: the entry itself.
        measurement: (K, H, W) uint16, raw DN of its K captures.
        sequence: (T,) index into the patterns.
        scene: (T, H, W) float32, NaN where unknown.
        aperture, exposure: 1 is nominal.
        kind: its label, else what its content looks like.
    """

    node: CaptureEntry
    measurement: np.ndarray
    sequence: np.ndarray
    scene: np.ndarray
    aperture: float
    exposure: float
    kind: str

    @property
    def key(self) -> str:
        """``captures[3]``, as messages name it."""
        return self.node.where.rpartition(": ")[2].rstrip(".")

    @property
    def is_lit(self) -> bool:
        """Whether light is meant to fall on the sensor."""
        return self.kind != "dark"

    def nominal(self, patterns: np.ndarray) -> np.ndarray | None:
        """Return the ideal measurement (H, W) before clipping, 1 at full scale; None if the scene is unknown."""
        if not np.isfinite(self.scene[0]).all():
            return None
        total = np.zeros(self.scene.shape[1:], np.float32)
        for index, frame in zip(self.sequence, self.scene, strict=True):
            total += patterns[index] * frame
        return self.aperture * total


@dataclass(frozen=True)
class Levels:
    """The predicted and the measured level of an entry, as parts of full scale."""

    entry: Entry
    predicted: float
    measured: float
    """Above the level of the dark captures."""
    saturated: float
    """Part of the pixels at full scale."""
    correlation: float | None
    """Correlation of measured and predicted pixels; None where the prediction is even."""


def check_entries(entries: Sequence[Entry]) -> None:
    """Refuse values that no camera has.

    Raises:
        BadInput: an aperture or exposure of 0 for a capture with light, or absurdly large.
    """
    for entry in entries:
        for key, value in (("aperture", entry.aperture), ("exposure", entry.exposure)):
            if value > LARGEST_SCALE:
                raise entry.node.refusal(key, f"{value:g} is no factor relative to nominal, expected numbers around 1")
        labelled_lit = entry.node.kind not in (None, "dark")
        if entry.aperture == 0 and labelled_lit:
            raise entry.node.refusal("aperture", f"0 lets no light in, but kind is {entry.kind}; expected kind: dark")
        if entry.exposure == 0 and entry.is_lit:
            raise entry.node.refusal(
                "exposure", f"0 collects no light, but the capture is {entry.kind}; 1 is the nominal integration time"
            )


def suspicions(
    top: Top, entries: Sequence[Entry], patterns: np.ndarray, coding: int, bit_depth: int, level: float | None = None
) -> list[str]:
    """Compare what a recipe says with what was measured.

    Args:
        top: the recipe's top level.
        entries: all of them.
        patterns: (P, H, W) in [0, 1].
        coding: how many of them come from files; the others are all off or all on.
        bit_depth: of the measurements.
        level: the value of the patterns' files that counts as 1.0; None: they are taken as they are.

    Returns:
        One line for each thing that is unlikely.

    Raises:
        BadInput: what cannot be right: scenes that would be many times brighter than what was measured, patterns that
            would be as much darker.
    """
    full_scale = 2**bit_depth - 1
    levels = _levels(entries, patterns, full_scale)
    for entry_levels in levels:
        _check_scene(entry_levels, full_scale)
    lines = [*_dim_patterns(top, patterns[:coding], level, levels)]
    if not lines:  # else the prediction is wrong everywhere
        lines += _contradictions(levels)
    lines += _bright_scenes(entries)
    lines += _exposures(entries)
    lines += _inverted(levels)
    lines += _numbers(entries, bit_depth)
    lines += _dark_level(entries, full_scale)
    lines += _datasheet(top, entries, full_scale)
    return [f"{top.where}{line}" for line in lines]


def _levels(entries: Sequence[Entry], patterns: np.ndarray, full_scale: int) -> list[Levels]:
    dark = [entry.measurement.mean() for entry in entries if not entry.is_lit]
    darkest = min(float(entry.measurement.mean()) for entry in entries)
    black = min(np.mean(dark), darkest) if dark else min(int(entry.measurement.min()) for entry in entries)
    black /= full_scale
    levels = []
    for entry in entries:
        nominal = entry.nominal(patterns) if entry.is_lit else None
        if nominal is None or not nominal.any():
            continue
        mean = entry.measurement.mean(0) / full_scale
        saturated = float((entry.measurement == full_scale).mean())
        shown = np.clip(nominal, 0, 1)
        varied = nominal.size >= 64 and shown.std() > 0.02 and mean.std() > 0
        correlation = float(np.corrcoef(shown.ravel(), mean.ravel())[0, 1]) if varied else None
        net = max(float(mean.mean()) - black, 1e-3 / full_scale)
        levels.append(Levels(entry, float(nominal.mean()), net, saturated, correlation))
    return levels


def _check_scene(level: Levels, full_scale: int) -> None:
    entry, brightest = level.entry, float(level.entry.scene.max())
    if brightest < BRIGHT_SCENE or level.saturated > 0.5 or level.predicted < TOO_BRIGHT * level.measured:
        return
    number = None if isinstance(entry.node.scene, list) else entry.node.scene
    right = (
        f"{number:g} % is {number / 100:g}, and {number:g} DN are {number / full_scale:.3g}"
        if number is not None
        else "scene_levels: the value of the file that means 1.0"
    )
    raise entry.node.refusal(
        "scene",
        f"{brightest:g} predicts {level.predicted:.3g} times full scale, {level.measured:.3g} of it was measured; "
        f"1.0 is the irradiance that fills the sensor's range ({right})",
    )


def _dim_patterns(top: Top, coding: np.ndarray, given: float | None, levels: Sequence[Levels]) -> Iterator[str]:
    largest = float(coding.max())
    if largest == 0:
        yield "patterns: all of them are dark everywhere; are these the right files?"
    elif largest < DIM_PATTERN and given is not None:
        stored = largest * given
        text = f"the largest value is {stored:g}, {largest:.2g} of {given:g}: the modulator would never open further"
        far = [level.measured / level.predicted for level in levels if level.measured > VISIBLE]
        if far and np.median(far) >= FAR:
            raise top.refusal(
                "pattern_levels",
                f"{text}, and {np.median(far):.3g} times the light that this predicts was measured; "
                f"is it pattern_levels: {stored:g}?",
            )
        yield f"pattern_levels: {text}; is it pattern_levels: {stored:g}?"


def _contradictions(levels: Sequence[Levels]) -> Iterator[str]:
    far = []
    for level in levels:
        brighter = level.measured > VISIBLE and level.measured >= FAR * level.predicted
        dimmer = level.predicted > VISIBLE and level.predicted >= FAR * level.measured and level.saturated < 0.5
        if brighter or dimmer:
            far.append(level)
    if far:
        first = far[0]
        yield (
            f"{_keys([level.entry for level in far])}: scene, patterns and aperture predict {first.predicted:.3g} of "
            f"full scale, {first.measured:.3g} was measured above the dark level; check aperture (light scale, 1 is "
            "nominal), scene and pattern_levels"
        )
        return
    seen = [level for level in levels if min(level.predicted, level.measured) > VISIBLE and level.saturated < 0.5]
    ratio = float(np.median([level.predicted / level.measured for level in seen])) if seen else 1.0
    if not 1 / FAR_ALIKE < ratio < FAR_ALIKE:
        yield (
            f"captures: scene, patterns and aperture predict {ratio:.3g} times the light that was measured (median of "
            f"{len(seen)}); is it aperture: {1 / ratio:.2g} times what is stated? (light scale, 1 is nominal)"
        )


def _bright_scenes(entries: Sequence[Entry]) -> Iterator[str]:
    bright = [entry for entry in entries if np.nan_to_num(entry.scene).max() >= BRIGHT_SCENE]
    if bright:
        yield (
            f"{_keys(bright)}: a scene of {np.nan_to_num(bright[0].scene).max():g} is that many times what fills the "
            "sensor's range (1.0); is it in percent or DN?"
        )


def _exposures(entries: Sequence[Entry]) -> Iterator[str]:
    lit = [entry for entry in entries if entry.is_lit]
    times = {entry.exposure for entry in lit}
    if len(times) == 1 and (time := times.pop()) != 1:
        yield (
            f"{_keys(lit)}: every capture with light has exposure {time:g}; it is relative to the nominal "
            "integration time (leave it out if that is the nominal one), not in ms"
        )
    elif far := [entry for entry in lit if not 0.01 <= entry.exposure <= 100]:
        yield f"{_keys(far)}: exposure {far[0].exposure:g} is relative to the nominal integration time; is it in ms?"
    if far := [entry for entry in entries if entry.is_lit and not 1e-4 <= entry.aperture <= 1e2 and entry.aperture]:
        yield f"{_keys(far)}: aperture {far[0].aperture:g} is a light scale, 1 is nominal; is it in other units?"


def _inverted(levels: Sequence[Levels]) -> Iterator[str]:
    varied = [level for level in levels if level.correlation is not None]
    single = [level for level in varied if level.entry.kind == "pattern"] or varied
    if single and (typical := float(np.median([level.correlation for level in single]))) < INVERTED:
        yield (
            f"{_keys([level.entry for level in single])}: measured brighter where the patterns are dark (correlation "
            f"{typical:.2f}); are the patterns inverted?"
        )


def _numbers(entries: Sequence[Entry], bit_depth: int) -> Iterator[str]:
    count = sum(len(entry.measurement) for entry in entries)
    first = entries[0].measurement[0]
    if count > 1 and all((entry.measurement == first).all() for entry in entries):
        yield f"captures: all {count} are identical in every pixel, which a camera's noise prevents; is it one file?"
    largest = max(int(entry.measurement.max()) for entry in entries)
    lit = any(entry.is_lit for entry in entries)
    if lit and bit_depth > 8 and 0 < largest < 2 ** (bit_depth - 3):
        yield (
            f"bit_depth: {bit_depth} bits reach {2**bit_depth - 1}, no capture exceeds {largest}; "
            f"is it {max(8, largest.bit_length())}?"
        )
    bits = int(np.bitwise_or.reduce([np.bitwise_or.reduce(entry.measurement, axis=None) for entry in entries]))
    step = bits & -bits
    if step > 2 and len(np.unique(np.concatenate([entry.measurement[0].ravel() for entry in entries]))) >= 16:
        yield (
            f"captures: every DN is a multiple of {step}, as if {bit_depth - step.bit_length() + 1} bits had been "
            f"shifted to {bit_depth}; divide them and give that bit_depth"
        )


def _dark_level(entries: Sequence[Entry], full_scale: int) -> Iterator[str]:
    dark = [float(entry.measurement.mean()) for entry in entries if not entry.is_lit]
    lit = [float(entry.measurement.mean()) for entry in entries if entry.is_lit]
    if dark and lit and max(dark) > np.median(lit) + VISIBLE * full_scale:
        yield (
            f"captures: dark ones reach {max(dark):.4g} DN on average, those with light {np.median(lit):.4g}; "
            "are they mixed up?"
        )


def _datasheet(top: Top, entries: Sequence[Entry], full_scale: int) -> Iterator[str]:
    noise, electrons = top.read_noise_dn, top.full_well_e
    if noise is not None and noise > full_scale / 4:
        yield f"read_noise_dn: {noise:g} DN, and full scale is {full_scale}: no light would show; is it a variance?"
    elif noise is not None and (measured := _read_noise(entries)) is not None:
        stated = float(np.hypot(noise, ROUNDING))
        if not 1 / WRONG_NOISE < stated / measured < WRONG_NOISE:
            yield (
                f"read_noise_dn: {noise:g} DN are stated, repeated dark captures differ by {measured:.3g} DN (standard "
                "deviation); is it in electrons?"
            )
    if electrons is not None and not FULL_WELLS[0] <= electrons <= FULL_WELLS[1]:
        yield (
            f"full_well_e: {electrons:g} electrons at full scale, cameras have {FULL_WELLS[0]:g} to {FULL_WELLS[1]:g}; "
            "leave it out where it is not known, and the diagnosis estimates it"
        )


def _read_noise(entries: Sequence[Entry]) -> float | None:
    """Return the standard deviation, in DN, by which repeated dark captures differ; None without any."""
    repeated = [entry.measurement for entry in entries if not entry.is_lit and len(entry.measurement) > 1]
    if not repeated:
        return None
    variances = [stack.astype(np.float32).var(0, ddof=1).mean() for stack in repeated]
    return max(float(np.sqrt(np.mean(variances))), ROUNDING)


def _keys(entries: Sequence[Entry]) -> str:
    names = [entry.key for entry in entries]
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more
