"""Where, when and with what a measurement was made: what each measured table of the documentation says below itself."""

from __future__ import annotations

import datetime
import os
import platform
import re
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from sci_lightning.configuration.conf_folder import PACKAGE
from sci_lightning.files.json_file import JsonObject, says

BETWEEN = " | "
"""Between the machines, scales and commands of several measurements."""


def installed_version() -> str:
    """Return the installed version of this program; ``0+unknown`` in a checkout that was never installed."""
    try:
        return version("sci-lightning")
    except PackageNotFoundError:
        return "0+unknown"


class Provenance(JsonObject):
    """The origin of the figures of one table, the entry ``provenance`` of a JSON file.

    Where several measurements differ in the machine, the scale or the command, :data:`BETWEEN` stands between them.
    """

    machine: str = says("cores, processor or GPU, memory, and what else ran on it")
    date: str = says("of the measurement, 2026-11-22; several days as 2026-11-22 to 2026-11-24")
    commit: str = says("of the program, the first digits of its hash; + behind it: files had been changed")
    scale: str = says("of conf/scale, or in words what was reduced; full if nothing was")
    seeds: str = says("of the runs, such as 0, 1, 2; none where nothing is random")
    command: str = says("that makes the measurement again", default="")
    reconstructed: bool = says("the command was not noted: it is the nearest one, stated afterwards", default=False)

    def sentence(self) -> str:
        """Return the line of Markdown that stands below the table."""
        if self == NOT_YET:
            return "Not yet run."
        machine, scale = (" and ".join(text.split(BETWEEN)) for text in (self.machine, self.scale))
        parts = [machine, self.date, f"commit {self.commit}", f"scale: {scale}", f"seeds: {self.seeds}"]
        commands = " and ".join(f"`{command}`" for command in self.command.split(BETWEEN))
        made = "The command was not noted; the nearest one:" if self.reconstructed else "Made by"
        return "; ".join(parts) + "." + (f" {made} {commands}." if self.command else "")

    def as_json(self) -> dict[str, Any]:
        """Return the entry of a JSON file, without what is empty."""
        return {key: value for key, value in super().as_json().items() if value}


NOT_YET = Provenance(machine="none", date="", commit="", scale="", seeds="")
"""The provenance of a table without figures."""


def provenance_now(device: str, scale: str, seeds: Sequence[int], command: str = "", remark: str = "") -> Provenance:
    """Return the provenance of what has just been measured by this program on this machine.

    Args:
        device: what computed, see :func:`machine_name` and :func:`~sci_lightning.runs.device.device_name`.
        scale, seeds, command: see :class:`Provenance`.
        remark: what else is to be known of the machine, such as ``other work on both cores``.
    """
    import torch

    machine = f"{device}, {platform.machine()}, PyTorch {torch.__version__.partition('+')[0]}"
    listed = ", ".join(map(str, seeds)) or "none"
    today = datetime.datetime.now(datetime.timezone.utc).date().isoformat()
    machine = f"{machine}, {remark}" if remark else machine
    return Provenance(machine=machine, date=today, commit=commit(), scale=scale, seeds=listed, command=command)


def machine_name(cores: int | None = None) -> str:
    """Return what computes here: ``one core of 2, AMD EPYC``; all cores where ``cores`` is None."""
    every = os.cpu_count() or 1
    used = every if cores is None else cores
    model = platform.processor() or platform.machine()
    with suppress(OSError):
        names = re.findall(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
        model = names[0] if names else model
    return f"{'one core' if used == 1 else f'{used} cores'} of {every}, {model}"


@lru_cache(maxsize=1)
def commit() -> str:
    """Return the short hash of the checkout that this program runs from, with ``+`` if files differ from it.

    It is that of the first call, however far the checkout moves on while the program runs: a long measurement asks when
    it begins. An installed package belongs to no checkout; its version is returned instead.
    """

    root = PACKAGE.parent
    try:
        top = _git(root, "rev-parse", "--show-toplevel")
        if top != str(root.resolve()):
            return f"version {installed_version()}"
        return _git(root, "rev-parse", "--short=8", "HEAD") + (
            "+" if _git(root, "status", "--porcelain", "-uno", "--", "sci_lightning", "conf") else ""
        )
    except (OSError, subprocess.SubprocessError):
        return f"version {installed_version()}"


def joined(provenances: Sequence[Provenance]) -> Provenance:
    """Return what several measurements of one table have in common, and the range of what they have not.

    The result does not depend on their order, because files lie in another order in each checkout.
    """
    provenances = sorted(provenances, key=lambda one: (one.date, one.commit, one.machine, one.scale, one.command))
    dates = sorted({date for one in provenances for date in one.date.split(" to ")})
    values: Mapping[str, Any] = {
        key: _together([getattr(one, key) for one in provenances]) for key in ("machine", "scale", "command")
    }
    commits = ", ".join(dict.fromkeys(part for one in provenances for part in one.commit.split(", ")))
    seeds = sorted({seed for one in provenances for seed in one.seeds.split(", ")})
    return Provenance(
        date=dates[0] if len(dates) == 1 else f"{dates[0]} to {dates[-1]}",
        seeds=", ".join(seeds),
        commit=commits,
        reconstructed=any(one.reconstructed for one in provenances),
        **values,
    )


def _together(texts: Sequence[str]) -> str:
    """Return texts in a row, each once, also where one of them is several in a row already."""
    return BETWEEN.join(dict.fromkeys(part for text in texts for part in text.split(BETWEEN)))


def _git(folder: Any, *words: str) -> str:
    done = subprocess.run(["git", "-C", str(folder), *words], capture_output=True, text=True, timeout=20, check=True)
    return done.stdout.strip()
