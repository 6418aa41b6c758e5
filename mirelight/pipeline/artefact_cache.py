"""Where what frames are made from is found and kept between runs. `mirelight.store.Store.artefacts` is such a place."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Protocol, TypeVar

from mirelight.pipeline.codecs import Codec, Packed

T = TypeVar("T")

WAIT = 0.25  # seconds between two looks at what another process makes


class ArtefactCache(Protocol):
    """A place for artefacts, each under the key of what it is made from."""

    def get(self, key: str, codec: Codec[T]) -> T | None:
        """A kept artefact; None where there is none, or it is damaged."""

    def put(self, key: str, value: T, codec: Codec[T]) -> None:
        """Keep an artefact under its key, where that can be."""

    def has(self, key: str, codec: Codec[T]) -> bool:
        """Whether there is one, damaged or not."""

    def claim(self, name: str) -> AbstractContextManager[bool]:
        """Whether work of that name is this process's own until the block ends."""


def made_once(cache: ArtefactCache, name: str, key: str, codec: Codec[T], make: Callable[[], T]) -> T:
    """What is kept, or made now and kept; one process makes it, and others wait.

    Args:
        cache: the place that is shared.
        name: of the work, for its claim.
        key: of the artefact.
        codec: its kind.
        make: makes it.
    """
    while True:
        found = cache.get(key, codec)
        if found is not None:
            return found
        with cache.claim(name) as mine:
            if mine:
                found = cache.get(key, codec)  # made while the claim was taken
                if found is None:
                    found = make()
                    cache.put(key, found, codec)
                return found
        time.sleep(WAIT)


class MemoryCache:
    """Keeps what is of views in memory, the newest of it; everything else where `beneath` keeps it.

    Args:
        beneath: another place.
        most: bytes in memory.
    """

    def __init__(self, beneath: ArtefactCache, most: int = 2**30) -> None:
        self._beneath, self._most = beneath, most
        self._views: OrderedDict[str, Packed] = OrderedDict()

    def get(self, key: str, codec: Codec[T]) -> T | None:
        """As :class:`ArtefactCache` describes it."""
        if codec.place != "view":
            return self._beneath.get(key, codec)
        found = self._views.get(key)
        if found is None:
            return None
        self._views.move_to_end(key)
        return codec.unpack(found)

    def put(self, key: str, value: T, codec: Codec[T]) -> None:
        """The oldest view goes where there is more than may be kept."""
        if codec.place != "view":
            self._beneath.put(key, value, codec)
            return
        self._views[key] = codec.pack(value)
        self._views.move_to_end(key)
        while len(self._views) > 1 and sum(x.nbytes for x in self._views.values()) > self._most:
            self._views.popitem(last=False)

    def has(self, key: str, codec: Codec[T]) -> bool:
        """As :class:`ArtefactCache` describes it."""
        return key in self._views if codec.place == "view" else self._beneath.has(key, codec)

    def claim(self, name: str) -> AbstractContextManager[bool]:
        """As :class:`ArtefactCache` describes it."""
        return self._beneath.claim(name)


class NullCache:
    """A cache that keeps nothing."""

    def get(self, key: str, codec: Codec[T]) -> T | None:
        """Never finds anything."""
        return None

    def put(self, key: str, value: T, codec: Codec[T]) -> None:
        """Keeps nothing of the value."""

    def has(self, key: str, codec: Codec[T]) -> bool:
        """Never finds anything."""
        return False

    def claim(self, name: str) -> AbstractContextManager[bool]:
        """Always has the claim: there is no other process."""
        return nullcontext(True)
