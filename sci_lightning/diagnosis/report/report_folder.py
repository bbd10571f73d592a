"""The folder of a diagnosis: its files are those of one diagnosis, of the last one that ended."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from sci_lightning.errors import BadInput, as_machine_failure
from sci_lightning.files.atomic_file import sync_folder

OURS = re.compile(
    r"report\.(html|json)|encoder\.yaml|patterns\.npy|effective_mask\.(npy|mat)|snapshots\.json|covered_snapshots\.npy|"
    r"(residuals|example|histogram|gap|evidence|prediction|reconstruction|unnamed_\d+)\.png"
)
"""Names of the files that a diagnosis writes; maps of effects, which only ``encoder.yaml`` names, are overwritten."""

FOREIGN = ("encoder.yaml", "report.html")
"""Names that a file of somebody else may have."""

UNFINISHED = ".report-"
"""What the name of a folder begins with whose files are still being written."""


def check_no_foreign_report(out: str | Path) -> None:
    """Check that a diagnosis would overwrite nothing but an earlier diagnosis in its folder, which need not exist.

    Raises:
        BadInput: there is a file that no diagnosis has written.
    """
    out = Path(out)
    for name in FOREIGN:
        if os.path.lexists(out / name) and not (out / "report.json").is_file():
            raise BadInput(
                f"{out}: holds {name}, which no diagnosis wrote and which would be overwritten; give another out="
            )


@contextmanager
def report_folder(out: str | Path, kept: Iterable[str | Path] = ()) -> Iterator[Path]:
    """Give a folder to write the files of a diagnosis into, which replace those of an earlier one when all are there.

    Until then, and if writing fails or is interrupted, the earlier diagnosis stays as it is.

    Args:
        out: the folder of the diagnosis; created if it does not exist.
        kept: files that are not removed although they have the name of a diagnosis's file: what was diagnosed.

    Raises:
        MachineFailure: the disk is full or broken.
    """
    out = Path(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        for left in out.glob(f"{UNFINISHED}*"):  # by a process that was killed: the folder is this process's alone
            if left.is_dir() and not left.is_symlink():
                shutil.rmtree(left)
        written = Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=out))
        try:
            yield written
            new = sorted(path.name for path in written.iterdir())
            read = {Path(path).resolve() for path in kept}
            for path in sorted(out.iterdir()):
                if OURS.fullmatch(path.name) and path.name not in new and path.resolve() not in read:
                    path.unlink()
            for name in new:
                os.replace(written / name, out / name)
            sync_folder(out)
        finally:
            shutil.rmtree(written, ignore_errors=True)
    except OSError as error:
        if failure := as_machine_failure(error, out):
            raise failure from error
        raise
