"""What a diagnosis leaves as JSON: ``report.json``, and ``snapshots.json`` of snapshots whose scenes are unknown."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from sci_lightning.files.json_file import JsonFile, JsonObject, Number, says

Finite = Annotated[float, Field(allow_inf_nan=False)]
Value = Annotated[int, Field(ge=-(2**63), lt=2**63)] | Finite | str
"""Of a parameter; a text for a choice such as an orientation."""
Count = Annotated[int, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Kind = Literal["dark", "flat", "pattern", "static", "dynamic", "unknown"]
Verdict = Literal["consistent", "explained", "partly_explained", "undecided", "unexplained"]
"""The ideal camera suffices; the named effects account for everything; they make held-out pixels likelier, but
something is left; snapshots of unknown scenes are explained nearly as well without any mask; no name helps."""
Agree = Annotated[list[Count], Field(min_length=2, max_length=2)]
"""How many snapshots ask for something, and of how many."""


class Estimate(JsonObject):
    """An estimated parameter."""

    value: Value = says("maximum-likelihood estimate")
    std: Number = says("standard deviation, 0 where it was not estimated or is a choice", ge=0)
    systematic: Number = says("part of it that is the error of the formula", ge=0, default=0)
    unit: str = says("of the three numbers; 1 for a ratio, empty for a choice")


class Evidence(JsonObject):
    """What the captures lose without an effect, everything else fitted anew; empty for noise."""

    delta_nll: float = says("rise of the negative log-likelihood, nats", default=0)
    delta_bic: float = says("rise of the Bayesian information criterion", default=0)
    agree: Agree = says("blind mode: snapshots that ask for the effect, and of how many", default=[0, 0])
    p_value: Share = says("blind mode: that chance alone prefers the effect so clearly, over tiles", default=1)


class NamedEffect(JsonObject):
    """An effect that the captures ask for."""

    name: str = says("as in encoder.effects of a configuration")
    stage: str = says("where it acts: scene (the laboratory), modulator, relay, exposure, optics or sensor")
    parameters: dict[str, Estimate] = says("by name")
    evidence: Evidence
    alternatives: list[str] = says("effects that these captures cannot tell from this one")
    tell_apart: str = says("which captures would, in words")
    probability: Share | None = says("that it is there, or one of its class, given the captures", default=None)
    shares: dict[str, Share] = says("of that probability, by name", default={}, alias="class")


class Misfit(JsonObject):
    """How far prediction and recording are apart."""

    chi2: float = says("mean of the squared quantile residuals, 1 for a right model")
    rmse_dn: float = says("root mean square difference, DN")
    nll: float = says("negative log-likelihood per pixel, nats")


class Gap(Misfit):
    """The misfit on pixels that no fit has seen."""

    pixels: int = says("that it was computed from", ge=1)
    chi2_limit: float = says("largest chi2 of a right model, by chance once in 1 / search.significance times", gt=0)
    by_kind: dict[Kind, Misfit] = says("the same by kind of capture")


class BlindGap(JsonObject):
    """The same of unknown scenes: likelihoods with the scene integrated out, or errors of prediction."""

    nll: float = says("negative log-likelihood per pixel, nats", default=0)
    pixels: Count = says("that count", default=0)
    nll_by_capture: list[float | None] = says("null where no block of a snapshot counts", default=[])
    prediction_error: float = says("RMS of held-out pixels predicted from the others, in their deviations", default=0)
    by_capture: list[float] = says("the same of every snapshot", default=[])


class Gaps(JsonObject):
    """The misfit of the ideal camera, and with everything that was named."""

    before: Gap | BlindGap
    after: Gap | BlindGap


class Unnamed(JsonObject):
    """A deviation that no named effect explains."""

    stage: str = says("in which something is missing")
    where: str = says("how it shows, in words")
    p_value: Share = says("that chance alone makes it look this strong")
    nats: float = says("log-likelihood that a free form of this stage gains", default=0)
    probability: Share | None = says("that it is there; null of a map that is not what its name says", default=None)
    picture: str = says("file beside the report that shows it")


class ResidualTest(JsonObject):
    """What the residuals were asked, and what they answered."""

    name: str
    about: Literal["mean", "variance", "converter", "map"] = says("of the residuals; codes; an estimated map")
    question: str = says("in words")
    statistic: float = says("the larger, the less it can be chance")
    p_value: Share = says("of such a statistic or a larger one if the model is right")
    corrected: Share = says("the p-value after Holm's procedure for the number of tests")
    nats: float = says("approximate gain of a model of this structure, less what chance gives")
    significant: bool = says("whether the corrected p-value is below 0.001")


class ResidualTests(JsonObject):
    """Tests of the ideal camera, and with everything that was named."""

    before: list[ResidualTest]
    after: list[ResidualTest]


class Border(JsonObject):
    """Pixels along the sides that count nowhere: they depend on what lies beyond the patterns."""

    top: Count
    right: Count
    bottom: Count
    left: Count


class Split(JsonObject):
    """Which captures and pixels were fitted, and which were held out to judge the fit."""

    held_out_captures: list[Count] = says("held out as a whole, as numbered in the file from 0")
    fitted_captures: Count = says("of which pixels were fitted")
    held_out_blocks: str = says("which blocks of the fitted captures were held out, in words")
    held_out_fraction: Share = says("of all pixels")
    held_out: bool = says("whether anything was held out at all")
    border: Border | None = says("pixels that count nowhere", default=None)
    counted_fraction: Share = says("of the pixels that this leaves", default=1)
    note: str = says("what is unusual about the division", default="")


class Verification(JsonObject):
    """Misfit on captures that neither fits nor choices of a model have seen; the verdict rests on it."""

    captures: list[Count] = says("these, as numbered in the file from 0")
    chi2: float = says("with everything that was named", default=1)
    rmse_dn: float = says("root mean square error, DN", default=0)
    nll: float = says("negative log-likelihood per pixel, nats", default=0)
    pixels: Count = says("of these captures that count", default=0)
    chi2_limit: float = says("largest chi2 that a right model reaches by chance", default=1.05)
    before: Gap | BlindGap | None = says("the same for the ideal camera", default=None)
    prediction_error: float = says("blind mode: RMS error of held-out pixels, in their deviations", default=0)
    by_capture: list[float] = says("blind mode: the same of every one of them", default=[])
    note: str = says("why there are none, where there are none", default="")


class Undetermined(JsonObject):
    """An effect that snapshots of unknown scenes cannot tell from something about the scenes."""

    effect: str
    looks_like: str = says("what about the scenes looks the same")


class PredictionErrors(JsonObject):
    """RMS of held-out pixels predicted from the others, as a part of their standard deviation."""

    before: float = says("by the ideal camera")
    after: float = says("by the corrected camera")
    without_mask: float = says("by a camera whose mask is the same everywhere")


class WithoutMask(JsonObject):
    """Blind mode: a camera without any mask beside the likeliest one, by what both gain over the ideal one."""

    gained: float = says("nats per pixel; nearly as much as with the mask means that nothing is decided")
    gained_with_mask: float = says("nats per pixel")


class UnknownScenes(JsonObject):
    """What snapshots of unknown scenes, beside captures of known ones, say about the corrected camera."""

    captures: list[Count] = says("these snapshots, as numbered in the file from 0")
    prediction_error: PredictionErrors
    agree: Agree = says("snapshots that ask for the corrected camera, and of how many")
    p_value: Share = says("that chance alone prefers the corrected camera so clearly")


class BadCapture(JsonObject):
    """A capture that contradicts all others (mislabelled, moved, saturated) and was left out."""

    capture: Count = says("number in the file, from 0")
    kind: str = says("as inferred from what the file says about it")
    role: Literal["fits and choices", "verification"] = says("what it would have been used for")
    chi2: float = says("mean square of its residuals, clipped at 6 deviations, under the model of the others")
    others_chi2: float = says("the largest such number among the others")
    sentence: str = says("what it looks like")


class BudgetUsed(JsonObject):
    """Processor time of the search."""

    allowed_s: float = says("seconds after which nothing new is begun", gt=0)
    used_s: float = says("seconds that were used", ge=0)
    not_tried: list[str] = says("what was left out for lack of time, in words")


class DiagnosedFile(JsonObject):
    """The captures file that was diagnosed."""

    file: str = says("its name, without its folder", default="")
    name: str = says("what it calls the camera or the session", default="")


class DiagnosisReport(JsonFile):
    """``report.json``: whether captures agree with the ideal encoder, and which effects explain where they do not.

    Version 2 adds ``mode``, ``laboratory``, ``verification``, ``considered``, ``undetermined`` and ``notes``, version 3
    ``budget``, ``probability`` and ``class`` of every effect, the verdict ``undecided``, ``without_mask``,
    ``calibration``, ``imperfections``, ``not_named`` and ``probability`` of what is unnamed.
    """

    format: Literal["sci-diagnosis"]
    format_version: Literal[1, 2, 3]
    verdict: Verdict = says("consistent: the ideal camera suffices; explained: the named effects account for all")
    effects: list[NamedEffect] = says("in the order in which light meets them")
    uncertainty: str = says("what the uncertainties include and leave out, for people")
    gap: Gaps = says("on pixels that no fit has seen; on the fitted ones where none could be held out")
    unnamed: list[Unnamed] = says("deviations that no named effect explains")
    where: ResidualTests
    noise: dict[str, dict[str, float] | list[str]] = says("values by effect; stated_by_the_file lists what it states")
    next_captures: list[str] = says("sentences: what would tell the named effects from their alternatives")
    split: Split
    mode: Literal["calibrated", "blind"] = says("whether scenes were known", default="calibrated")
    laboratory: list[NamedEffect] = says("of stage scene: the target differs from the file", default=[])
    verification: Verification | None = None
    considered: dict[str, str] = says("dotted paths of the classes that might have been named", default={})
    undetermined: list[Undetermined] = says("blind mode: what snapshots cannot tell", default=[])
    notes: list[str] = says("blind mode: what is unusual, in sentences", default=[])
    without_mask: WithoutMask | None = None
    calibration: dict[str, dict[str, Estimate]] = says("blind mode: of a measured mask, by effect", default={})
    unknown_scenes: UnknownScenes | None = None
    bad_captures: list[BadCapture] = []
    imperfections: list[NamedEffect] = says("errors of the laboratory, for which no camera is blamed", default=[])
    not_named: dict[str, Share] = says("how probable effects are that were fitted beside the named ones", default={})
    budget: BudgetUsed | None = None
    seed: Count = says("of the randomised quantile residuals")
    sci_lightning: str = says("version of the program")
    captures: DiagnosedFile | None = None
    date: str = says("ISO 8601, UTC, to the second", default="")
    runtime_s: float = says("of the diagnosis and its pictures", ge=0, default=0)


class Levels(JsonObject):
    """Where the values of snapshots lie, DN."""

    lowest: Count
    highest: Count
    median: float
    black_level: float | None = says("of the peak at the dark end; null where none shows")
    at_zero: Share = says("part of the pixels at 0 DN")
    at_full_scale: list[Share] = says("part of the pixels at the largest DN, by snapshot")
    saturates_at: int | None = says("DN below full scale at which values pile up; null where they do not")


class Codes(JsonObject):
    """Which of the converter's codes occur."""

    missing: Count = says("codes that never occur although their neighbours do")
    of: Count = says("codes of which it can be said")
    step: int = says("greatest common divisor of the distances between codes, DN", ge=1)


