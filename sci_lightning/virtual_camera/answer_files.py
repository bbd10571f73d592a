"""What ``reveal`` reads: the truth beside captures and the report of a diagnosis, which may come from anybody."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput

LARGEST_FILE = 8 * 2**20
"""Bytes; the report of a diagnosis has some thousands."""
LONGEST_TEXT = 200
MOST = 1000
"""Effects, and parameters of one."""

Check = Callable[[str, Any], None]


def read_truth(path: str | Path) -> dict[str, Any]:
    """Read ``<captures>.truth.json`` of a virtual camera; raises BadInput where it is something else."""
    return _read(Path(path), "sci-captures-truth", TRUTH)


def read_report(path: str | Path) -> dict[str, Any]:
    """Read ``report.json`` of a diagnosis; raises BadInput where it is something else."""
    return _read(Path(path), "sci-diagnosis", REPORT)


def _read(path: Path, form: str, check: Check) -> dict[str, Any]:
    try:
        if path.exists() and not path.is_file():  # a pipe or a device would wait for ever
            raise BadInput(f"{path}: not a file; expected JSON of format {form}")
        with path.open("rb") as stream:
            raw = stream.read(LARGEST_FILE + 1)
        if len(raw) > LARGEST_FILE:
            raise BadInput(f"{path}: larger than {LARGEST_FILE:,} bytes; expected JSON of format {form}")
        content = json.loads(raw.decode())
    except OSError as error:
        raise BadInput(f"{path}: {(error.strerror or 'unreadable').lower()}; expected JSON of format {form}") from error
    except RecursionError as error:
        raise BadInput(f"{path}: not JSON (nested too deeply); expected format {form}") from error
    except BadInput:
        raise
    except ValueError as error:
        raise BadInput(f"{path}: not JSON ({error}); expected format {form}") from error
    told = content.get("format") if isinstance(content, dict) else None
    if told != form or content.get("format_version") != 1:
        raise BadInput(f"{path}: format {str(told)[:LONGEST_TEXT]!r}, expected {form!r}, format_version 1")
    try:
        check("", content)
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from error
    return dict(content)


def _text(place: str, value: Any) -> None:
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise BadInput(f"{place}: expected a text of at most {LONGEST_TEXT} characters")


def _truth_value(place: str, value: Any) -> None:
    if not isinstance(value, str):
        _number(place, value)
    else:
        _text(place, value)


def _number(place: str, value: Any) -> None:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not abs(value) < 1e300 or not math.isfinite(value):
        raise BadInput(f"{place}: expected a finite number")


def _flag(place: str, value: Any) -> None:
    if not isinstance(value, bool):
        raise BadInput(f"{place}: expected true or false")


def _list(check: Check) -> Check:
    def checked(place: str, value: Any) -> None:
        if not isinstance(value, list) or len(value) > MOST:
            raise BadInput(f"{place}: expected a list of at most {MOST}")
        for index, entry in enumerate(value):
            check(f"{place}[{index}]", entry)

    return checked


def _named(check: Check) -> Check:
    """An object whose entries, under any names, are all of one sort."""

    def checked(place: str, value: Any) -> None:
        if not isinstance(value, dict) or len(value) > MOST:
            raise BadInput(f"{place}: expected an object with at most {MOST} entries")
        for name, entry in value.items():
            _text(f"{place}: a name", name)
            check(f"{place}.{name}", entry)

    return checked


def _object(**checks: Check) -> Check:
    """An object that has at least these entries."""

    def checked(place: str, value: Any) -> None:
        if not isinstance(value, dict):
            raise BadInput(f"{place}: expected an object with {', '.join(checks)}")
        for name, check in checks.items():
            where = f"{place}.{name}".lstrip(".")
            if name not in value:
                raise BadInput(f"{where}: is missing")
            check(where, value[name])

    return checked


def _hidden(place: str, value: Any) -> None:
    _object(name=_text, stage=_text, in_vocabulary=_flag, parameters=_named(_truth_value), units=_named(_text))(
        place, value
    )
    if value["units"].keys() != value["parameters"].keys():
        raise BadInput(f"{place}.units: expected one for every parameter")


_chi2 = _object(chi2=_number)
_parameter = _object(value=_truth_value, std=_number, unit=_text)
TRUTH = _object(effects=_list(_hidden))
REPORT = _object(
    effects=_list(_object(name=_text, parameters=_named(_parameter), alternatives=_list(_text))),
    unnamed=_list(_object(stage=_text)),
    gap=_object(before=_chi2, after=_chi2),
)
