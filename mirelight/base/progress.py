"""What hears how far a piece of work is: the two shapes that calls of every room take.

What a listener raises ends the work in order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias, TypeVar

Item = TypeVar("Item")
CountProgress: TypeAlias = Callable[[int, int], None]  # samples, pictures or files that are done, and all of them
ShareProgress: TypeAlias = Callable[[str, float], None]  # what is being done; how much of the whole is done, 0 to 1


def quiet(what: str, done: float) -> None:
    """A `ShareProgress` that says nothing."""


def part(progress: ShareProgress, low: float, high: float) -> ShareProgress:
    """Tells 0..1 of a step as low..high of the whole."""

    def report(what: str, done: float) -> None:
        progress(what, low + (high - low) * done)

    return report


def counted(progress: ShareProgress, what: str) -> CountProgress:
    """Tells counts as shares of a whole that is called `what`."""

    def report(done: int, total: int) -> None:
        progress(what, done / max(total, 1))

    return report


def passed(items: Sequence[Item], progress: ShareProgress, what: str) -> Iterator[Item]:
    """The items one after another; each is told of when it is begun."""
    for done, item in enumerate(items):
        progress(what, done / len(items))
        yield item
