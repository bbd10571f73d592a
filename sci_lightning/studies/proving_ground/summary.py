"""The table of the proving ground: what the diagnoses reached, beside what they are to reach."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from statistics import median

from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.studies.engine import FailedCase
from sci_lightning.studies.proving_ground.outcome import Outcome
from sci_lightning.studies.proving_ground.reliability import NORMAL, Proportion, reliability

EXACT_SUITES = (
    ("single", "single effect, clear: its name and no other, explained", 0.98),
    ("weak", "single effect, weak (30 to 100 nats): its name and no other, explained", 0.9),
    ("pair", "pairs: exact set of names, explained", 0.95),
    ("triple", "triples: exact set of names, explained", 0.9),
)
"""Suites in which exactly the hidden effects are to be named: suite, row of the table, smallest share of the cases."""
ASKED = (*(suite for suite, _, _ in EXACT_SUITES), "nothing", "outside")
"""Suites in which there is a right answer."""
LATER = "effects that got a name later, alone: its name and no other, explained"
"""The row of the suite ``later``, which the first records do not have."""
VISIBLE_GAIN = 30.0
"""Log-likelihood gain in nats below which no diagnosis is expected to see an effect."""
WEAK_GAIN = 100.0
"""Log-likelihood gain in nats up to which an effect counts as weak."""
CLOSED_SHARE = 0.95
"""Part of chi2's excess over 1 that the named effects are to remove."""
CLOSABLE_CHI2 = 1.5
"""Reduced chi2 above which that part is computed; nearer to 1, chi2's own noise is more than 5 % of its excess."""
CERTAIN = 0.95
"""Probability from which a name counts as certain."""
SECONDS = {(128, 128): 60.0, (256, 256): 300.0}
"""Time allowed for a session of 34 captures of 8 slots on two cores, by size."""
MEMORY = 4096.0
"""Memory allowed, MiB."""


@dataclass(frozen=True)
class SuiteScore:
    """One line of the table.

    Attributes:
        what: what is measured.
        figure: the figure, in words.
        target: the target, in words; empty where there is none.
        met: whether the figure itself reaches the target (its interval is in ``figure``); None without cases or target.
        proportion: the proportion that the figure is, where it is one.
        missed: the cases that count against the row, a line each.
    """

    what: str
    figure: str
    target: str = ""
    met: bool | None = None
    proportion: Proportion | None = None
    missed: tuple[str, ...] = ()


def summarise(records: Iterable[Outcome | FailedCase]) -> list[SuiteScore]:
    """Return the rows of the table. Where a right answer is expected, a failed case counts as a wrong one."""
    records = list(records)
    failures = [record for record in records if isinstance(record, FailedCase)]
    lost = [failure for failure in failures if failure.about["formulation"] == "overlap"]
    every = [record for record in records if isinstance(record, Outcome)]
    outcomes = [outcome for outcome in every if outcome.formulation == "overlap"]
    named = [outcome for suite, _, _ in EXACT_SUITES for outcome in of_suite(outcomes, suite)]
    fewer, outside = of_suite(outcomes, "fewer"), of_suite(outcomes, "outside")
    return [
        *(exact_names(outcomes, lost, suite, what, least) for suite, what, least in EXACT_SUITES),
        *(exact_names(outcomes, lost, "later", LATER, 0.95) for _ in of_suite(outcomes, "later")[:1]),
        *(false_alarms(outcomes, lost, mask) for mask in ("structural", "binary")),
        at_most("right names, yet something unnamed", [o for o in named if o.exact], lambda o: bool(o.unnamed), 0.02),
        wrong_names("any wrong name", named, 0.05),
        wrong_names("outside the vocabulary: any wrong name", outside, 0.05),
        at_least(
            "outside the vocabulary: strongest unnamed deviation in the right stage",
            outside,
            lambda o: o.stage_right,
            0.8,
            failed(lost, "outside"),
        ),
        wrong_names("fewer captures: any wrong name", fewer, 0.0),
        *certain_names(every),
        *reliable_names(every),
        interval_coverage([*named, *fewer]),
        at_least(
            f"right names: chi2 on verification captures at most {SearchSettings.negligible_chi2}",
            [outcome for outcome in named if outcome.exact],
            lambda o: o.verified_chi2 <= o.chi2_limit,
            0.95,
        ),
        closed_gap(named),
        *by_setting(outcomes),
        *with_rays(
            [outcome for outcome in every if outcome.formulation == "rays"],
            [failure for failure in failures if failure.about["formulation"] == "rays"],
        ),
        *times(every),
        memory(every),
        total_time(every),
        SuiteScore(
            "cases that failed",
            f"{len(failures)} of {len(records)}",
            "0",
            not failures,
            missed=tuple(map(str, failures)),
        ),
    ]


