"""Processes that work through cases: each case in one of its own, so that none can harm another."""

from __future__ import annotations

import os
import signal
import traceback
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import connection, get_context, resource_tracker
from multiprocessing.connection import Connection
from typing import Any

from sci_lightning.cli.failure_line import one_line
from sci_lightning.proving_ground.case import Case

Record = dict[str, Any]


def work_through(cases: Iterable[Case], workers: int = 1, threads: int = 1) -> Iterator[Record]:
    """The records of all cases, each as soon as it is there.

    A case that raises, or whose process dies, has ``failed`` in its record: why, in one line. When the iteration is
    left, by Ctrl-C or otherwise, the cases that are running are lost.

    Args:
        cases: to be tried, in this order.
        workers: cases at a time.
        threads: of each.
    """
    context, waiting = get_context("spawn"), deque(cases)
    running: dict[Connection, tuple[Any, Case]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                case = waiting.popleft()
                receiver, sender = context.Pipe(duplex=False)
                process = context.Process(target=work, args=(sender, case, threads), daemon=True)
                running[receiver] = process, case
                with _inherited(threads):
                    process.start()
                sender.close()  # the process's end of it is the last one: when it dies, the receiver hears
            for ready in connection.wait(list(running)):
                assert isinstance(ready, Connection)
                process, case = running[ready]
                try:
                    record = ready.recv()
                except EOFError:
                    process.join()
                    record = {**case.describe(), "failed": f"the process died with exit code {process.exitcode}"}
                process.join()
                del running[ready]
                yield record
    finally:
        for process, _ in running.values():
            if process.pid is not None:
                process.kill()
                process.join()


def work(sender: Connection, case: Case, threads: int) -> None:
    """Try one case, in a process of its own, and send its record."""
    import torch

    torch.set_num_threads(threads)
    try:
        from sci_lightning.proving_ground.trial import attempt

        record = attempt(case)
    except Exception as error:
        record = {**case.describe(), "failed": one_line(error), "traceback": traceback.format_exc()}
    sender.send(record)


@contextmanager
def _inherited(threads: int) -> Iterator[None]:
    """What a process is started with: so many threads for NumPy's matrices, and Ctrl-C blocked for good.

    The terminal sends Ctrl-C to all; only the parent shall act on it, and only once the process is whole. Blocking
    does not keep it away from the parent, whose other threads hear it too: it is noted, and acted on afterwards.
    """
    number = os.environ.get("OMP_NUM_THREADS")
    resource_tracker.ensure_running()  # else the first start would, and lift the block
    heard: list[tuple[int, Any]] = []
    ear = signal.signal(signal.SIGINT, lambda *interrupt: heard.append(interrupt))
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    os.environ["OMP_NUM_THREADS"] = str(threads)
    try:
        yield
    finally:
        if number is None:
            del os.environ["OMP_NUM_THREADS"]
        else:
            os.environ["OMP_NUM_THREADS"] = number
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, ear)
        if heard and callable(ear):
            ear(*heard[0])
