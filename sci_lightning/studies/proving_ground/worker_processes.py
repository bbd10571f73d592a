"""Worker processes that run cases: each case in a process of its own, so that none can harm another."""

from __future__ import annotations

import os
import signal
import traceback
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import connection, get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection
from threading import Thread
from typing import Any

from sci_lightning.errors import describe
from sci_lightning.studies.proving_ground.case import Case


def run_cases(cases: Iterable[Case], workers: int = 1, threads: int = 1) -> Iterator[dict[str, Any]]:
    """Run all cases and yield the record of each as soon as it is there.

    The record of a case that raises an exception or whose process dies says why in one line, under ``failed``. Cases
    that are running when the iteration is left, by Ctrl-C or otherwise, are lost.

    Args:
        cases: the cases, in the order in which they are begun.
        workers: largest number of cases at a time.
        threads: threads of each case.
    """
    context, waiting = get_context("spawn"), deque(cases)
    running: dict[Any, tuple[Any, Case]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                case = waiting.popleft()
                receiver, sender = context.Pipe(duplex=False)
                process = context.Process(target=_run_in_process, args=(sender, case, threads), daemon=True)
                running[receiver] = process, case
                with _environment_of_workers(threads):
                    process.start()
                sender.close()  # the worker has the only other copy, so that its death ends the receiver's wait
            for ready in connection.wait(list(running)):
                process, case = running.pop(ready)
                yield _receive(ready, process, case)
    finally:
        for process, _ in running.values():
            if process.pid is not None:
                process.kill()
                process.join()


def _receive(receiver: Any, process: Any, case: Case) -> dict[str, Any]:
    """Return the record that a worker has sent, or one that says how the worker died; the process has then ended."""
    try:
        record: dict[str, Any] = receiver.recv()
    except EOFError:
        process.join()
        return {**case.describe(), "failed": f"the process died with exit code {process.exitcode}"}
    process.join()
    return record


def _run_in_process(sender: Connection, case: Case, threads: int) -> None:
    """Run one case in the present process and send its record."""
    Thread(target=_end_with_parent, daemon=True).start()
    import torch

    torch.set_num_threads(threads)
    try:
        from sci_lightning.studies.proving_ground.trial import run_trial

        record = run_trial(case)
    except Exception as error:
        record = {**case.describe(), "failed": describe(error), "traceback": traceback.format_exc()}
    sender.send(record)


def _end_with_parent() -> None:
    """End this process when its parent has died: nobody would receive its record, and the next run begins it anew."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


@contextmanager
def _environment_of_workers(threads: int) -> Iterator[None]:
    """Set what a new process inherits: the number of threads for NumPy's matrix products, and a blocked SIGINT.

    A terminal sends Ctrl-C to all processes. Only the parent may act on it, and only when the new process has been
    started completely. Blocking does not keep the signal away from the parent, whose other threads receive it as well.
    Its handler therefore notes the signal, and the usual handler is called afterwards.
    """
    earlier_threads = os.environ.get("OMP_NUM_THREADS")
    resource_tracker.ensure_running()  # otherwise the first start would do so, and unblock the signal
    noted: list[tuple[int, Any]] = []
    usual_handler = signal.signal(signal.SIGINT, lambda *interrupt: noted.append(interrupt))
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    os.environ["OMP_NUM_THREADS"] = str(threads)
    try:
        yield
    finally:
        if earlier_threads is None:
            del os.environ["OMP_NUM_THREADS"]
        else:
            os.environ["OMP_NUM_THREADS"] = earlier_threads
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, usual_handler)
        if noted and callable(usual_handler):
            usual_handler(*noted[0])
