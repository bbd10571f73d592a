"""The records of the protocol: one JSON file for every camera and decoder, which a later run does not compute again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.files.json_fields import read_json
from sci_lightning.runs.results import write_json
from sci_lightning.studies.mismatch.scenarios import SCENARIOS

FORMAT, FORMAT_VERSION = "sci-mismatch", 1


def record_path(folder: str | Path, camera: str, decoder: str) -> Path:
    """Return the file of a camera and a decoder."""
    return Path(folder) / f"{camera}.{decoder}.json"


def record_digest(settings: Mapping[str, Any]) -> str:
    """Return the digest of everything that a record depends on."""
    return hashlib.sha256(json.dumps(settings, sort_keys=True, default=str).encode()).hexdigest()[:16]


def read_record(path: str | Path) -> dict[str, Any]:
    """Return the content of a record.

    Raises:
        BadInput: the file is no record of this format.
    """
    content: dict[str, Any] = dict(read_json(path).content)
    try:
        right = (content["format"], content["format_version"]) == (FORMAT, FORMAT_VERSION)
        means = [float(scores["mean"]["psnr"]) for scores in content["scenarios"].values()]
        if not right or not means or not content["scenarios"].keys() <= SCENARIOS.keys():
            raise KeyError
        if not all(isinstance(content[key], str) for key in ("camera", "decoder", "digest")):
            raise KeyError
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise BadInput(f"{path}: not a record of the mismatch protocol, {FORMAT} {FORMAT_VERSION}; move it") from error
    return content


def read_records(folder: str | Path) -> list[dict[str, Any]]:
    """Return all records in a folder, in the order of their file names; raises as :func:`read_record`."""
    return [read_record(path) for path in sorted(Path(folder).glob("[!.]*.json"))]


def earlier_record(path: str | Path, digest: str, settings: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the record at ``path``, None if there is none.

    Args:
        path: of the record.
        digest: of everything that a record depends on.
        settings: that the record would have now, for the message.

    Raises:
        BadInput: it was made with other settings, and would be lost.
    """
    path = Path(path)
    if not path.is_file():
        return None
    record = read_record(path)
    if record["digest"] != digest:
        now = json.loads(json.dumps(dict(settings), default=str))
        before = record.get("settings", {})
        changed = [f"{key}={before.get(key)}, now {now.get(key)}" for key in now if before.get(key) != now.get(key)]
        reason = changed[0] if changed else "other scenes, another mask or another camera"
        raise BadInput(f"{path}: made with other settings ({reason}), and would be overwritten; give another out=")
    return record


def write_record(
    path: str | Path, camera: str, decoder: str, digest: str, settings: Mapping[str, Any], results: Mapping[str, Any]
) -> dict[str, Any]:
    """Write a record whole or not at all, and return it."""
    about = {"format": FORMAT, "format_version": FORMAT_VERSION, "camera": camera, "decoder": decoder, "digest": digest}
    record = {**about, **results, "settings": dict(settings)}
    write_json(record, path)
    return record
