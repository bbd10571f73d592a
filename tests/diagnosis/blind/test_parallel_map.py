"""Work on several threads gives the same results in the same order, and leaves the number of threads as it was."""

from __future__ import annotations

import time
from collections.abc import Iterator
from threading import get_ident

import pytest
import torch

from sci_lightning.diagnosis.blind.parallel_map import on_every_core
from tests.diagnosis.blind.smooth_scenes import likelihood_of, snapshots


@pytest.fixture(params=[1, 2])
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


def test_results_in_order(threads: int) -> None:
    def part(number: int) -> tuple[int, int, int, bool]:
        inner = on_every_core(lambda one: one + 1, [number])  # inside a part there is one thread
        return inner[0], get_ident(), torch.get_num_threads(), torch.is_grad_enabled()

    results = on_every_core(part, range(20))
    assert [number for number, *_ in results] == list(range(1, 21))
    assert all(inside == 1 for *_, inside, _ in results)
    assert not any(differentiated for *_, differentiated in results)
    if threads > 1:
        assert get_ident() not in {thread for _, thread, *_ in results}
    assert torch.get_num_threads() == threads


def test_an_error_ends_the_work(threads: int) -> None:
    with pytest.raises(ZeroDivisionError):
        on_every_core(lambda number: 1 // number, [1, 0, 2])
    assert torch.get_num_threads() == threads


def test_the_likelihood_does_not_depend_on_threads() -> None:
    before, nats = torch.get_num_threads(), []
    for number in (1, 2):
        torch.set_num_threads(number)
        likelihood, ideal = likelihood_of(snapshots())
        nats.append(likelihood.evaluate(ideal).log_likelihood.nan_to_num())
    torch.set_num_threads(before)
    assert torch.allclose(*nats, atol=1e-8)


def test_as_many_parts_at_a_time_as_are_allowed(threads: int) -> None:
    """One part at a time has all threads to itself; an inference stays one."""
    with torch.inference_mode():
        results = on_every_core(lambda _: (torch.get_num_threads(), torch.is_inference_mode_enabled()), range(3), 1)
        assert results == [(threads, True)] * 3
        assert on_every_core(lambda _: torch.is_inference_mode_enabled(), range(3)) == [True] * 3


def test_parts_that_have_not_begun_are_left_out(threads: int) -> None:
    """An error while the parts are handed out ends the work; those that run are waited for."""
    begun = []

    def parts() -> Iterator[int]:
        yield from range(50)
        raise ValueError("no more parts")

    def part(number: int) -> None:
        begun.append(number)
        time.sleep(0.01)

    with pytest.raises(ValueError, match="no more parts"):
        on_every_core(part, parts())
    assert len(begun) < 50 or threads == 1
    assert torch.get_num_threads() == threads