class Defects(JsonObject):
    """Pixels that differ from their neighbours in every snapshot."""

    hot: Count = says("always brighter")
    dark: Count = says("always darker: dead, or the mask never opens there")
    places: list[list[Count]] = says("row and column of the first ones, hot ones first")
    decided: bool = says("whether there are enough snapshots to tell defects from the scene")


class Lines(JsonObject):
    """Offsets of rows or columns that all snapshots share."""

    std: float = says("standard deviation, DN; 0 where nothing is shared", ge=0)
    sigma: float = says("standard errors by which what is shared differs from chance")
    significant: bool


class NoiseCurve(JsonObject):
    """Noise against brightness."""

    source: Literal["repeated", "smooth", "none"] = says("two snapshots of one scene; the smoothest blocks; neither")
    levels: list[float] = says("means of the bins above the black level, DN")
    deviations: list[float] = says("standard deviations of the noise in each bin, DN")
    read_noise_dn: float | None = says("without light; null where the bins do not determine it")
    full_well_e: float | None = says("electrons at full scale; null likewise")


class SnapshotFacts(JsonFile):
    """``snapshots.json``: what snapshots of unknown scenes tell by themselves."""

    format: Literal["sci-snapshots"]
    format_version: Literal[1]
    file: str = says("that was read, without its folder")
    snapshots: int = says("how many", ge=1)
    size: list[int] = says("height and width in pixels", min_length=2, max_length=2)
    bit_depth: int = says("as stated, else the smallest usual number that holds all values", ge=1, le=16)
    levels: Levels
    codes: Codes
    defects: Defects
    rows: Lines
    columns: Lines
    noise: NoiseCurve
    sentences: list[str] = says("the facts in words")
    needed: list[str] = says("what would let a diagnosis say more")
    sci_lightning: str = says("version of the program")
