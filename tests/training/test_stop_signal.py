"""Who asks a command to stop gets what was trained so far; who asks twice is obeyed at once."""

from __future__ import annotations

import csv
import fcntl
import json
import os
import pty
import shlex
import signal
import socket
import subprocess
import sys
import termios
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
import torch

from sci_lightning.errors import INTERRUPTED, STOPS, TIME_IS_UP, MachineFailure
from sci_lightning.training.stop_signal import StopSignal
from tests.conftest import ROOT
from tests.training.small_training import TINY

Stopped = Callable[..., subprocess.CompletedProcess[str]]
BOTH = pytest.mark.parametrize("number", STOPS)


@pytest.fixture
def stopped(command: Stopped) -> Stopped:
    """``stopped("batch", signal.SIGTERM)``: a training, in a process group of its own, that gets a signal then."""

    def run(
        moment: str, number: int = signal.SIGINT, words: Sequence[str] = (), **more: object
    ) -> subprocess.CompletedProcess[str]:
        options = {"number": int(number), "moment": moment, **more}
        sender = "+callbacks.sender={_target_: tests.training.small_training.Sender, %s}"
        sender %= ", ".join(f"{key}: {value}" for key, value in options.items())
        return command("train", *TINY, "metrics.qscore=null", sender, "out=run", *words)

    return run


def test_the_step_is_finished_and_kept(stopped: Stopped, tmp_path: Path) -> None:
    done = stopped("batch", signal.SIGTERM)
    last = tmp_path / "run" / "checkpoints" / "last.ckpt"
    assert done.returncode == 130, done.stderr
    program, *words = shlex.split(done.stderr.rpartition("go on with:\n  ")[2])
    assert words[:3] == ["-m", "sci_lightning.train", "ckpt_path=run/checkpoints/last.ckpt"]
    asked_again = {word.partition("=")[0] for word in words[3:]}
    assert asked_again == {"workers", "+callbacks.sender"}  # no checkpoint may ask for them
    has_torch = "from importlib.util import find_spec; raise SystemExit(find_spec('torch') is None)"
    starts = subprocess.run([program, "-c", has_torch], cwd=tmp_path, capture_output=True, text=True)
    assert starts.returncode == 0, f"{program} is not the Python that was interrupted: {starts.stderr}"
    assert "Traceback" not in done.stderr
    assert torch.load(last, weights_only=True)["global_step"] == 4


@BOTH
def test_a_signal_to_the_whole_group_leaves_the_workers_alive(stopped: Stopped, number: int, tmp_path: Path) -> None:
    """What ``timeout``, a scheduler, Ctrl-C and a closing terminal do; twice in a moment is one request."""
    done = stopped("batch", number, ["workers=2", "logger=csv"], group=True)
    assert done.returncode == 130, done.stderr
    assert "go on with" in done.stderr and "Traceback" not in done.stderr and "error" not in done.stderr
    last = tmp_path / "run" / "checkpoints" / "last.ckpt"
    assert torch.load(last, weights_only=True)["global_step"] == 4
    rows = csv.DictReader((tmp_path / "run" / "csv" / "metrics.csv").open())
    assert [row["step"] for row in rows] == ["0", "1", "2", "3"]  # the step that was finished as well


def test_signals_in_one_moment_are_one_request(capsys: pytest.CaptureFixture[str]) -> None:
    with StopSignal() as stop:
        stop.wait_for_step()
        for _ in range(3):  # a later one would end this process
            os.kill(os.getpid(), signal.SIGTERM)
        assert stop.requested


def test_a_closing_terminal(tmp_path: Path) -> None:
    """The kernel sends SIGHUP, and every line that is printed afterwards would be an error."""
    master, slave = pty.openpty()
    words = [*TINY, "metrics.qscore=null", "workers=1", "trainer.max_epochs=4000", "callbacks.pictures=null", "out=run"]

    def in_the_terminal() -> None:
        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    training = subprocess.Popen(
        [sys.executable, "-m", "sci_lightning.train", *words],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=slave,
        stdout=slave,
        stderr=slave,
        preexec_fn=in_the_terminal,
    )
    os.close(slave)
    shown = b""
    while b"Epoch" not in shown:
        shown += os.read(master, 4096)
    os.close(master)
    assert training.wait(timeout=120) == 130
    assert torch.load(tmp_path / "run" / "checkpoints" / "last.ckpt", weights_only=True)["global_step"] > 0


def test_output_that_nobody_reads_is_dropped() -> None:
    script = (
        "import os; from sci_lightning.training.stop_signal import drop_closed_outputs\n"
        "ours, theirs = os.pipe(); os.dup2(theirs, 1); os.close(ours)\n"
        "drop_closed_outputs(); print('lost', flush=True); os.write(2, b'kept')"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "kept")


@pytest.mark.slow
def test_in_validation(stopped: Stopped, tmp_path: Path) -> None:
    done = stopped("validation")
    last = tmp_path / "run" / "checkpoints" / "last.ckpt"
    assert done.returncode == 130 and "go on with" in done.stderr
    assert torch.load(last, weights_only=True)["position"] == {"steps": 4, "batches_per_epoch": 4, "validated": False}


