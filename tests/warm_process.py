"""Commands in a process of their own that starts at once: forked from one in which the libraries are imported already.

Importing torch, Lightning and Hydra takes seconds, a command of the tests often less. A server process imports them
once, and forks for every command a child that runs the module as ``python -m`` would, with its own arguments, folder,
environment, output and process group. A test that needs a fresh interpreter starts one itself.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import json
import os
import resource
import runpy
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.parsed_once import parse_once

PRELOADED = (
    "torch",
    "lightning.pytorch",
    "hydra",
    "tensorboard",
    "matplotlib.pyplot",
    "h5py",
    "scipy.ndimage",
    "skimage",
    "torchmetrics",
    "sci_lightning.cli.command",
    "sci_lightning.training.system",
    "sci_lightning.decoder",
)
"""What is imported before the first command."""


class WarmProcesses:
    """Runs commands in children of one server process, which ends with this object's process."""

    def __init__(self, root: Path) -> None:
        self.server = subprocess.Popen(
            [sys.executable, "-m", "tests.warm_process"],
            cwd=root,
            env={**os.environ, "PYTHONPATH": str(root), "MPLBACKEND": "Agg"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def run(
        self, module: str, arguments: Sequence[str], cwd: Path, environment: Mapping[str, str], timeout: float = 300
    ) -> subprocess.CompletedProcess[str]:
        """Run ``python -m module arguments`` and return its status and what it printed.

        Raises:
            subprocess.TimeoutExpired: it took longer than ``timeout`` seconds; it and its children are killed.
        """
        assert self.server.stdin is not None and self.server.stdout is not None
        with tempfile.TemporaryDirectory() as folder:
            out, err = Path(folder) / "out", Path(folder) / "err"
            request = {
                "module": module,
                "arguments": list(arguments),
                "cwd": str(cwd),
                "environment": dict(environment),
                "out": str(out),
                "err": str(err),
                "timeout": timeout,
                "largest_file": resource.getrlimit(resource.RLIMIT_FSIZE),  # tests lower it to play a full disk
            }
            self.server.stdin.write(json.dumps(request) + "\n")
            self.server.stdin.flush()
            status = json.loads(self.server.stdout.readline())["status"]
            printed, errors = out.read_text(errors="replace"), err.read_text(errors="replace")
        if status is None:
            raise subprocess.TimeoutExpired(module, timeout, printed, errors)
        return subprocess.CompletedProcess(["python", "-m", module, *arguments], status, printed, errors)

    def close(self) -> None:
        """End the server."""
        assert self.server.stdin is not None
        self.server.stdin.close()
        self.server.wait()


def serve() -> None:
    """Run the commands that come in as lines of JSON, one after the other, until the input ends."""
    for name in PRELOADED:
        importlib.import_module(name)
    parse_once(Path("conf"))
    answers = os.fdopen(os.dup(1), "w")
    for line in sys.stdin:
        request: dict[str, Any] = json.loads(line)
        child = os.fork()
        if child == 0:
            run(request)
        print(json.dumps({"status": ended(child, request["timeout"])}), file=answers, flush=True)


def ended(child: int, timeout: float) -> int | None:
    """Wait for a child and return its status as :mod:`subprocess` does; None if it was killed for its time."""

    def kill(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, kill)
    signal.setitimer(signal.ITIMER_REAL, timeout)
    try:
        _, status = os.waitpid(child, 0)
        return os.waitstatus_to_exitcode(status)
    except TimeoutError:
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def run(request: Mapping[str, Any]) -> None:
    """Become the process of a command: never returns."""
    status = 1
    try:
        os.setsid()
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        for path, descriptor, flags in (
            (os.devnull, 0, os.O_RDONLY),
            (request["out"], 1, os.O_WRONLY | os.O_CREAT),
            (request["err"], 2, os.O_WRONLY | os.O_CREAT),
        ):
            opened = os.open(path, flags, 0o600)
            os.dup2(opened, descriptor)
            os.close(opened)
        sys.stdin, sys.stdout, sys.stderr = open(0), open(1, "w"), open(2, "w", buffering=1)  # noqa: SIM115
        resource.setrlimit(resource.RLIMIT_FSIZE, tuple(request["largest_file"]))
        os.environ.clear()
        os.environ.update(request["environment"])
        os.chdir(request["cwd"])
        folders = [folder for folder in os.environ.get("PYTHONPATH", "").split(os.pathsep) if folder]
        sys.path[:] = [request["cwd"], *folders, *[folder for folder in sys.path if folder not in ("", os.getcwd())]]
        sys.argv = [request["module"], *request["arguments"]]
        runpy.run_module(request["module"], run_name="__main__", alter_sys=True)
        status = 0
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            status = end.code or 0
        else:
            print(end.code, file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    finally:
        threading._shutdown()  # type: ignore[attr-defined]  # as the interpreter does at its end: joins threads
        atexit._run_exitfuncs()
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(status)


if __name__ == "__main__":
    serve()