def by_setting(outcomes: Sequence[Outcome]) -> list[SuiteScore]:
    """How often a diagnosis is right for every number of slots, bit depth and datasheet, where there are several."""
    settings: dict[str, Callable[[Outcome], int | str]] = {
        "slots": lambda outcome: outcome.frames,
        "bits": lambda outcome: outcome.bit_depth,
        "datasheet": lambda outcome: outcome.datasheet,
    }
    rows = []
    for name, setting in settings.items():
        values = {setting(outcome) for outcome in outcomes}
        for value in sorted(values, key=lambda value: (isinstance(value, str), value)) if len(values) > 1 else ():
            cases = [o for o in outcomes if setting(o) == value and o.suite in ASKED and visible(o)]
            proportion = Proportion.of(outcome.right for outcome in cases)
            what = f"{name} {value}" if name == "datasheet" else f"{value} {name}"
            missed = tuple(str(outcome) for outcome in cases if not outcome.right)
            if cases:
                rows.append(SuiteScore(f"{what}: right", in_words(proportion), proportion=proportion, missed=missed))
    return rows


def with_rays(outcomes: Sequence[Outcome], failures: Sequence[FailedCase]) -> list[SuiteScore]:
    """What diagnoses say of the imperfect set-up whose light is sampled by rays."""
    if not outcomes and not failures:
        return []
    hidden = [outcome for suite, _, _ in EXACT_SUITES for outcome in of_suite(outcomes, suite) if visible(outcome)]
    nothing = of_suite(outcomes, "nothing")
    shown = Proportion.of(outcome.verdict not in ("consistent", "explained") for outcome in outcomes)
    any_name = Proportion.of(bool(outcome.named) for outcome in nothing)
    missing = [line for suite, _, _ in EXACT_SUITES for line in failed(failures, suite)]
    rows = [
        wrong_names("rays, nothing hidden: any name but that of its pixels' own PRNU", nothing, 0.05),
        at_least("rays: the hidden effects are named, and no others", hidden, lambda o: o.exact, 0.95, missing),
        wrong_names("rays: any wrong name", hidden, 0.05),
        SuiteScore("rays: the verdict says that something is unexplained", in_words(shown), proportion=shown),
    ]
    if nothing:
        rows.insert(1, SuiteScore("rays, nothing hidden: any name", in_words(any_name), proportion=any_name))
    return rows


def visible(outcome: Outcome) -> bool:
    """Whether the captures speak clearly enough for every hidden effect that a diagnosis is expected to see it."""
    return outcome.smallest_gain >= VISIBLE_GAIN


def of_suite(outcomes: Iterable[Outcome], suite: str) -> list[Outcome]:
    """Return the outcomes of one suite."""
    return [outcome for outcome in outcomes if outcome.suite == suite]


def failed(failures: Iterable[FailedCase], suite: str) -> list[str]:
    """Return a line for each failed case of one suite."""
    return [f"{failure.case} failed" for failure in failures if failure.about["suite"] == suite]


