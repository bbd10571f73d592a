"""Ctrl-C while a command is still loading its modules."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest


def _not_ignored() -> None:
    """A shell that runs the tests in the background has its programs ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize("command", ["train", "diagnose"])
def test_no_traceback_while_a_command_loads(command: str, tmp_path: Path) -> None:
    """The first module that a command imports, in whose place this one stands, gets the interrupt."""
    (tmp_path / "omegaconf.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    places = os.pathsep.join([str(tmp_path), str(Path.cwd())])
    ended = subprocess.run(
        [sys.executable, "-m", f"sci_lightning.{command}"],
        env={**os.environ, "PYTHONPATH": places},
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=_not_ignored,
    )
    assert ended.returncode == -signal.SIGINT and not ended.stderr


def test_the_package_leaves_other_programs_alone() -> None:
    """Only its own commands are ended without a word; a program that imports it keeps its way of being interrupted."""
    program = "import sci_lightning, signal; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, preexec_fn=_not_ignored
    )
    assert ended.stdout.strip() == "True"
