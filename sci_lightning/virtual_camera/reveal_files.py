"""The two files that ``reveal`` reads: the truth beside captures and the report of a diagnosis, of any origin."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from sci_lightning.errors import BadInput
from sci_lightning.files.bounded_file import read_bounded
from sci_lightning.virtual_camera.comparison import Estimate, Report, ReportedEffect
from sci_lightning.virtual_camera.hardware.parameter import Value
from sci_lightning.virtual_camera.truth import FORMAT, HiddenEffect

READABLE = {FORMAT: (1,), "sci-diagnosis": (1, 2)}
"""Versions of each format that can be read."""
MAX_BYTES = 8 * 2**20
"""The report of a diagnosis has some thousands of bytes."""
MAX_CHARACTERS = 200
MAX_ENTRIES = 1000
"""Effects, and parameters of one effect."""


@dataclass(frozen=True)
class Entry:
    """A value in a JSON file with its place, for reading it as an expected type or refusing it in one line."""

    place: str
    value: object

    def text(self) -> str:
        """Return a text of bounded length."""
        if not isinstance(self.value, str) or len(self.value) > MAX_CHARACTERS:
            raise self._refusal(f"a text of at most {MAX_CHARACTERS} characters")
        return self.value

    def number(self) -> float | int:
        """Return a finite number, whole ones as integers."""
        value = self.value
        if not isinstance(value, (int, float)) or isinstance(value, bool) or not abs(value) < 1e300:
            raise self._refusal("a finite number")
        return value

    def text_or_number(self) -> Value:
        """Return the value of a parameter."""
        return self.text() if isinstance(self.value, str) else self.number()

    def flag(self) -> bool:
        """Return a truth value."""
        if not isinstance(self.value, bool):
            raise self._refusal("true or false")
        return self.value

    def entries(self) -> list[Entry]:
        """Return the entries of a list."""
        if not isinstance(self.value, list) or len(self.value) > MAX_ENTRIES:
            raise self._refusal(f"a list of at most {MAX_ENTRIES}")
        return [Entry(f"{self.place}[{index}]", value) for index, value in enumerate(self.value)]

    def items(self) -> Iterator[tuple[str, Entry]]:
        """Yield the names and entries of an object whose names are not known beforehand."""
        if not isinstance(self.value, dict) or len(self.value) > MAX_ENTRIES:
            raise self._refusal(f"an object with at most {MAX_ENTRIES} entries")
        for name, value in self.value.items():
            yield Entry(f"{self.place}: a name", name).text(), Entry(f"{self.place}.{name}", value)

    def __getitem__(self, name: str) -> Entry:
        """Return one entry of an object."""
        if not isinstance(self.value, dict):
            raise self._refusal(f"an object with {name}")
        place = f"{self.place}.{name}".lstrip(".")
        if name not in self.value:
            raise BadInput(f"{place}: is missing")
        return Entry(place, self.value[name])

    def _refusal(self, expected: str) -> BadInput:
        return BadInput(f"{self.place}: expected {expected}")


def read_truth(path: str | Path) -> tuple[HiddenEffect, ...]:
    """Read the hidden effects from the ``<captures>.truth.json`` of a virtual camera.

    Raises:
        BadInput: no such file, or something else than a truth of format version 1.
    """
    path = Path(path)
    content = _read_json(path, FORMAT)
    try:
        return tuple(_hidden_effect(entry) for entry in content["effects"].entries())
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from error


def read_also_true(path: str | Path) -> tuple[str, ...]:
    """Read from a ``<captures>.truth.json`` which names are right though nothing of the kind was hidden.

    Raises:
        BadInput: see :func:`read_truth`.
    """
    path = Path(path)
    content = _read_json(path, FORMAT)
    if not isinstance(content.value, dict) or "also_true" not in content.value:
        return ()
    try:
        return tuple(entry.text() for entry in content["also_true"].entries())
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from error


def read_report(path: str | Path) -> Report:
    """Read the ``report.json`` of a diagnosis.

    Raises:
        BadInput: no such file, or something else than a report of format version 1 or 2.
    """
    path = Path(path)
    content = _read_json(path, "sci-diagnosis")
    try:
        named = content["effects"].entries()
        if content["format_version"].number() > 1:
            named = content["laboratory"].entries() + named
        return Report(
            effects=tuple(_reported_effect(entry) for entry in named),
            unnamed_stages=tuple(entry["stage"].text() for entry in content["unnamed"].entries()),
            chi2_before=content["gap"]["before"]["chi2"].number(),
            chi2_after=content["gap"]["after"]["chi2"].number(),
        )
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from error


def _read_json(path: Path, form: str) -> Entry:
    """Return the content of a JSON file that states the given format, in a version that can be read."""
    raw = read_bounded(path, MAX_BYTES, f"no JSON of format {form}")
    try:
        content = json.loads(raw.decode())
    except RecursionError as error:
        raise BadInput(f"{path}: not JSON (nested too deeply); expected format {form}") from error
    except ValueError as error:
        raise BadInput(f"{path}: not JSON ({error}); expected format {form}") from error
    stated = content.get("format") if isinstance(content, dict) else None
    versions = READABLE[form]
    if stated != form or content.get("format_version") not in versions:
        expected = f"{form!r}, format_version {' or '.join(map(str, versions))}"
        raise BadInput(f"{path}: format {str(stated)[:MAX_CHARACTERS]!r}, expected {expected}")
    return Entry("", content)


def _hidden_effect(entry: Entry) -> HiddenEffect:
    effect = HiddenEffect(
        name=entry["name"].text(),
        stage=entry["stage"].text(),
        in_vocabulary=entry["in_vocabulary"].flag(),
        parameters={name: value.text_or_number() for name, value in entry["parameters"].items()},
        units={name: unit.text() for name, unit in entry["units"].items()},
    )
    if effect.units.keys() != effect.parameters.keys():
        raise BadInput(f"{entry.place}.units: expected one for every parameter")
    return effect


def _reported_effect(entry: Entry) -> ReportedEffect:
    return ReportedEffect(
        name=entry["name"].text(),
        parameters={name: _estimate(parameter) for name, parameter in entry["parameters"].items()},
        alternatives=tuple(name.text() for name in entry["alternatives"].entries()),
    )


def _estimate(entry: Entry) -> Estimate:
    return Estimate(entry["value"].text_or_number(), float(entry["std"].number()), entry["unit"].text())