def exact_names(
    outcomes: Sequence[Outcome], failures: Sequence[FailedCase], suite: str, what: str, least: float
) -> SuiteScore:
    """How often exactly the hidden effects explain the captures, of those that are as strong as the suite promises."""
    cases = of_suite(outcomes, suite)
    strongest = WEAK_GAIN if suite == "weak" else math.inf
    counted = [outcome for outcome in cases if VISIBLE_GAIN <= outcome.smallest_gain <= strongest]
    row = at_least(what, counted, lambda outcome: outcome.right, least, failed(failures, suite))
    if not (left_out := len(cases) - len(counted)) or not (row.proportion and row.proportion.total):
        return row
    return replace(row, figure=f"{row.figure}; {left_out} not asked: too faint or too strong")


def false_alarms(outcomes: Sequence[Outcome], failures: Sequence[FailedCase], mask: str) -> SuiteScore:
    """How often something was found though nothing was hidden, behind one kind of mask; noise that is not as the file
    says is no false alarm."""
    cases = [outcome for outcome in of_suite(outcomes, "nothing") if outcome.mask == mask]
    what = f"nothing hidden, {mask} mask: false alarms"
    no_answer = failed([failure for failure in failures if failure.about["mask"] == mask], "nothing")
    return at_most(what, cases, lambda outcome: not outcome.right, 0.02, no_answer)


def at_least(
    what: str,
    outcomes: Sequence[Outcome],
    right: Callable[[Outcome], bool],
    least: float,
    failed_cases: Sequence[str] = (),
) -> SuiteScore:
    """Return a row for a share of right answers that is to be ``least`` or more; failed cases gave none."""
    target = f"at least {least:.0%}"
    proportion = Proportion(sum(map(right, outcomes)), len(outcomes) + len(failed_cases))
    if not proportion.total:
        return SuiteScore(what, "no cases", target, None, proportion)
    missed = (*(str(outcome) for outcome in outcomes if not right(outcome)), *failed_cases)
    return SuiteScore(what, in_words(proportion), target, proportion.share >= least, proportion, missed)


def at_most(
    what: str,
    outcomes: Sequence[Outcome],
    wrong: Callable[[Outcome], bool],
    most: float,
    failed_cases: Sequence[str] = (),
) -> SuiteScore:
    """Return a row for a share of wrong answers that is to be ``most`` or less; failed cases count as wrong."""
    target = f"at most {most:.0%}"
    proportion = Proportion(sum(map(wrong, outcomes)) + len(failed_cases), len(outcomes) + len(failed_cases))
    if not proportion.total:
        return SuiteScore(what, "no cases", target, None, proportion)
    missed = (*(str(outcome) for outcome in outcomes if wrong(outcome)), *failed_cases)
    return SuiteScore(what, in_words(proportion), target, proportion.share <= most, proportion, missed)


def wrong_names(what: str, outcomes: Sequence[Outcome], most: float) -> SuiteScore:
    """Return how often something was named that is not hidden, and how often the report itself named the hidden one."""
    row = at_most(what, outcomes, lambda outcome: outcome.confidently_wrong, most)
    if not (hedged := sum(outcome.confidently_wrong and outcome.hedged for outcome in outcomes)):
        return row
    return replace(row, figure=f"{row.figure}; {hedged} of them have the hidden effect among their alternatives")


def certain_names(outcomes: Sequence[Outcome]) -> list[SuiteScore]:
    """How often a name that is stated with near certainty is right, in every suite and every world."""
    what, target = f"names with a probability of at least {CERTAIN}: right", "at least 97%"
    stated = [
        (effect.name not in outcome.wrong_names, f"{effect.name}: {outcome}")
        for outcome in outcomes
        for effect in outcome.named
        if (effect.probability or 0.0) >= CERTAIN
    ]
    proportion = Proportion.of(right for right, _ in stated)
    missed = tuple(line for right, line in stated if not right)
    row = SuiteScore(what, in_words(proportion), target, proportion.share >= 0.97, proportion, missed)
    return [row] if stated else []  # records of earlier versions state none


