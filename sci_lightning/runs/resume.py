"""What an earlier run of the same configuration left in a folder: all of it, or a part to go on from."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import read_json
from sci_lightning.files.plain_data import check_plain_data

if TYPE_CHECKING:
    from sci_lightning.runs.results import RunMetrics

FREE = {
    "out",
    "debug",
    "dry_run",
    "resume",
    "ckpt_path",
    "finetune",
    "names",
    "trusted",
    "workers",
    "callbacks",
    "logger",
    "kernels",
    "precision",  # compared as trainer.precision, which it sets
}
"""Entries of a configuration that do not change what a run computes."""

EXTENDABLE = re.compile(
    r"trainer\.(max_epochs|max_steps|max_time)(\..*)?|trainer\.(log_every_n_steps|accelerator)|data.store|core_minutes"
    r"|system\.(compile|cuda_graph)"
)
"""Settings that may change while a training goes on from ``ckpt_path=``: the learning rate follows the longer plan."""

TESTED = re.compile(r"(benchmark|metrics|test_encoders)(\..*)?")
"""Settings of the test that follows the training."""


RESULTS = ("metrics.json", "checkpoints/last.ckpt", "checkpoints/best.ckpt")
"""What a training would overwrite in the folder of an earlier run."""


def check_nothing_lost(out: Path, training: bool, resume: bool = False, ckpt_path: str | None = None) -> None:
    """Check that a command overwrites no training in its folder; its own earlier reports it may replace.

    Args:
        out: the folder, which need not exist.
        training: whether the command is ``train``.
        resume: of ``train``.
        ckpt_path: of ``train``, which goes on in its own folder with the last checkpoint there.

    Raises:
        BadInput: there is a training that would be lost, in whole or in part.
    """
    present = [name for name in RESULTS if os.path.lexists(out / name)]
    if not training:
        if checkpoints := [name for name in present if name.startswith("checkpoints/")]:
            raise BadInput(
                f"{out}: holds a training ({checkpoints[0]}), part of it would be overwritten; give another out="
            )
        return
    last = out / "checkpoints" / "last.ckpt"
    own = ckpt_path is not None and last.is_file() and Path(ckpt_path).exists() and last.samefile(ckpt_path)
    if present and not (resume or own):
        raise BadInput(
            f"{out}: holds an earlier run ({present[0]}), which would be overwritten; resume=true keeps it and goes on "
            "where it stopped, another out= starts a new one"
        )


def load_finished_metrics(out: Path, config: Mapping[str, Any]) -> RunMetrics | None:
    """Return what ``metrics.json`` in ``out`` holds, None if there is none.

    Raises:
        BadInput: it is damaged, or of another configuration.
    """
    from sci_lightning.runs.results import RunMetrics

    path = out / "metrics.json"
    if not path.is_file():
        return None
    try:
        present = read_json(path, RunMetrics)
        check_plain_data(path, present.config)
    except BadInput as error:
        raise BadInput(f"{error}; not the metrics of a run: remove it, and the run is made again") from error
    _check_same(path, present.config, config)
    return present


def find_resumable_checkpoint(out: Path, config: Mapping[str, Any]) -> str | None:
    """Return the checkpoint in ``out`` that a run can go on from, None if there is none.

    Raises:
        BadInput: it is damaged, or of another configuration.
    """
    from sci_lightning.runs.checkpoint import read_checkpoint  # torch is loaded when it is needed

    path = out / "checkpoints" / "last.ckpt"
    if not path.is_file():
        return None

    _check_same(path, read_checkpoint(path).config, config)
    return str(path)


def check_same_run(path: str | Path, earlier: Mapping[str, Any], config: Mapping[str, Any]) -> list[str]:
    """Check that a training may go on from a checkpoint of another command line.

    Args:
        path: of the checkpoint.
        earlier, config: configurations of the training so far and of its continuation, with ``names``.

    Returns:
        what differs and may, as ``key=now (was before)``.

    Raises:
        BadInput: something else that makes it another training.
    """
    changes = []
    for key, before, now in _differences(earlier, config):
        if not EXTENDABLE.fullmatch(key) and not TESTED.fullmatch(key):
            for part in ("encoder", "decoder"):  # their names say more than their settings
                names = (content.get("names", {}).get(part) for content in (earlier, config))
                one, other = names
                if key.startswith(f"{part}.") and one != other:
                    key, before, now = part, one, other
            raise BadInput(another_training(path, key, before, now))
        changes.append(f"{key}={now} (was {before})")
    for part in ("callbacks", "logger"):  # own classes and servers, which a checkpoint may not ask for
        given = config.get(part) or {}
        changes += [
            f"without {part}.{name}"
            for name, value in (earlier.get(part) or {}).items()
            if value and not given.get(name)
        ]
    workers = [content.get("workers") for content in (earlier, config)]
    return changes + ([f"workers={workers[1]} (was {workers[0]})"] if workers[0] != workers[1] else [])


def another_training(path: str | Path, key: str, before: Any, now: Any) -> str:
    """Return the line that refuses to go on with another training."""
    return (
        f"{path}: its training had {key}={before}, now it is {now}: leave that out to go on, or start a new training "
        f"from its weights: convert checkpoint={path} out=weights.ckpt, then ckpt_path=weights.ckpt"
    )


def _check_same(path: Path, earlier: Mapping[str, Any], config: Mapping[str, Any]) -> None:
    for key, before, now in _differences(earlier, config):
        raise BadInput(
            f"{path}: of another configuration ({key} is {before}, now {now}); give another out=, or remove it"
        )


def _differences(earlier: Mapping[str, Any], config: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Keys whose values differ, with both values as text."""
    one, other = _comparable(earlier), _comparable(config)
    for key in sorted(one.keys() | other.keys()):
        if one.get(key) != other.get(key) and not (key == "trainer.precision" and other.get(key) == "auto"):
            yield key, str(one.get(key, "absent")), str(other.get(key, "absent"))


def _comparable(config: Mapping[str, Any]) -> dict[str, Any]:
    """What a run finds depends on, flat, wherever the run's folder is."""
    parts = _without(json.loads(json.dumps(config)), config.get("out"))
    return dict(_flat({key: value for key, value in parts.items() if key not in FREE}))


def _without(content: Any, out: Any) -> Any:
    """Plain values with ``OUT`` in the place of the run's folder."""
    if isinstance(content, dict):
        return {key: _without(value, out) for key, value in content.items()}
    if isinstance(content, list):
        return [_without(value, out) for value in content]
    return content.replace(out, "OUT") if isinstance(content, str) and isinstance(out, str) and out else content


def _flat(content: Mapping[str, Any], above: str = "") -> list[tuple[str, Any]]:
    flat = []
    for key, value in content.items():
        name = f"{above}{key}"
        flat += _flat(value, f"{name}.") if isinstance(value, dict) and value else [(name, value)]
    return flat
