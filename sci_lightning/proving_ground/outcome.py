"""Judging one record: were the right names found, and do the intervals hold the truth?"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sci_lightning.diagnosis.verdict import NEGLIGIBLE
from sci_lightning.virtual_camera import EFFECTS


@dataclass(frozen=True)
class Outcome:
    """A record of a case that came to an end, seen with the truth beside it.

    Attributes:
        record: as :func:`~sci_lightning.proving_ground.trial.attempt` gives it.
    """

    record: Mapping[str, Any]

    @property
    def suite(self) -> str:
        """What it belongs to."""
        return str(self.record["suite"])

    @property
    def hidden(self) -> tuple[str, ...]:
        """Names, in the order of the light."""
        return tuple(each["name"] for each in self.record["hidden"])

    @property
    def found(self) -> tuple[str, ...]:
        """Names, in the order of the light."""
        return tuple(each["name"] for each in self.record["found"])

    @property
    def unnamed(self) -> tuple[str, ...]:
        """``unnamed:<stage>`` of what no name explains."""
        return tuple(dict.fromkeys(f"unnamed:{each['stage']}" for each in self.record["unnamed"]))

    @property
    def exact(self) -> bool:
        """The names that are hidden, and no others."""
        return set(self.found) == set(self.hidden)

    @property
    def nats(self) -> float:
        """What the faintest of the hidden effects gains beside the others, by the virtual camera's own likelihood."""
        return min((float(each["log_likelihood_gain"]) for each in self.record["hidden"]), default=math.inf)

    @property
    def confidently_wrong(self) -> bool:
        """``explained``, with nothing unnamed, by a name that is not hidden and admits of none that is."""
        named = [{each["name"], *each["alternatives"]} for each in self.record["found"]]
        wrong = any(not each & set(self.hidden) for each in named)
        return self.record["verdict"] == "explained" and not self.unnamed and wrong

    @property
    def stage_right(self) -> bool:
        """Something unnamed is reported in the stage of a hidden effect."""
        return any(f"unnamed:{each['stage']}" in self.unnamed for each in self.record["hidden"])

    @property
    def right(self) -> bool:
        """As good an answer as the captures allow."""
        if self.suite == "outside":
            return self.stage_right and not self.confidently_wrong
        return not self.confidently_wrong if self.suite == "fewer" else self.exact and not self.unnamed

    @property
    def chi2(self) -> tuple[float, float]:
        """Held-out reduced chi2 before and after."""
        return float(self.record["gap"]["before"]["chi2"]), float(self.record["gap"]["after"]["chi2"])

    @property
    def chi2_limit(self) -> float:
        """What held-out reduced chi2 may be afterwards: more than 1.05 only where few pixels were held out."""
        return float(self.record["gap"]["after"].get("chi2_limit", NEGLIGIBLE))

    @property
    def closed(self) -> float:
        """The part of chi2's excess over 1 that is gone; no more than all of it."""
        before, after = self.chi2
        return 1 - max(after - 1, 0) / max(before - 1, 1e-9)

    @property
    def errors(self) -> list[tuple[str, float]]:
        """``effect.parameter`` and (found - true) / std of every continuous parameter of effects rightly named."""
        hidden = {each["name"]: each["parameters"] for each in self.record["hidden"]}
        found = []
        for effect in self.record["found"]:
            if effect["name"] not in hidden:
                continue
            for name, about in EFFECTS[effect["name"]].parameters().items():
                if about.choices or about.integer:
                    continue
                value = effect["parameters"][name]
                error = float(value["value"]) - float(hidden[effect["name"]][name])
                if about.unit == "rad":
                    error = math.remainder(error, 2 * math.pi)
                std = float(value["std"])
                found.append((f"{effect['name']}.{name}", error / std if std else math.copysign(math.inf, error)))
        return found

    def __str__(self) -> str:
        """In a line: what was hidden, what was found, how far apart captures and model were and are."""
        hidden, found = (" + ".join(names) or "nothing" for names in (self.hidden, self.found + self.unnamed))
        before, after = self.chi2
        said = hidden if self.exact and not self.unnamed else f"{hidden} -> {found}"
        where = f"{self.record['mask']}, {self.record['bit_depth']} bits"
        if self.record["captures"] != "full":
            where += f", {self.record['captures']}"
        return f"{said} ({where}; chi2 {before:.4g} to {after:.4g}, {self.record['seconds']:.0f} s)"