def reliable_names(outcomes: Sequence[Outcome]) -> list[SuiteScore]:
    """How many of the effects that are stated with some probability are there, a row for every range."""
    stated = [one for outcome in outcomes for one in outcome.statements]
    return [
        SuiteScore(
            f"stated with a probability of {row.low:g} to {row.high:g}, {row.stated:.3f} on average: true",
            in_words(row.true),
            proportion=row.true,
        )
        for row in reliability(stated)
    ]


def in_words(proportion: Proportion) -> str:
    """Return the share in per cent with its counts and its interval."""
    low, high = proportion.interval
    return f"{proportion.share:.1%} ({proportion.count} of {proportion.total}; {low:.0%} to {high:.0%})"


def interval_coverage(outcomes: Sequence[Outcome]) -> SuiteScore:
    """How often the 95 % intervals of the estimated parameters contain the true values."""
    errors = [(name, error, str(outcome)) for outcome in outcomes for name, error in outcome.errors]
    proportion = Proportion.of(abs(error) <= NORMAL for _, error, _ in errors)
    what, target = "95 % intervals that hold the truth", "90 % to 99 %"
    if not errors:
        return SuiteScore(what, "no cases", target, None, proportion)
    missed = tuple(f"{name} {error:+.1f} std: {case}" for name, error, case in errors if abs(error) > NORMAL)
    # Among few parameters, all intervals may contain the truth, although one in a hundred should not.
    met = proportion.share >= 0.9 and proportion.interval[0] <= 0.99
    rms = math.sqrt(sum(error**2 for _, error, _ in errors) / len(errors))
    figure = f"{in_words(proportion)}; errors of {rms:.2f} stated standard deviations, root mean square"
    return SuiteScore(what, figure, target, met, proportion, missed)


def closed_gap(outcomes: Iterable[Outcome]) -> SuiteScore:
    """How often the named effects remove nearly all of chi2's excess over 1."""
    counted = [outcome for outcome in outcomes if outcome.chi2_before > CLOSABLE_CHI2]
    what = f"{CLOSED_SHARE:.0%} of chi2's excess closed (where it was above {CLOSABLE_CHI2})"
    row = at_least(what, counted, lambda outcome: outcome.closed >= CLOSED_SHARE, 1.0)
    if not counted:
        return row
    return replace(row, figure=f"{row.figure}; median {median(outcome.closed for outcome in counted):.1%} closed")


def times(outcomes: Sequence[Outcome]) -> list[SuiteScore]:
    """How long the diagnoses took, a row for every size."""
    rows = []
    for size in sorted({outcome.size for outcome in outcomes}):
        cases = [outcome for outcome in outcomes if outcome.size == size]
        longest, allowed = max(outcome.seconds for outcome in cases), SECONDS.get(size)
        rows.append(
            SuiteScore(
                f"time, {size[0]} x {size[1]}",
                f"median {median(outcome.seconds for outcome in cases):.1f} s, longest {longest:.1f} s ({len(cases)} "
                f"cases; median {median(outcome.cpu_seconds for outcome in cases):.1f} s of a processor)",
                f"at most {allowed:.0f} s" if allowed else "",
                longest <= allowed if allowed else None,
                missed=tuple(str(outcome) for outcome in cases if allowed and outcome.seconds > allowed),
            )
        )
    return rows


def total_time(outcomes: Sequence[Outcome]) -> SuiteScore:
    """The processor time of all cases, captures and comparison with the truth included."""
    hours = sum(outcome.total_cpu_seconds or outcome.cpu_seconds for outcome in outcomes) / 3600
    return SuiteScore("processor time of all cases", f"{hours:.2f} hours of one core for {len(outcomes)} cases")


def memory(outcomes: Sequence[Outcome]) -> SuiteScore:
    """The largest memory that a diagnosis took."""
    most = max((outcome.memory_mib for outcome in outcomes), default=0.0)
    return SuiteScore(
        "memory", f"at most {most:.0f} MiB", f"below {MEMORY:.0f} MiB", most < MEMORY if outcomes else None
    )
