"""Where the figures of a table come from, if several runs made them."""

from __future__ import annotations

from itertools import permutations

from sci_lightning.runs.provenance import Provenance, joined


def made(machine: str, commit: str, date: str = "2026-11-23") -> Provenance:
    command = f"python -m sci_lightning.mismatch {commit}"
    return Provenance(machine=machine, date=date, commit=commit, scale="64 x 64", seeds="0", command=command)


def test_each_machine_and_command_is_named_once() -> None:
    """A record that was completed three times names its machines and commands once: its texts stay short."""
    old, new = made("one core, A, x86_64", "1111"), made("one core, B, x86_64", "2222", "2026-11-24")
    twice = joined([joined([old, new]), new, old])
    assert twice == joined([old, new])
    assert twice.machine == "one core, A, x86_64 | one core, B, x86_64" and twice.commit == "1111, 2222"
    assert twice.date == "2026-11-23 to 2026-11-24" and twice.command.count("python") == 2
    assert joined([new, joined([old, new])]) == twice
    assert joined([made("8 cores", "1"), made("28 cores", "2")]).machine == "8 cores | 28 cores"


def test_order_of_the_runs_does_not_matter() -> None:
    """Every checkout lists files in another order, and a table must say the same in all of them."""
    runs = [made("A", "3333"), made("B", "1111", "2026-11-24"), made("A", "2222", "2026-11-24"), made("B", "3333")]
    assert {joined(order) for order in permutations(runs)} == {joined(runs)}
    assert joined(runs).commit == "3333, 1111, 2222"


def test_sentence_tells_machines_and_commands_apart() -> None:
    sentence = joined([made("one core, A", "1111"), made("one core, B", "2222")]).sentence()
    assert sentence.startswith("one core, A and one core, B; 2026-11-23; commit 1111, 2222; scale: 64 x 64; seeds: 0.")
    assert sentence.endswith(
        "Made by `python -m sci_lightning.mismatch 1111` and `python -m sci_lightning.mismatch 2222`."
    )
