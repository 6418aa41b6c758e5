"""Work by several threads at once."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from mirelight.base import together
from mirelight.base.together import each


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_results_come_in_the_order_of_items(monkeypatch: pytest.MonkeyPatch, threads: int) -> None:
    monkeypatch.setattr(together, "_threads", lambda: threads)
    assert each(lambda k: k * k, range(40)) == [k * k for k in range(40)]
    assert each(lambda k: k, []) == []


def test_whoever_waits_hears_of_each_and_may_end_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(together, "_threads", lambda: 2)
    heard: list[tuple[str, float]] = []
    each(lambda k: k, range(4), lambda what, done: heard.append((what, done)), "counting")
    assert heard == [("counting", 0.25), ("counting", 0.5), ("counting", 0.75), ("counting", 1.0)]

    def stop(what: str, done: float) -> None:
        raise KeyboardInterrupt

    begun: list[int] = []

    def do(k: int) -> None:
        begun.append(k)
        time.sleep(0.01)

    with pytest.raises(KeyboardInterrupt):
        each(do, range(1000), stop)
    assert len(begun) < 1000


def test_several_are_at_work_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(together, "_threads", lambda: 2)
    met = threading.Barrier(2, timeout=30)  # one after the other, the first would wait in vain
    assert len(each(lambda _: met.wait(), range(2))) == 2


def test_the_first_failure_is_raised_and_nothing_more_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(together, "_threads", lambda: 1)
    begun = []

    def do(k: int) -> int:
        begun.append(k)
        if k == 2:
            raise ValueError(f"item {k}")
        time.sleep(0.01 if k > 2 else 0)  # or all are done before the failure is heard of
        return k

    with pytest.raises(ValueError, match="item 2"):
        each(do, range(1000))
    assert len(begun) < 1000


def test_dot_products_have_the_bits_of_numpys_sums() -> None:
    from mirelight.proxy.views import dot, length

    chance = np.random.default_rng(1)
    a, b = chance.standard_normal((2, 500, 3))
    for kind in (np.float32, np.float64):
        x, y = a.astype(kind), b.astype(kind)
        np.testing.assert_array_equal(dot(x, y), (x * y).sum(axis=1))
        np.testing.assert_array_equal(dot(x, y[0]), (x * y[0]).sum(axis=1))
        assert dot(x, y).dtype == kind
        np.testing.assert_array_equal(length(x), np.linalg.norm(x, axis=1))
