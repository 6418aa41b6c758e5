"""What frames take by themselves: a clock that stands still while something is made that all frames of a job share."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Concatenate, ParamSpec, Protocol, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class FrameClock:
    """Counts seconds; of one thread."""

    def __init__(self) -> None:
        self._stood = 0.0  # seconds, so far
        self._stands = False

    def now(self) -> float:
        """Seconds since any one moment, without those for which the clock stood."""
        return time.monotonic() - self._stood

    @contextmanager
    def standing(self) -> Iterator[None]:
        """Stands still meanwhile."""
        if self._stands:
            yield
            return
        self._stands, began = True, time.monotonic()
        try:
            yield
        finally:
            self._stands = False
            self._stood += time.monotonic() - began


class _Clocked(Protocol):
    clock: FrameClock


C = TypeVar("C", bound=_Clocked)


def for_all_frames(make: Callable[Concatenate[C, P], T]) -> Callable[Concatenate[C, P], T]:
    """A method whose time is no single frame's: the clock of its object stands still."""

    @wraps(make)
    def apart(self: C, /, *args: P.args, **named: P.kwargs) -> T:
        with self.clock.standing():
            return make(self, *args, **named)

    return apart
