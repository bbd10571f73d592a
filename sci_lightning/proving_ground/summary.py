"""The proving ground's table: what was reached, beside what is to be reached."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from sci_lightning.diagnosis.verdict import NEGLIGIBLE
from sci_lightning.proving_ground.outcome import Outcome
from sci_lightning.proving_ground.proportion import NORMAL, Proportion

CLOSED = 0.95
"""Part of chi2's excess that should be gone."""
APART = 1.5
"""Reduced chi2 from which on its excess is asked about; of a smaller one, chi2's own noise is more than the 5 %."""
FAINT = 30.0
"""Nats below which nobody is asked to see an effect, beside others or by itself."""
WEAK = 100.0
"""Nats up to which an effect is called weak."""
NAMES = (
    ("single", "single effect, clear: its name and no other", 0.98),
    ("weak", "single effect, weak (30 to 100 nats): its name and no other", 0.9),
    ("pair", "pairs: exact set of names", 0.95),
    ("triple", "triples: exact set of names", 0.9),
)
"""Suites in which exactly the hidden names are to be found, and in what share of the cases at least."""
SECONDS = {(128, 128): 60.0, (256, 256): 300.0}
"""Allowed for a session of 34 captures of 8 slots, on two cores."""
MEMORY = 4096.0
"""MiB allowed."""


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        what: is measured.
        found: in words.
        target: in words; empty where there is none.
        met: whether the figure itself reaches the target (its interval is in ``found``); None without cases or target.
        proportion: behind it, where it is one.
        missed: the cases that count against it, a line each.
    """

    what: str
    found: str
    target: str = ""
    met: bool | None = None
    proportion: Proportion | None = None
    missed: tuple[str, ...] = ()


def sum_up(records: Iterable[Mapping[str, Any]]) -> list[Row]:
    """The table of records; where a right answer is asked for, a case that failed has not given it."""
    listed = list(records)
    failed = [each for each in listed if "failed" in each]
    outcomes = [Outcome(each) for each in listed if "failed" not in each]
    suite = {name: [each for each in outcomes if each.suite == name] for name in {each.suite for each in outcomes}}

    def cases(name: str) -> list[Outcome]:
        return suite.get(name, [])

    def lost(name: str) -> list[str]:
        return [f"{each['case']} failed" for each in failed if each["suite"] == name]

    asked = {
        name: [each for each in cases(name) if FAINT <= each.nats <= (WEAK if name == "weak" else math.inf)]
        for name, _, _ in NAMES
    }
    named = [each for name in ("single", "weak", "pair", "triple") for each in cases(name)]
    explained = [each for each in named if each.record["verdict"] == "explained"]
    apart = [each for each in named if each.chi2[0] > APART]
    rows = [
        *(
            _share(what, asked[name], _exact, lost(name), least=least, beside=len(cases(name)) - len(asked[name]))
            for name, what, least in NAMES
        ),
        *(
            _share(
                f"nothing hidden, {mask} mask: false alarms",
                [each for each in cases("nothing") if each.record["mask"] == mask],
                lambda each: each.record["verdict"] != "consistent",
                most=0.02,
            )
            for mask in ("structural", "binary")
        ),
        _share(
            "right names, yet something unnamed",
            list(filter(_exact, named)),
            lambda each: bool(each.unnamed),
            most=0.02,
        ),
        _share("outside the vocabulary: confident wrong name", cases("outside"), _wrong, most=0.05),
        _share(
            "outside the vocabulary: right stage",
            cases("outside"),
            lambda each: each.stage_right,
            lost("outside"),
            least=0.8,
        ),
        _share("fewer captures: confident wrong name", cases("fewer"), _wrong, most=0.0),
        _intervals([*named, *cases("fewer")]),
        _share(
            f"explained: held-out chi2 at most {NEGLIGIBLE}",
            explained,
            lambda each: each.chi2[1] <= each.chi2_limit,
            least=1.0,
        ),
        _gap(apart),
        *_times(outcomes),
        _memory(outcomes),
    ]
    missed = tuple(f"{each['case']}: {each['failed']}" for each in failed)
    return [*rows, Row("cases that failed", f"{len(failed)} of {len(listed)}", "0", not failed, None, missed)]


def _exact(outcome: Outcome) -> bool:
    return outcome.exact


def _wrong(outcome: Outcome) -> bool:
    return outcome.confidently_wrong


def _share(
    what: str,
    outcomes: Sequence[Outcome],
    answer: Callable[[Outcome], bool],
    lost: Sequence[str] = (),
    *,
    least: float | None = None,
    most: float | None = None,
    beside: int = 0,
) -> Row:
    """How often the answer is yes, ``lost`` being cases without one; the target is ``least`` or else ``most``.

    ``beside`` is how many cases of the suite are not asked, being fainter or stronger than the suite's name promises.
    """
    found = Proportion(sum(map(answer, outcomes)), len(outcomes) + len(lost))
    target = f"at least {least:.0%}" if least is not None else f"at most {most:.0%}"
    if not found.total:
        return Row(what, "no cases", target, None, found)
    met = found.share >= least if least is not None else found.share <= (most or 0.0)
    missed = tuple(str(each) for each in outcomes if answer(each) is (least is None))
    words = _words(found) + (f"; {beside} not asked: too faint or too strong" if beside else "")
    return Row(what, words, target, met, found, (*missed, *lost))


def _words(found: Proportion) -> str:
    low, high = found.interval
    return f"{found.share:.1%} ({found.count} of {found.total}; {low:.0%} to {high:.0%})"


def _intervals(outcomes: Sequence[Outcome]) -> Row:
    errors = [(name, error, str(each)) for each in outcomes for name, error in each.errors]
    found = Proportion.of(abs(error) <= NORMAL for _, error, _ in errors)
    what, target = "95 % intervals that hold the truth", "90 % to 99 %"
    if not errors:
        return Row(what, "no cases", target, None, found)
    missed = tuple(f"{name} {error:+.1f} std: {said}" for name, error, said in errors if abs(error) > NORMAL)
    # of few parameters all may hold the truth, though one in a hundred should not
    met = found.share >= 0.9 and found.interval[0] <= 0.99
    spread = math.sqrt(sum(error**2 for _, error, _ in errors) / len(errors))
    words = f"{_words(found)}; errors of {spread:.2f} stated standard deviations, root mean square"
    return Row(what, words, target, met, found, missed)


def _gap(outcomes: Sequence[Outcome]) -> Row:
    row = _share(
        f"{CLOSED:.0%} of chi2's excess closed (where it was above {APART})",
        outcomes,
        lambda each: each.closed >= CLOSED,
        least=1.0,
    )
    if not outcomes:
        return row
    found = f"{row.found}; median {median(each.closed for each in outcomes):.1%} closed"
    return Row(row.what, found, row.target, row.met, row.proportion, row.missed)


def _times(outcomes: Sequence[Outcome]) -> list[Row]:
    rows = []
    for size in sorted({tuple(each.record["size"]) for each in outcomes}):
        some = [each for each in outcomes if tuple(each.record["size"]) == size]
        seconds = [float(each.record["seconds"]) for each in some]
        allowed = SECONDS.get(size)
        rows.append(
            Row(
                f"time, {size[0]} x {size[1]}",
                f"median {median(seconds):.1f} s, longest {max(seconds):.1f} s ({len(seconds)} cases; "
                f"median {median(float(each.record['cpu_seconds']) for each in some):.1f} s of a processor)",
                f"at most {allowed:.0f} s" if allowed else "",
                max(seconds) <= allowed if allowed else None,
                None,
                tuple(str(each) for each in some if allowed and float(each.record["seconds"]) > allowed),
            )
        )
    return rows


def _memory(outcomes: Sequence[Outcome]) -> Row:
    most = max((float(each.record["memory_mib"]) for each in outcomes), default=0.0)
    return Row("memory", f"at most {most:.0f} MiB", f"below {MEMORY:.0f} MiB", most < MEMORY if outcomes else None)