@pytest.mark.slow
def test_in_the_test_after_training(stopped: Stopped, tmp_path: Path) -> None:
    done = stopped("test")
    assert done.returncode == 130 and "go on with" in done.stderr
    assert torch.load(tmp_path / "run" / "checkpoints" / "last.ckpt", weights_only=True)["global_step"] == 8
    assert not (tmp_path / "run" / "metrics.json").exists()


@pytest.mark.slow
def test_before_the_first_step(stopped: Stopped, tmp_path: Path) -> None:
    done = stopped("start", step=0)
    assert done.returncode == 130 and "before the first step" in done.stderr
    assert not (tmp_path / "run" / "checkpoints" / "last.ckpt").exists()


@pytest.mark.slow
def test_twice_ends_at_once(stopped: Stopped, tmp_path: Path) -> None:
    done = stopped("batch", times=2)
    assert done.returncode == 130
    assert not (tmp_path / "run" / "checkpoints").exists()


@BOTH
def test_outside_of_steps_it_interrupts(number: int) -> None:
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), StopSignal():
        os.kill(os.getpid(), number)
    assert signal.getsignal(number) == before


@BOTH
def test_in_a_step_it_waits(number: int, capsys: pytest.CaptureFixture[str]) -> None:
    with StopSignal() as stop:
        stop.wait_for_step()
        assert not stop.requested
        os.kill(os.getpid(), number)
        assert stop.requested and "once more ends at once" in capsys.readouterr().err
        with pytest.raises(KeyboardInterrupt):
            stop.act_at_once()


def test_the_handlers_of_others_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: seen.append(number))
    try:
        with StopSignal() as stop:
            stop.wait_for_step()
            os.kill(os.getpid(), signal.SIGTERM)
            assert seen == [signal.SIGTERM] and not stop.requested
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_job_of_slurm_does_not_end_at_a_second_signal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Slurm itself ends a job that goes on; submitit's handler, which lets SIGTERM pass, is replaced for a while."""
    monkeypatch.setenv("SLURM_JOB_ID", "7")
    monkeypatch.setattr("sci_lightning.training.stop_signal.SAME_REQUEST_SECONDS", 0)
    submitit = signal.signal(signal.SIGTERM, lambda *_: None)
    try:
        with StopSignal() as stop:
            stop.wait_for_step()
            for _ in range(2):
                os.kill(os.getpid(), signal.SIGTERM)
            assert stop.requested and "once more" not in capsys.readouterr().err
            stop.queue_again()  # nothing: it was no signal that the time is up
    finally:
        signal.signal(signal.SIGTERM, submitit)


def test_what_may_not_be_queued_again_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def too_often(*_: object) -> None:
        raise RuntimeError("timed-out too many times")

    monkeypatch.setenv("SLURM_JOB_ID", "7")
    before = signal.signal(signal.SIGUSR2, too_often)
    try:
        with StopSignal() as stop:
            stop.wait_for_step()
            os.kill(os.getpid(), signal.SIGUSR2)
            with pytest.raises(MachineFailure, match="max_num_timeout"):
                stop.queue_again()
    finally:
        signal.signal(signal.SIGUSR2, before)


@pytest.mark.parametrize("number", TIME_IS_UP)
def test_slurm_queues_the_job_again(
    number: int,
    command: Callable[..., subprocess.CompletedProcess[str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At the signal before the time limit the step is finished and kept; the same job goes on there."""
    scontrol = tmp_path / "bin" / "scontrol"
    scontrol.parent.mkdir()
    scontrol.write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/requeued\n')
    scontrol.chmod(0o755)
    slurm = {"JOB_ID": "7", "JOB_NAME": "train", "NTASKS": "1", "PROCID": "0", "LOCALID": "0", "NODEID": "0"}
    for key, value in {**slurm, "NODELIST": "localhost", "JOB_NODELIST": "localhost"}.items():
        monkeypatch.setenv(f"SLURM_{key}", value)
    monkeypatch.setenv("PATH", f"{scontrol.parent}:{os.environ['PATH']}")
    target = "tests.training.small_training.Sender"
    sender = f"{{_target_: {target}, number: {int(number)}, moment: batch, step: 3}}"
    one = [*TINY, "trainer.devices=1", "trainer.max_epochs=1", "metrics.qscore=null", "out=run"]
    done = command("train", *one, f"+callbacks.sender={sender}")
    assert done.returncode == INTERRUPTED, done.stderr
    assert (tmp_path / "requeued").read_text() == "requeue 7\n"
    last = tmp_path / "run" / "checkpoints" / "last.ckpt"
    assert torch.load(last, weights_only=True)["global_step"] == 4
    if number != TIME_IS_UP[0]:  # whichever signal it was, the same job goes on in the same way
        return
    assert "resume=true" in command("train", *one).stderr
    monkeypatch.setenv("SLURM_RESTART_COUNT", "1")
    done = command("train", *one)
    assert done.returncode == 0 and "goes on from" in done.stdout, done.stderr
    job = json.loads((tmp_path / "run" / "metrics.json").read_text())["job"]
    assert job == {"host": socket.gethostname(), "id": "7", "restarts": 1}
