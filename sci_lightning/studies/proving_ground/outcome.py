"""The outcome of a case: what was hidden beside what was named, and whether the diagnosis was right."""

from __future__ import annotations

import math
from typing import Literal

from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.files.diagnosis_report import (
    BlindGap,
    Gap,
    Gaps,
    NamedEffect,
    Share,
    Unnamed,
    Verdict,
    Verification,
)
from sci_lightning.files.json_file import JsonObject, says
from sci_lightning.studies.engine.records import CaseRecord
from sci_lightning.studies.proving_ground.reliability import Statement, statements
from sci_lightning.virtual_camera import EFFECTS
from sci_lightning.virtual_camera.truth import HiddenEffect

MIN_CLASS_SHARE = 0.05
"""Share of a class of names from which a member counts as named."""
LEFT_OUT = "left out"
"""What stands among the answers of a diagnosis that left captures out."""


class TrueNames(JsonObject):
    """A fit of the hidden effects, begun at the truth, where the names are wrong."""

    nats: float = says("how much likelier the true names make the captures than the named effects do")
    chi2: float = says("reduced, on held-out pixels")


class Origin(JsonObject):
    """Where, when and with which version of the program a case was run."""

    machine: str = ""
    date: str = ""
    commit: str = ""


class Outcome(CaseRecord):
    """``cases/NAME.json``: a case that came to an end, with the truth beside the diagnosis."""

    format: Literal["sci-proving-ground-case"]
    format_version: Literal[1]
    case: str = says("its name")
    suite: str = says("that the case belongs to")
    mask: str = says("structural, binary or a file of coding patterns", default="")
    bit_depth: int = says("of the converter", ge=1, le=16)
    size: tuple[int, int] = says("(H, W) of a capture in pixels")
    frames: int = says("T, slots of a capture", ge=1)
    datasheet: Literal["stated", "silent", "double", "half"] = says(
        "what the captures file says of the noise", default="stated"
    )
    formulation: Literal["overlap", "rays"] = says("of the virtual camera", default="overlap")
    captures: str = says("which set of captures was taken")
    asked: list[str] = says("effects that the case asks to be hidden", default=[], alias="told")
    seed: int = says("of patterns, scenes, parameters and noise", default=0)
    command: str = says("that makes the same captures again", default="")
    sci_lightning: str = says("version of the program", default="")
    hidden: list[HiddenEffect]
    also_true: list[str] = says(
        "right though nothing of the kind was hidden, as noise beside a wrong datasheet", default=[]
    )
    log_likelihood_gain: float = says("of all hidden effects together, nats", default=0)
    verdict: Verdict
    named: list[NamedEffect] = says("by the diagnosis, in the order of the light", alias="found")
    not_named: dict[str, Share] = says("how probable other effects are", default={})
    unnamed: list[Unnamed] = says("deviations that no name explains")
    bad_captures: list[int] = says("that the diagnosis left out because they contradict the others", default=[])
    gap: Gaps
    verification: Verification | None = None
    seconds: float = says("time of the diagnosis and its report")
    cpu_seconds: float = says("the same in seconds of a processor")
    memory_mib: float = says("peak of the resident memory during the diagnosis, MiB")
    true_names: TrueNames | None = says("null where the names are right or not known", default=None)
    total_cpu_seconds: float = says("of the whole case, captures and comparison with the truth included", default=0)
    provenance: Origin = Origin()

    @property
    def chi2_before(self) -> float:
        """Held-out reduced chi2 of the ideal camera."""
        return _known_scenes(self.gap.before).chi2

    @property
    def chi2_after(self) -> float:
        """Held-out reduced chi2 with everything that was named."""
        return _known_scenes(self.gap.after).chi2

    @property
    def _judged(self) -> Gap | Verification:
        """The misfit on captures that nothing has seen; that of held-out pixels where no capture was kept for it."""
        if self.verification is not None and "chi2" in self.verification.model_fields_set:
            return self.verification
        return _known_scenes(self.gap.after)

    @property
    def verified_chi2(self) -> float:
        """Reduced chi2 with everything that was named, on captures that nothing has seen."""
        return self._judged.chi2

    @property
    def chi2_limit(self) -> float:
        """What ``verified_chi2`` may be by chance; more than 1.05 only where there are few pixels."""
        return (
            self._judged.chi2_limit if "chi2_limit" in self._judged.model_fields_set else SearchSettings.negligible_chi2
        )

    @property
    def unnamed_stages(self) -> tuple[str, ...]:
        """``unnamed:<stage>`` of the deviations that no name explains, the strongest first."""
        ordered = sorted(self.unnamed, key=lambda deviation: -deviation.nats)
        return tuple(dict.fromkeys(f"unnamed:{deviation.stage}" for deviation in ordered))

    @property
    def hidden_names(self) -> tuple[str, ...]:
        """Names of the hidden effects."""
        return tuple(effect.name for effect in self.hidden)

    @property
    def answers(self) -> tuple[str, ...]:
        """Everything that the diagnosis reports: names, ``unnamed:<stage>``, and whether it left captures out."""
        left_out = (LEFT_OUT,) if self.bad_captures else ()
        return (*(effect.name for effect in self.named), *self.unnamed_stages, *left_out)

    @property
    def exact(self) -> bool:
        """Whether the diagnosis named the hidden effects and no others, except those that are true as well.

        A class of names that the captures cannot tell apart counts as any of its members.
        """
        meant = {name for effect in self.named for name in names_meant(effect)}
        return not self.wrong_names and meant.issuperset(self.hidden_names)

    @property
    def smallest_gain(self) -> float:
        """Log-likelihood in nats that the faintest of the hidden effects gains beside the others."""
        return min((effect.log_likelihood_gain or 0.0 for effect in self.hidden), default=math.inf)

    @property
    def wrong_names(self) -> tuple[str, ...]:
        """Names in the diagnosis of whose class no member is true, whatever its verdict and what it reports beside."""
        true_names = {*self.hidden_names, *self.also_true}
        return tuple(effect.name for effect in self.named if true_names.isdisjoint(names_meant(effect)))

    @property
    def statements(self) -> list[Statement]:
        """What the diagnosis states with a probability, and whether it is true."""
        return statements(self.named, self.not_named, {*self.hidden_names, *self.also_true})

    @property
    def confidently_wrong(self) -> bool:
        """Whether anything is named that is not hidden; neither alternatives nor something unnamed excuse a name."""
        return bool(self.wrong_names)

    @property
    def hedged(self) -> bool:
        """Whether every wrong name has a hidden one among its alternatives: the report says that it may be that one."""
        hidden = set(self.hidden_names)
        return all(set(effect.alternatives) & hidden for effect in self.named if effect.name in self.wrong_names)

    @property
    def captures_right(self) -> bool:
        """Whether the captures that are left out are those, and all of those, that hidden effects alone change."""
        changed = {
            capture
            for effect in self.hidden
            if effect.name in EFFECTS
            for capture in EFFECTS[effect.name](**effect.parameters).captures
        }
        return set(self.bad_captures) == changed

    @property
    def stage_right(self) -> bool:
        """Whether the strongest of the unnamed deviations is reported in the stage of a hidden effect.

        Where a hidden effect changes single captures, it is as right to leave out exactly those.
        """
        if self.bad_captures and self.captures_right:
            return True
        return bool(self.unnamed) and self.unnamed_stages[0] in {f"unnamed:{effect.stage}" for effect in self.hidden}

    @property
    def right(self) -> bool:
        """Whether the diagnosis is as good as the suite's captures allow."""
        if self.bad_captures and not self.captures_right:
            return False
        if self.suite == "outside":
            return self.stage_right and not self.confidently_wrong
        if self.suite == "fewer":
            return not self.confidently_wrong
        if self.formulation == "rays":  # where more is wrong than has a name, and the verdict may say so
            return self.exact
        if self.datasheet in ("double", "half") and not self.hidden:
            return self.exact and not self.unnamed and self.verdict in ("consistent", "explained")
        return self.exact and not self.unnamed and self.verdict == ("explained" if self.hidden else "consistent")

    @property
    def closed(self) -> float:
        """Part of chi2's excess over 1 that the named effects remove, at most 1."""
        return 1 - max(self.chi2_after - 1, 0) / max(self.chi2_before - 1, 1e-9)

    @property
    def errors(self) -> list[tuple[str, float]]:
        """``effect.parameter`` and (estimate - truth) / std of every continuous parameter of rightly named effects."""
        truth = {effect.name: effect.parameters for effect in self.hidden}
        errors = []
        for effect in self.named:
            if effect.name not in truth:
                continue
            for name, parameter in EFFECTS[effect.name].parameters().items():
                if parameter.choices or parameter.integer:
                    continue
                estimate = effect.parameters[name]
                error, std = float(estimate.value) - float(truth[effect.name][name]), estimate.std
                if parameter.unit == "rad":
                    error = math.remainder(error, 2 * math.pi)
                errors.append((f"{effect.name}.{name}", error / std if std else math.copysign(math.inf, error)))
        return errors

    def __str__(self) -> str:
        """The outcome in a line: hidden effects, the diagnosis where it differs, and chi2 before and after."""
        hidden, reported = (" + ".join(names) or "nothing" for names in (self.hidden_names, self.answers))
        names = hidden if self.exact and not self.unnamed else f"{hidden} -> {reported}"
        if self.exact and not self.right and self.suite not in ("outside", "fewer"):
            names += f", {self.verdict}"
        where = f"{self.mask}, {self.bit_depth} bits"
        where += "" if self.frames == 8 else f", {self.frames} slots"
        where += "" if self.datasheet == "stated" else f", datasheet {self.datasheet}"
        where += "" if self.formulation == "overlap" else f", {self.formulation}"
        if self.captures != "full":
            where += f", {self.captures}"
        return f"{names} ({where}; chi2 {self.chi2_before:.4g} to {self.chi2_after:.4g}, {self.seconds:.0f} s)"


def names_meant(effect: NamedEffect) -> set[str]:
    """Return the names of an effect's class that are not improbable."""
    return {effect.name, *(name for name, share in effect.shares.items() if share >= MIN_CLASS_SHARE)}


def _known_scenes(gap: Gap | BlindGap) -> Gap:
    if isinstance(gap, BlindGap):
        raise ValueError("the gap of a blind diagnosis, which has no chi2")
    return gap
