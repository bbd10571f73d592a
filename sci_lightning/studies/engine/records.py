"""The records of a study: one JSON file for every case that has ended, written by whichever process ran it."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Generic, Literal, Protocol, TypeVar

from sci_lightning.errors import BadInput, MachineFailure
from sci_lightning.files.json_file import JsonFile, read_json, says, write_json

FAILED = "failed"
"""Name of the folder, beside the records, that says of failed cases why they failed."""


class Case(Protocol):
    """One case of a study; it travels to the process that runs it."""

    @property
    def name(self) -> str:
        """What its file is called; no two cases of a study have the same."""

    @property
    def digest(self) -> str:
        """Digest of all settings, see :func:`digest_of`: a record with another one is of another case."""

    def describe(self) -> dict[str, Any]:
        """Return what its record says of it, as plain data for JSON: the format, the digest, the settings."""


def digest_of(settings: Mapping[str, Any]) -> str:
    """Return the digest of everything that a record depends on, 16 hexadecimal digits."""
    return hashlib.sha256(json.dumps(settings, sort_keys=True, default=str).encode()).hexdigest()[:16]


class FailedCase(JsonFile):
    """``failed/NAME.json``: a case that did not come to an end. The next run tries it again."""

    format: Literal["sci-failed-case"] = "sci-failed-case"
    format_version: Literal[1] = 1
    case: str = says("its name")
    about: dict[str, Any] = says("what its record would say of it")
    failed: str = says("why, in one line")
    traceback: str = says("where in the program; absent where the process died", default="")

    def __str__(self) -> str:
        return f"{self.case}: {self.failed}"


class CaseRecord(JsonFile):
    """What all records have in common."""

    digest: str = says("of all settings of the case; a record with another one is of another case")


Record = TypeVar("Record", bound=CaseRecord)


def _always(case: Any, record: Any) -> bool:
    return True


@dataclass(frozen=True)
class Records(Generic[Record]):
    """The records in a folder.

    Attributes:
        folder: with ``NAME.json`` for every case that has ended, and ``failed/NAME.json`` for every one that failed.
        model: what a record is read as.
        is_complete: whether a record holds all that a case asks for; one that does not is given to the case's next run.
    """

    folder: Path
    model: type[Record]
    is_complete: Callable[[Any, Record], bool] = _always

    def write(self, case: Case, results: Mapping[str, Any]) -> None:
        """Write the record of a case, whole or not at all.

        Raises:
            MachineFailure: the disk is full or broken. Other records are unchanged.
        """
        write_json({**case.describe(), **results}, self._path(case), among_many=True)
        self._path(case, FAILED).unlink(missing_ok=True)

    def fail(self, case: Case, line: str, traceback: str = "") -> None:
        """Write why a case failed; raises as :meth:`write`."""
        more: dict[str, Any] = {"traceback": traceback} if traceback else {}
        failed = FailedCase(case=case.name, about=case.describe(), failed=line, **more)
        write_json(failed.as_json(), self._path(case, FAILED), among_many=True)

    def find(self, case: Case) -> Record | None:
        """Return the record of a case, whether it is complete or not; None if there is none.

        Raises:
            BadInput: the file is no such record, or was made with other settings and would be lost.
        """
        path = self._path(case)
        if not path.is_file():
            return None
        record = self._read(path)
        if record.digest != case.digest:
            reason = _difference(record.as_json(), json.loads(json.dumps(case.describe(), default=str)))
            raise BadInput(f"{path}: made with other settings ({reason}), and would be overwritten; give another out=")
        return record

    def ended(self, case: Case) -> Record | FailedCase | None:
        """Return the complete record of a case, or why it failed; None if it has not ended; raises as :meth:`find`."""
        record = self.find(case)
        if record is not None and self.is_complete(case, record):
            return record
        path = self._path(case, FAILED)
        return read_json(path, FailedCase) if path.is_file() else None

    def missing(self, cases: Iterable[Case], job: int | None = None) -> list[Any]:
        """Return the cases without a complete record, in their order.

        Args:
            cases: of the study.
            job: number of this process among those that share the folder. The first one, and one that shares it with
                nobody, forgets what failed before, so that it is tried again.

        Raises:
            BadInput: as :meth:`find`, before anything is changed.
        """
        present = set(os.listdir(self.folder)) if self.folder.is_dir() else set()
        missing = []
        for case in cases:  # a folder is listed faster than it is asked for one file after the other
            record = self.find(case) if self._path(case).name in present else None
            if record is None or not self.is_complete(case, record):
                missing.append(case)
        for case in missing if not job else ():
            self._path(case, FAILED).unlink(missing_ok=True)
        return missing

    def all_of(self, cases: Sequence[Case], say: Callable[[str], None]) -> list[Record]:
        """Return the record of every case; none, and a line for ``say``, while other processes run some of them.

        Raises:
            MachineFailure: cases failed; the others have their records.
        """
        ended = [self.ended(case) for case in cases]
        if left := sum(one is None for one in ended):
            say(f"{left} of {len(ended)} cases are run by other processes, the last of which sums up")
            return []
        if failures := [one for one in ended if isinstance(one, FailedCase)]:
            raise MachineFailure(f"{len(failures)} of {len(ended)} cases failed; {failures[0]}")
        return [one for one in ended if one is not None and not isinstance(one, FailedCase)]

    def read(self) -> list[Record]:
        """Return all records, in the order of their names; none if there is no folder; raises BadInput."""
        return [self._read(path) for path in sorted(self.folder.glob("[!.]*.json"))]

    def failures(self) -> list[FailedCase]:
        """Return what failed, in the order of the names; raises BadInput."""
        return [read_json(path, FailedCase) for path in sorted((self.folder / FAILED).glob("[!.]*.json"))]

    @contextmanager
    def claims(self) -> Iterator[Claims]:
        """Open the claims on these cases until the block ends."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with (self.folder / ".claims").open("a+") as file:
            yield Claims(file)

    def _path(self, case: Case, *folders: str) -> Path:
        return self.folder.joinpath(*folders, f"{case.name}.json")

    def _read(self, path: Path) -> Record:
        try:
            return read_json(path, self.model)
        except BadInput as error:
            raise BadInput(f"{error}; not a record of this study, move it elsewhere") from error


@dataclass
class Claims:
    """Which process runs which case: no two run the same, on whatever machines they are.

    A claim is a lock on one byte of a file, whose place is the case's digest. The operating system lifts it when its
    process ends, however it ends, also on another machine of a network file system. It leaves nothing to be removed.

    Attributes:
        file: that is locked in places. Each process opens it once: closing it lifts all of its locks. Where the file
            system knows no locks, every claim is granted.
    """

    file: IO[str]

    def take(self, case: Case) -> bool:
        """Claim a case; return False where another process has."""
        try:
            fcntl.lockf(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _place(case))
        except (BlockingIOError, PermissionError):
            return False
        except OSError:  # a file system without locks
            pass
        return True

    def release(self, case: Case) -> None:
        """Give a case free that this process has claimed."""
        with suppress(OSError):
            fcntl.lockf(self.file, fcntl.LOCK_UN, 1, _place(case))


def _place(case: Case) -> int:
    return int(case.digest[:15], 16)  # less than 2**63, the largest place in a file


def _difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Return in words in which setting two descriptions of a case differ."""
    old, new = ({**content, **content.get("settings", {})} for content in (before, now))
    for key, value in new.items():
        if key not in ("digest", "settings", "sci_lightning") and old.get(key) != value:
            return f"{key}={old.get(key)}, now {value}"
    return "what it depends on has changed, though no setting that it names"
