"""The outcome of a case: what was hidden beside what was named, and whether the diagnosis was right."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sci_lightning.diagnosis.verdict import NEGLIGIBLE
from sci_lightning.virtual_camera import EFFECTS

LEFT_OUT = "left out"
"""What stands among the answers of a diagnosis that left captures out."""


@dataclass(frozen=True)
class HiddenEffect:
    """An effect that was hidden in the virtual camera.

    Attributes:
        name: of the effect.
        stage: where it acts on the light.
        parameters: true values by name.
        gain: log-likelihood that the effect gains beside the others by the virtual camera's own model, nats.
    """

    name: str
    stage: str
    parameters: Mapping[str, float | str]
    gain: float


@dataclass(frozen=True)
class NamedEffect:
    """An effect that the diagnosis named.

    Attributes:
        name: of the effect.
        estimates: value and standard deviation of every parameter by name.
        alternatives: names that the captures cannot tell from this one.
    """

    name: str
    estimates: Mapping[str, tuple[float | str, float]]
    alternatives: tuple[str, ...]


@dataclass(frozen=True)
class Failure:
    """A case that did not come to an end.

    Attributes:
        case: its name.
        suite: the suite that it belongs to.
        reason: why it failed, in one line.
        mask: kind of the mask.
        formulation: of the virtual camera.
    """

    case: str
    suite: str
    reason: str
    mask: str = ""
    formulation: str = "overlap"

    def __str__(self) -> str:
        return f"{self.case}: {self.reason}"


@dataclass(frozen=True)
class Outcome:
    """A case that came to an end, with the truth beside the diagnosis.

    Attributes:
        case: its name.
        digest: digest of its settings, empty if the record has none.
        suite: the suite that it belongs to.
        mask: kind of the mask.
        bit_depth: bits of the converter.
        size: (H, W) in pixels.
        frames: T, slots of a capture.
        datasheet: what the file says of the noise: ``stated``, ``silent``, ``double`` or ``half``.
        formulation: of the virtual camera: ``overlap`` or ``rays``.
        captures: name of the set of captures.
        hidden: the hidden effects, in the order of the light.
        also_true: names that are right though nothing of the kind was hidden, such as noise beside a wrong datasheet.
        named: the effects that the diagnosis named, in the order of the light.
        unnamed: ``unnamed:<stage>`` of the deviations that no name explains, the strongest first.
        bad_captures: indices of captures that the diagnosis left out because they contradict the others.
        verdict: of the diagnosis.
        chi2_before: held-out reduced chi2 of the ideal camera.
        chi2_after: held-out reduced chi2 with everything that was named.
        verified_chi2: reduced chi2 with everything that was named, on captures that nothing has seen; that of held-out
            pixels where no capture was kept for it.
        chi2_limit: what ``verified_chi2`` may be by chance; more than 1.05 only where there are few pixels.
        seconds: time of the diagnosis.
        cpu_seconds: the same in seconds of a processor.
        memory_mib: peak of the resident memory.
        total_cpu_seconds: processor time of the whole case, captures and comparison with the truth included.
        machine, date, commit: where, when and with which version of the program it was run; empty if not recorded.
    """

    case: str
    digest: str
    suite: str
    mask: str
    bit_depth: int
    size: tuple[int, int]
    frames: int
    datasheet: str
    formulation: str
    captures: str
    hidden: tuple[HiddenEffect, ...]
    also_true: tuple[str, ...]
    named: tuple[NamedEffect, ...]
    unnamed: tuple[str, ...]
    bad_captures: tuple[int, ...]
    verdict: str
    chi2_before: float
    chi2_after: float
    verified_chi2: float
    chi2_limit: float
    seconds: float
    cpu_seconds: float
    memory_mib: float
    total_cpu_seconds: float
    machine: str
    date: str
    commit: str

    @property
    def hidden_names(self) -> tuple[str, ...]:
        """Names of the hidden effects."""
        return tuple(effect.name for effect in self.hidden)

    @property
    def answers(self) -> tuple[str, ...]:
        """Everything that the diagnosis reports: names, ``unnamed:<stage>``, and whether it left captures out."""
        left_out = (LEFT_OUT,) if self.bad_captures else ()
        return (*(effect.name for effect in self.named), *self.unnamed, *left_out)

    @property
    def exact(self) -> bool:
        """Whether the diagnosis named the hidden effects and no others, except those that are true as well."""
        return {effect.name for effect in self.named} - (set(self.also_true) - set(self.hidden_names)) == set(
            self.hidden_names
        )

    @property
    def smallest_gain(self) -> float:
        """Log-likelihood in nats that the faintest of the hidden effects gains beside the others."""
        return min((effect.gain for effect in self.hidden), default=math.inf)

    @property
    def wrong_names(self) -> tuple[str, ...]:
        """Names in the diagnosis that are not true, whatever its verdict and whatever it reports beside them."""
        true_names = {*self.hidden_names, *self.also_true}
        return tuple(effect.name for effect in self.named if effect.name not in true_names)

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
        return bool(self.unnamed) and self.unnamed[0] in {f"unnamed:{effect.stage}" for effect in self.hidden}

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
                value, std = effect.estimates[name]
                error = float(value) - float(truth[effect.name][name])
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


def parse_record(record: Mapping[str, Any]) -> Outcome | Failure:
    """Read a record as :func:`~.trial.run_trial` or :func:`~.worker_processes.run_cases` return it.

    Raises:
        ValueError: the record is of another format.
        KeyError: a field is missing.
    """
    if record["format"] != "sci-proving-ground-case" or record["format_version"] != 1:
        raise ValueError(f"format {record['format']}, expected sci-proving-ground-case, format_version 1")
    if "failed" in record:
        mask, formulation = record.get("mask", ""), record.get("formulation", "overlap")
        return Failure(record["case"], record["suite"], record["failed"], mask, formulation)
    before, after = record["gap"]["before"], record["gap"]["after"]
    verified = record.get("verification", {})
    judged = verified if "chi2" in verified else after
    height, width = record["size"]
    return Outcome(
        case=record["case"],
        digest=record.get("digest", ""),
        suite=record["suite"],
        mask=record["mask"],
        bit_depth=record["bit_depth"],
        size=(height, width),
        frames=record["frames"],
        datasheet=record.get("datasheet", "stated"),
        formulation=record.get("formulation", "overlap"),
        captures=record["captures"],
        hidden=tuple(
            HiddenEffect(effect["name"], effect["stage"], effect["parameters"], float(effect["log_likelihood_gain"]))
            for effect in record["hidden"]
        ),
        also_true=tuple(record.get("also_true", ())),
        named=tuple(
            NamedEffect(
                effect["name"],
                {name: (value["value"], float(value["std"])) for name, value in effect["parameters"].items()},
                tuple(effect["alternatives"]),
            )
            for effect in record["found"]
        ),
        unnamed=_stages(record["unnamed"]),
        bad_captures=tuple(record.get("bad_captures", ())),
        verdict=record["verdict"],
        chi2_before=float(before["chi2"]),
        chi2_after=float(after["chi2"]),
        verified_chi2=float(judged["chi2"]),
        chi2_limit=float(judged.get("chi2_limit", NEGLIGIBLE)),
        seconds=float(record["seconds"]),
        cpu_seconds=float(record["cpu_seconds"]),
        memory_mib=float(record["memory_mib"]),
        total_cpu_seconds=float(record.get("total_cpu_seconds", record["cpu_seconds"])),
        **{key: str(record.get("provenance", {}).get(key, "")) for key in ("machine", "date", "commit")},
    )


def _stages(unnamed: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Return ``unnamed:<stage>`` of every stage, in the order of the log-likelihood that its deviations gain."""
    ordered = sorted(unnamed, key=lambda deviation: -float(deviation.get("nats", 0)))
    return tuple(dict.fromkeys(f"unnamed:{deviation['stage']}" for deviation in ordered))
