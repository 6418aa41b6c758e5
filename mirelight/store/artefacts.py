"""What frames are made from, kept for the next run: traced unit lights, and arrays that are made once a scene.

Nothing is compressed: reading must cost next to nothing beside tracing.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar

from mirelight.base.errors import OutputError
from mirelight.pipeline.codecs import Codec, Packed
from mirelight.store.arrays import maker_of, read_arrays, write_arrays

T = TypeVar("T")
Keeps: TypeAlias = Literal["frames", "layers", "both"]  # `output.store` of a job

_MOST_UNUSED = 2 * 2**30  # bytes of what the job does not use now, kept in case it does again
_BROKEN = (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError, RecursionError)
_LIGHT = ".light"  # suffix of buffers, composites and light on the surface
_ARRAY = ".array"  # suffix of arrays and meshes


class Artefacts:
    """Files named by their keys.

    Args:
        folder: their place.
        maker: the job that they are made for, as a word; empty: nothing is made here, and what is read is not touched.
    """

    def __init__(self, folder: Path, maker: str = "") -> None:
        self._folder, self._maker = folder, maker
        self.tell: Callable[[str], None] = lambda line: None  # hears of files that are damaged

    def get(self, key: str, codec: Codec[T]) -> T | None:
        """A kept artefact; None where there is none, or it is damaged."""
        self._touch(key, codec)
        return self._read(self._path(key, _suffix(codec)), codec.unpack)

    def put(self, key: str, value: T, codec: Codec[T]) -> None:
        """Writes an artefact under its key.

        Raises:
            OutputError: it cannot be written.
        """
        packed = codec.pack(value)
        write_arrays(self._path(key, _suffix(codec)), packed.arrays, packed.about, self._maker)

    def has(self, key: str, codec: Codec[T]) -> bool:
        """Whether there is one, damaged or not."""
        self._touch(key, codec)
        return self._path(key, _suffix(codec)).is_file()

    def is_whole(self, key: str) -> bool:
        """Whether such a composite or buffer is there, its bytes those that were written."""
        return self._read(self.path(key), lambda packed: True) or False

    def path(self, key: str) -> Path:
        """The file of a composite or buffer."""
        return self._path(key, _LIGHT)

    def there(self) -> frozenset[str]:
        """Keys of the composites and buffers that are kept."""
        try:
            with os.scandir(self._folder) as entries:
                return frozenset(x.name.removesuffix(_LIGHT) for x in entries if x.name.endswith(_LIGHT))
        except OSError:
            return frozenset()

    def files(self) -> list[Path]:
        """Paths of all artefacts, sorted."""
        try:
            with os.scandir(self._folder) as entries:
                return sorted(Path(x.path) for x in entries if x.name[0] != "." and x.name.endswith((_LIGHT, _ARRAY)))
        except OSError:
            return []

    def tidy(self, used: Collection[str], since: float) -> None:
        """Remove the oldest of what this job made and does not use, but for a reserve. What others made stays.

        Args:
            used: keys that stay.
            since: whatever was made, read or asked for after that time stays, too.
        """
        unused = []
        for path in self.files():
            with suppress(OSError):
                status = path.stat()
                if path.stem not in used and status.st_mtime < since:
                    unused.append((status.st_mtime_ns, status.st_size, path))
        if sum(size for _, size, _ in unused) <= _MOST_UNUSED:
            return
        kept = 0
        for _, size, path in sorted(unused, reverse=True):
            if maker_of(path) != self._maker:
                continue
            kept += size
            if kept > _MOST_UNUSED:
                with suppress(OSError):
                    path.unlink()

    def _path(self, key: str, suffix: str) -> Path:
        return self._folder / f"{key}{suffix}"

    def _touch(self, key: str, codec: Codec[T]) -> None:
        """Note that what a scene needs is in use."""
        if self._maker and codec.place == "scene":
            with suppress(OSError):
                os.utime(self._path(key, _ARRAY))

    def _read(self, path: Path, made: Callable[[Packed], T]) -> T | None:
        try:
            return made(read_arrays(path))
        except FileNotFoundError:
            return None
        except _BROKEN:
            self.tell(f"{path} is damaged; what it held is made again")
            return None


class StoredArtefacts:
    """An output folder's artefacts as a `mirelight.pipeline.artefact_cache.ArtefactCache`.

    Args:
        scene: the folder of what scenes need.
        light: that of light and composites.
        views: what is kept of views: none where frames alone are, and it must be written where layers alone are.
        claim: see `mirelight.store.claims.Claims.claim`.
    """

    def __init__(
        self, scene: Artefacts, light: Artefacts, views: Keeps, claim: Callable[[str], AbstractContextManager[bool]]
    ) -> None:
        self._scene, self._light, self._views, self._claim = scene, light, views, claim

    def get(self, key: str, codec: Codec[T]) -> T | None:
        """A kept artefact; None where there is none, or it is damaged."""
        return self._home(codec).get(key, codec)

    def put(self, key: str, value: T, codec: Codec[T]) -> None:
        """Keep an artefact; where there is no room, frames go on without, and it is made again the next time.

        Raises:
            OutputError: layers alone are kept, and one cannot be written.
        """
        if codec.place == "view" and self._views == "layers":
            self._light.put(key, value, codec)
        elif codec.place != "view" or self._views == "both":
            with suppress(OutputError):
                self._home(codec).put(key, value, codec)

    def has(self, key: str, codec: Codec[T]) -> bool:
        """Whether there is one, damaged or not."""
        return self._home(codec).has(key, codec)

    def claim(self, name: str) -> AbstractContextManager[bool]:
        """Whether work of that name is this process's own until the block ends."""
        return self._claim(name)

    def _home(self, codec: Codec[T]) -> Artefacts:
        return self._scene if codec.place == "scene" else self._light


def _suffix(codec: Codec[T]) -> str:
    return _ARRAY if codec.place == "scene" else _LIGHT
