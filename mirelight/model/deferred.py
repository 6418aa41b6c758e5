"""Things that are read when they are first needed, and told apart before."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Generic, TypeVar

from mirelight.model.digests import digest

T = TypeVar("T")


class Deferred(Generic[T]):
    """Something large that a job names: its digest is known at once, its value is read when first asked for.

    A job made of these is small, so it can be planned and sent to another process without its arrays.

    Args:
        digest: SHA-256 (hex) over all that decides the value: file contents, placement, options of reading.
        read: gives the value; must give the same one each time, and be picklable for a job that is.
        keep: whether the value is kept once it was read. Otherwise `read` is asked each time, and may keep some itself.
    """

    __slots__ = ("_digest", "_keep", "_read", "_value")

    def __init__(self, digest: str, read: Callable[[], T], *, keep: bool = True) -> None:
        self._digest: str | None = digest
        self._read = read
        self._keep = keep
        self._value: T | None = None

    @staticmethod
    def of(value: T) -> Deferred[T]:
        """Something that is there already; its digest is taken when asked for."""
        made = Deferred("", partial(_itself, value))
        made._digest = None
        made._value = value
        return made

    @property
    def digest(self) -> str:
        """SHA-256 (hex); equal digests mean equal values."""
        if self._digest is None:
            self._digest = digest(self.value)
        return self._digest

    @property
    def value(self) -> T:
        """The thing itself, read now if it was not yet.

        Raises:
            InputError: a file that it comes from cannot be used.
        """
        if self._value is not None:
            return self._value
        value = self._read()
        if self._keep:
            self._value = value
        return value

    @property
    def is_there(self) -> bool:
        """Whether the value is known without reading anything."""
        return self._value is not None

    def supply(self, value: T) -> None:
        """Hand it the value that it would read, where it was kept from an earlier time."""
        self._value = value

    def __reduce__(self) -> tuple[object, ...]:
        return _restored, (self.digest, self._read, self._keep)

    def __repr__(self) -> str:
        return f"Deferred({self.digest[:12]}, {'there' if self._value is not None else 'not read yet'})"


def _restored(digest: str, read: Callable[[], T], keep: bool) -> Deferred[T]:
    return Deferred(digest, read, keep=keep)


def _itself(value: T) -> T:
    return value
