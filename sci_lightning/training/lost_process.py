"""A training on several devices of which one process died: the others end, and one of them reports it."""

from __future__ import annotations

import os
import re
from pathlib import Path

from sci_lightning.errors import MachineFailure

CONNECTION = re.compile(r"gloo|nccl|connection (reset|closed|refused)|remote process|peer|broken pipe", re.IGNORECASE)
"""Words in the errors of the libraries that connect processes when one of these has ended."""


def lost_process(error: BaseException, out: str | Path) -> MachineFailure | None:
    """Return the failure to report if an error came from the end of another process; None for any other error.

    Args:
        error: what a collective operation raised.
        out: the run's folder.

    Raises:
        SystemExit: another process reports it: the first one, or the second one if the first one died.
    """
    if "MASTER_PORT" not in os.environ or not isinstance(error, RuntimeError) or not CONNECTION.search(str(error)):
        return None
    rank = int(os.environ.get("RANK", os.environ.get("LOCAL_RANK", 0)))
    if rank > 1 or (rank == 1 and os.getppid() > 1 and _is_alive(os.getppid())):
        raise SystemExit(1)
    last = Path(out) / "checkpoints" / "last.ckpt"
    go_on = f"; go on with ckpt_path={last}" if last.is_file() else ""
    return MachineFailure(
        f"one of the processes of this training was ended from outside, and the others ended with it{go_on}"
    )


def _is_alive(process: int) -> bool:
    """Whether a process runs; one that was killed and not yet waited for does not."""
    try:
        status = Path(f"/proc/{process}/stat").read_text()
    except FileNotFoundError:
        return False
    except OSError:
        return True
    return status.rpartition(")")[2].split()[0] not in "ZX"
