"""Keeps what scenes are made of in memory: the colours of a shipped proxy are found once for all tests of a process."""

from __future__ import annotations

from typing import TypeVar

from mirelight.pipeline.artefact_cache import NullCache
from mirelight.pipeline.codecs import Codec, Packed

T = TypeVar("T")


class Shelf(NullCache):
    """Keeps everything."""

    def __init__(self) -> None:
        self.packed: dict[str, Packed] = {}

    def get(self, key: str, codec: Codec[T]) -> T | None:
        return codec.unpack(self.packed[key]) if key in self.packed else None

    def put(self, key: str, value: T, codec: Codec[T]) -> None:
        self.packed[key] = codec.pack(value)


SHIPPED = Shelf()  # of the shipped scenes
