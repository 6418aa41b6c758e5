"""Keeps what scenes are made of: the colours of a shipped proxy are found once for all tests, in whatever process."""

from __future__ import annotations

import pickle
import secrets
from pathlib import Path
from typing import TypeVar

from mirelight.pipeline.artefact_cache import NullCache
from mirelight.pipeline.codecs import Codec, Packed

T = TypeVar("T")


class Shelf(NullCache):
    """Keeps everything in memory, and in a folder once it has one, which processes share."""

    folder: Path | None = None

    def __init__(self) -> None:
        self.packed: dict[str, Packed] = {}

    def get(self, key: str, codec: Codec[T]) -> T | None:
        file = None if self.folder is None else self.folder / key
        if key not in self.packed and file is not None and file.exists():
            self.packed[key] = pickle.loads(file.read_bytes())
        return codec.unpack(self.packed[key]) if key in self.packed else None

    def put(self, key: str, value: T, codec: Codec[T]) -> None:
        self.packed[key] = codec.pack(value)
        if self.folder is not None:
            self.folder.mkdir(exist_ok=True)
            made = self.folder / secrets.token_hex(8)
            made.write_bytes(pickle.dumps(self.packed[key]))
            made.replace(self.folder / key)


SHIPPED = Shelf()  # of the shipped scenes
