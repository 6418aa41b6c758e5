"""Work on many arrays at once, by threads: numpy and SciPy let others run while they compute."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from mirelight.base.machine import cores
from mirelight.base.progress import ShareProgress, quiet

Item = TypeVar("Item")
Result = TypeVar("Result")


def each(
    do: Callable[[Item], Result], items: Iterable[Item], progress: ShareProgress = quiet, what: str = ""
) -> list[Result]:
    """What is made of every item, in the items' order, several at a time.

    Results do not depend on how many threads there are: as many as Dr.Jit has, which settings decide; every core where
    it is not loaded. `do` must not call Dr.Jit, whose arrays belong to one thread, nor change what another item reads.
    `progress` hears of each that is there, from this thread, by the name of `what` is done.

    Raises:
        Exception: the first that `do` raises, in the items' order; what has not begun by then is not begun.
    """
    pool = ThreadPoolExecutor(_threads(), thread_name_prefix="mirelight")
    try:
        wanted, made = list(items), list[Result]()
        for result in pool.map(do, wanted):
            made.append(result)
            progress(what, len(made) / len(wanted))
        return made
    finally:
        pool.shutdown(cancel_futures=True)


def _threads() -> int:
    loaded = sys.modules.get("drjit")  # not imported for this: it takes a while, and some of this needs none of it
    return max(int(loaded.thread_count()), 1) if loaded else cores()
