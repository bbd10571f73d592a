"""Cases in this process or in processes of their own, so that none can harm another."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import sqrt
from multiprocessing import connection, get_context, parent_process, resource_tracker
from threading import Thread
from typing import Any

from sci_lightning.errors import MachineFailure, describe
from sci_lightning.studies.engine.records import Case, FailedCase, Record, Records

Work = Callable[[Any], Mapping[str, Any]]
"""What one case computes: given the case, it returns the results as plain data for JSON. It travels to other processes,
so that it is a function of a module, or an object that can be pickled."""


def run_cases(
    work: Work, cases: Sequence[Case], records: Records[Record], workers: int = 0, threads: int = 1, job: int | None = 0
) -> Iterator[Record | FailedCase]:
    """Run all cases and yield the record of each, or why it failed, as soon as it is there.

    A case that raises an exception or whose process dies is a failed one. Cases that are running when the iteration is
    left, by Ctrl-C or otherwise, are lost. Cases that another process has claimed in the same folder are left to it.

    Args:
        work: what a case computes.
        cases: in the order in which they are begun.
        records: where each leaves its record.
        workers: largest number of cases at a time, each in a process of its own; 0: one after the other in this one.
        threads: of each case in a process of its own.
        job: number of this process among those that share the folder: each begins at another place of ``cases``.
    """
    first = int((job or 0) * (sqrt(5) - 1) / 2 % 1 * len(cases))  # spread evenly, however many jobs there are
    waiting: deque[Case] = deque([*cases[first:], *cases[:first]])
    running: dict[Any, tuple[Any, Case]] = {}
    claimed: set[str] = set()
    with records.claims() as claims:
        try:
            while waiting or running:
                while waiting and len(running) < max(workers, 1):
                    case = waiting.popleft()
                    if not claims.take(case):
                        if case.name not in claimed:  # at the end once more: whoever runs it may be lost meanwhile
                            claimed.add(case.name)
                            waiting.append(case)
                        continue
                    if records.ended(case) is not None:  # in another process, after these cases were listed
                        claims.release(case)
                    elif workers:
                        process = _start(work, case, records, threads)
                        running[process.sentinel] = process, case
                    else:
                        perform(work, case, records)
                        claims.release(case)
                        yield _end(case, records)
                for ready in connection.wait(list(running)) if running else ():
                    process, case = running.pop(ready)
                    process.join()
                    if process.exitcode:
                        records.fail(case, f"the process died with exit code {process.exitcode}")
                    claims.release(case)
                    yield _end(case, records)
        finally:
            for process, _ in running.values():
                process.kill()
                process.join()


def perform(work: Work, case: Case, records: Records[Record]) -> None:
    """Run one case in the present process and write its record, or why it failed."""
    try:
        results = work(case)
    except Exception as error:
        records.fail(case, describe(error), traceback.format_exc())
    else:
        records.write(case, results)


def _end(case: Case, records: Records[Record]) -> Record | FailedCase:
    """Return what a case has left, which has just ended."""
    ended = records.ended(case)
    if ended is None:
        raise MachineFailure(f"{records.folder}: the record of {case.name} is gone")
    return ended


def _start(work: Work, case: Case, records: Records[Record], threads: int) -> Any:
    """Start a process that runs a case."""
    arguments = (work, case, records, threads)
    process = get_context("spawn").Process(target=_perform_in_process, args=arguments, daemon=True)
    with _environment_of_workers(threads):
        process.start()
    return process


def _perform_in_process(work: Work, case: Case, records: Records[Record], threads: int) -> None:
    Thread(target=_end_with_parent, daemon=True).start()
    import torch

    torch.set_num_threads(threads)
    try:
        perform(work, case, records)
    except MachineFailure as error:
        sys.exit(str(error))


def _end_with_parent() -> None:
    """End this process when its parent has died, which has claimed the case: the next run begins it anew."""
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
