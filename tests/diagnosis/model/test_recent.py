"""The last few results are remembered, also where several threads ask for them at a time."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from sci_lightning.diagnosis.model.recent import Recent


def test_the_last_results_are_remembered() -> None:
    recent, computed = Recent[int](2), []

    def ask(key: int) -> int:
        return recent.get(key, lambda: computed.append(key) or 10 * key)

    assert [ask(key) for key in (1, 2, 1, 3, 1, 2)] == [10, 20, 10, 30, 10, 20]
    assert computed == [1, 2, 3, 2]


def test_threads_may_ask_at_a_time() -> None:
    recent = Recent[int](2)
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda key: recent.get(key % 7, lambda: 10 * (key % 7)), range(5000)))
    assert results == [10 * (key % 7) for key in range(5000)]
