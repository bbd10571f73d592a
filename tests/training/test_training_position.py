"""A training that is killed any number of times ends as one that never was: same steps, weights and optimizer."""

from __future__ import annotations

import itertools
import logging
import random
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.training.training_position import TrainingPosition
from tests.training.small_training import BATCHES, EPOCHS, MOMENTS, Noise, check_chain, same, train


@pytest.fixture
def quiet() -> None:
    warnings.filterwarnings("ignore")
    logging.getLogger("lightning.pytorch").setLevel(logging.ERROR)


@pytest.fixture
def chain(tmp_path: Path, quiet: None) -> Callable[..., None]:
    """``chain([(10, "after the checkpoint"), ..], every=2)`` checks a chain of kills against an uninterrupted run."""
    whole: dict[str, dict[str, Any]] = {}
    number = itertools.count()

    def check(kills: Sequence[tuple[int, str]], **options: Any) -> None:
        plan = repr({key: value for key, value in options.items() if key != "every"})
        if plan not in whole:
            ended = train(tmp_path / plan / "whole", **options)
            assert ended is not None
            whole[plan] = ended
        check_chain(tmp_path / plan / f"chain_{next(number)}", whole[plan], kills, **options)

    return check


def test_two_kills_of_which_the_first_is_at_the_end_of_an_epoch(chain: Callable[..., None]) -> None:
    chain([(10, "after the checkpoint"), (14, "after the checkpoint")])


@pytest.mark.parametrize(
    "kills",
    [
        [(5, "in validation"), (10, "in validation"), (15, "in validation")],
        [(5, "after the epoch"), (6, "before the checkpoint"), (10, "after the epoch"), (15, "after the epoch")],
        [(4, "after the checkpoint"), (4, "after the checkpoint"), (5, "after the checkpoint")],
        [(1, "before the checkpoint"), (15, "before the checkpoint")],
    ],
)
def test_chains_of_kills(chain: Callable[..., None], kills: Sequence[tuple[int, str]]) -> None:
    chain(kills, every=1)


@pytest.mark.parametrize(
    "options",
    [
        {"accumulate_grad_batches": 2},
        {"max_steps": 12, "max_epochs": -1},
        {"val_check_interval": 2},
        {"check_val_every_n_epoch": 2},
        {"limit_train_batches": 4},
    ],
)
def test_chains_with_other_plans(chain: Callable[..., None], options: dict[str, Any]) -> None:
    chain([(5, "after the checkpoint"), (6, "in validation"), (8, "after the checkpoint")], every=1, **options)


def test_with_workers(chain: Callable[..., None]) -> None:
    chain([(10, "after the checkpoint"), (13, "before the checkpoint")], workers=2)


@pytest.mark.slow
def test_every_pair_of_steps_and_long_chains(chain: Callable[..., None]) -> None:
    draw = random.Random(0)
    steps = range(1, BATCHES * EPOCHS + 1)
    pairs = [[(one, MOMENTS[1]), (two, MOMENTS[1])] for one, two in itertools.combinations(steps, 2)]
    chains = [
        [(step, draw.choice(MOMENTS)) for step in sorted(draw.choices(steps, k=draw.randint(1, 4)))] for _ in range(250)
    ]
    plans: list[dict[str, Any]] = [
        {},
        {"accumulate_grad_batches": 2},
        {"max_steps": 12, "max_epochs": -1},
        {"val_check_interval": 2},
        {"check_val_every_n_epoch": 2},
    ]
    for number, kills in enumerate([*pairs, *chains]):
        chain(kills, every=draw.choice((1, 2, 3)), **(plans[0] if number < 200 else plans[number % len(plans)]))


def test_a_finished_training_is_done(tmp_path: Path, quiet: None) -> None:
    ended, again = train(tmp_path), train(tmp_path)
    assert ended is not None and again is not None
    assert again["batches"] == [] and same(ended["state_dict"], again["state_dict"])


def test_a_longer_plan_goes_on_with_the_next_clips(tmp_path: Path, quiet: None) -> None:
    whole = train(tmp_path / "whole")
    train(tmp_path / "two", max_steps=7, max_epochs=-1)
    rest = train(tmp_path / "two")
    assert whole is not None and rest is not None
    assert rest["global_step"] == 15 and rest["batches"] == whole["batches"][7:]


@pytest.mark.parametrize(("options", "key"), [({"max_epochs": 2}, "max_epochs=2"), ({"max_steps": 14}, "max_steps=14")])
def test_a_checkpoint_beyond_the_plan(tmp_path: Path, quiet: None, options: dict[str, int], key: str) -> None:
    train(tmp_path)
    with pytest.raises(BadInput, match=rf"15 .* 3: .*trainer\.{key}"):
        train(tmp_path, **options)


def test_another_number_of_batches(tmp_path: Path, quiet: None, monkeypatch: pytest.MonkeyPatch) -> None:
    train(tmp_path, 4)
    monkeypatch.setattr(Noise, "__len__", lambda self: 6)
    with pytest.raises(BadInput, match="an epoch had 5 batches, now it has 6"):
        train(tmp_path)


@pytest.mark.parametrize(
    ("steps", "validated", "accumulate", "place"),
    [(0, True, 1, (0, 0)), (4, False, 1, (0, 4)), (5, False, 1, (0, 5)), (5, True, 1, (1, 0)), (4, True, 2, (1, 2))],
)
def test_place(steps: int, validated: bool, accumulate: int, place: tuple[int, int]) -> None:
    assert TrainingPosition(steps, 5, validated).place(accumulate) == place


@pytest.mark.parametrize(
    "position", [None, [], {}, {"steps": -1}, {"steps": True, "batches_per_epoch": 5}, {"steps": 2**70}]
)
def test_positions_that_are_none(position: Any) -> None:
    with pytest.raises(BadInput, match=r"a\.ckpt: damaged: .*steps"):
        TrainingPosition.read("a.ckpt", {"position": position}, 5)
