"""The relay's queue: which trainings are wanted of a GPU that is there for minutes, and what each has got so far."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Annotated, Literal

from annotated_types import Len
from pydantic import AfterValidator, StringConstraints

from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import JsonFile, JsonObject, says
from sci_lightning.runs.results import MOST, Scores

Word = Annotated[str, StringConstraints(min_length=1, max_length=1000)]


class Lease(JsonObject):
    """What one lease gave to a training."""

    date: str = says("of its end, 2026-11-22")
    machine: str = says("that computed it")
    commit: str = says("of the program")
    seconds: float = says("of training; start and test are not counted", ge=0)
    steps: int = says("of the optimizer", ge=0, le=MOST)
    clips: int = says("that the training saw", ge=0, le=MOST)
    finished: bool = says(
        "whether the learning rates fell and a test followed; else it was cut off after that checkpoint"
    )
    overhead: float = says("seconds for its start and its test, if it was tested", default=0.0, ge=0)
    weights: str = says("in which the next lease gets what was learned; the optimizer begins anew", default="")
    mean: Scores = says("of the test after it", default={})
    scenes: dict[str, Scores] = says("of the test after it, by scene", default={})


class RelayTraining(JsonObject):
    """One entry of the queue: a training that goes on in every lease, or another command that runs to its end once."""

    name: Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9_]{0,99}$")] = says("of its files")
    what: str = says("in words for a reader")
    command: Literal["train", "tables.rows", "benchmark"] = says("that is run")
    recipe: Annotated[list[Word], Len(1, 100)] = says("overrides of the command")
    wanted: float = says("seconds of training in all; 0 of a command that ends by itself", default=0.0, ge=0)
    at_once: int = says("entries of this number that may share the GPU", default=1, ge=1, le=64)
    leases: list[Lease] = says("that it has got", default=[])

    @property
    def is_done(self) -> bool:
        """Whether it has got what is wanted."""
        if self.command != "train":
            return any(lease.finished for lease in self.leases)
        return sum(lease.seconds for lease in self.leases) >= self.wanted

    def given(self, lease: Lease, number: int) -> RelayTraining:
        """Return it with that lease in place ``number``, from 0, of its leases."""
        return self.model_copy(update={"leases": [*self.leases[:number], lease]})


def _names_differ(trainings: list[RelayTraining]) -> list[RelayTraining]:
    if len({training.name for training in trainings}) < len(trainings):
        raise ValueError("two of one name, whose files would be the same")
    return trainings


class RelayQueue(JsonFile):
    """``docs/results/relay.json``."""

    format: Literal["sci-relay"] = "sci-relay"
    format_version: Literal[1] = 1
    trainings: Annotated[list[RelayTraining], Len(1, 1000), AfterValidator(_names_differ)] = says(
        "in the order in which they are wanted"
    )

    def training(self, name: str) -> RelayTraining:
        """Return the training of a name."""
        return next(training for training in self.trainings if training.name == name)

    def following(self, without: set[str]) -> list[RelayTraining]:
        """Return the next training that is not done, and those after it that may share the GPU with it.

        Args:
            without: names that are passed over.
        """
        left = [training for training in self.trainings if not training.is_done and training.name not in without]
        return [training for training in left if training.at_once == left[0].at_once][: left[0].at_once] if left else []

    def given(self, name: str, lease: Lease, number: int) -> RelayQueue:
        """Return the queue with that lease in place ``number``, from 0, of a training's leases."""
        changed = [one.given(lease, number) if one.name == name else one for one in self.trainings]
        return self.model_copy(update={"trainings": changed})

    def check_follows(self, earlier: RelayQueue) -> None:
        """Check that this queue wants what an earlier one wants, and has whatever that has.

        Raises:
            BadInput: other recipes, which are nothing that an archive may bring, or another machine has trained in
                between, so that leases would be lost.
        """
        wanted, brought = ([one.model_copy(update={"leases": []}) for one in q.trainings] for q in (earlier, self))
        if wanted != brought:
            raise BadInput("its trainings are not those of this queue: recipes come from the repository alone")
        for before, now in zip(earlier.trainings, self.trainings, strict=True):
            done = [lease for lease in before.leases if lease.finished]
            if now.leases[: len(done)] != done:
                raise BadInput(
                    f"{before.name}: has leases here that the other queue does not have; take them there first"
                )


def inner_path(name: str) -> PurePosixPath:
    """Return the path of a file in an archive, relative and without steps upwards.

    Raises:
        BadInput: it leads elsewhere.
    """
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\\" in name or not path.parts:
        raise BadInput(f"{name!r}: a name that leads out of the folders of the relay")
    return path
