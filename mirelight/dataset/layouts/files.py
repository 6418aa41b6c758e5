"""The files of a data set: each appears whole or not at all, and is made again only where what it is made from changed.

`.mirelight/export.jsonl` in the data set's folder says of each file what it was made from and how large it is, so that
an export that was interrupted goes on, and one whose job has grown adds what is new. Files of an earlier export that
are not part of this one are removed at its end.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mirelight.base.png import png_bytes
from mirelight.dataset.layouts.pictures import Picture
from mirelight.io import exr
from mirelight.io.atomic import atomic_path, clear, output_error
from mirelight.io.folders import NewFolders
from mirelight.io.safety import read_file

RECORD = Path(".mirelight") / "export.jsonl"


@dataclass(frozen=True, slots=True)
class FrameRow:
    """A frame of the set."""

    frame: str  # lighting and camera
    view: str
    lighting: str
    part: str
    image: str  # its file, or the shard that holds it
    linear: str  # file of the linear picture; "": none
    sample: str  # key in the shard; "": it is a file of its own
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class _Row:
    key: str
    bytes: int


class Files:
    """What an export writes to.

    Args:
        folder: of the data set; made where it is missing.
        heard: called with the name of each frame that is there, and whether it was before.

    Raises:
        OutputError: it cannot be written.
    """

    def __init__(self, folder: Path, heard: Callable[[str, bool], None] | None = None) -> None:
        self.folder = folder
        self.made = 0  # files that were not there before
        self.frames: list[FrameRow] = []
        self._heard, self._before = heard, 0
        self._looked_at: set[Path] = set()  # folders
        self._enter(folder)
        self._enter(folder / RECORD.parent)
        self._rows = self._read()
        self._wanted: dict[str, None] = {}
        try:
            self._record = (folder / RECORD).open("a", encoding="utf-8", newline="\n")
        except OSError as e:
            raise output_error(folder / RECORD, e) from None

    def __enter__(self) -> Files:
        return self

    def __exit__(self, *_: object) -> None:
        self._record.close()

    def has(self, name: str, key: str) -> bool:
        """Whether that file is there, made from that."""
        row = self._rows.get(name)
        if row is None or row.key != key:
            return False
        try:
            return (self.folder / name).stat().st_size == row.bytes
        except OSError:
            return False

    def put(self, name: str, key: str, write: Callable[[Path], object]) -> None:
        """A file of the set, written unless it is there.

        Args:
            name: its path in the folder, with "/".
            key: digest of what it is made from; "": unknown, so it is always made.
            write: writes it to a path of the same suffix.

        Raises:
            OutputError: it cannot be written.
        """
        self._wanted[name] = None
        path = self.folder / name
        self._enter(path.parent)
        if key and self.has(name, key):
            return
        if name in self._rows:  # made from something else; gone before its row could be taken for the new one's
            path.unlink(missing_ok=True)
        with atomic_path(path) as temporary:
            write(temporary)
        self.made += 1
        self._note(name, _Row(key, path.stat().st_size))

    def text(self, name: str, text: str) -> None:
        """Write a text file."""
        self.bytes(name, text.encode())

    def bytes(self, name: str, data: bytes) -> None:
        """A file of these bytes."""
        self.put(name, hashlib.sha256(data).hexdigest(), lambda path: path.write_bytes(data))

    def json(self, name: str, value: Any) -> None:
        """Write a JSON file."""
        self.text(name, json.dumps(value, indent=1, allow_nan=False, ensure_ascii=False) + "\n")

    def png(self, name: str, key: str, pixels: Callable[[], NDArray[Any]]) -> None:
        """A PNG of (H, W, 3 or 4) or (H, W) uint8, or of (H, W) uint16."""
        self.put(name, key, lambda path: write_pixels(path, pixels()))

    def exr(self, name: str, key: str, pixels: Callable[[], NDArray[np.float32]]) -> None:
        """An OpenEXR of (H, W, 3 or 4) float32, its data window the whole picture: some loaders know no other."""
        self.put(name, key, lambda path: exr.write_exr(path, {"": pixels()}, crop=False))

    def npy(self, name: str, key: str, values: Callable[[], NDArray[Any]]) -> None:
        """An array of any shape in NumPy's format."""
        self.put(name, key, lambda path: _save(path, values()))

    def frame(
        self, picture: Picture, image: str, linear: str = "", sample: str = "", *, made: bool | None = None
    ) -> None:
        """All files of a frame are there.

        Args:
            picture: the frame.
            image: its file, or the shard that holds it.
            linear: file of the linear picture; "": none.
            sample: key in the shard.
            made: whether it was made now; None: if any file was since the frame before.
        """
        name = f"{picture.lighting}/{picture.view}" if picture.lighting else picture.view
        size = picture.camera.width, picture.camera.height
        row = FrameRow(name, picture.view, picture.lighting, picture.part, image, linear, sample, *size)
        self.frames.append(row)
        skipped, self._before = self.made == self._before if made is None else not made, self.made
        if self._heard is not None:
            self._heard(name, skipped)

    def names(self) -> list[str]:
        """The files of the set so far, sorted."""
        return sorted(self._wanted)

    def finish(self) -> None:
        """Remove what an earlier export has left here, and write the record anew."""
        for name in self._rows.keys() - self._wanted.keys():
            with suppress(OSError):
                (self.folder / name).unlink()
            with suppress(OSError):
                for parent in list((self.folder / name).parents)[: name.count("/")]:
                    parent.rmdir()  # ends at the first that holds something
        self._rows = {name: row for name, row in self._rows.items() if name in self._wanted}
        with atomic_path(self.folder / RECORD) as temporary:
            lines = (_line(name, self._rows[name]) for name in sorted(self._rows))
            temporary.write_text("".join(lines), encoding="utf-8", newline="\n")

    def _enter(self, folder: Path) -> None:
        """A folder to write into, made where it is missing; what a killed export left there is cleared away."""
        if folder not in self._looked_at:
            self._looked_at.add(folder)
            NewFolders(folder).make()
            clear(folder)

    def _note(self, name: str, row: _Row) -> None:
        self._rows[name] = row
        try:
            self._record.write(_line(name, row))
            self._record.flush()
        except OSError as e:
            raise output_error(self.folder / RECORD, e) from None

    def _read(self) -> dict[str, _Row]:
        out: dict[str, _Row] = {}
        try:
            text = read_file(self.folder / RECORD).decode()
        except (OSError, ValueError):
            return out
        for line in text.splitlines():
            with suppress(ValueError, KeyError, TypeError, RecursionError):  # a torn line
                data = json.loads(line)
                name = str(data["file"])
                if not Path(name).is_absolute() and ".." not in Path(name).parts:
                    out[name] = _Row(str(data["key"]), int(data["bytes"]))
        return out


def _line(name: str, row: _Row) -> str:
    return json.dumps({"file": name, "key": row.key, "bytes": row.bytes}) + "\n"


def write_pixels(path: Path | BinaryIO, pixels: NDArray[Any]) -> None:
    """A PNG of (H, W, 3 or 4) or (H, W) uint8, or of (H, W) uint16."""
    if pixels.ndim == 3:
        data = png_bytes(np.ascontiguousarray(pixels), {})
        if isinstance(path, Path):
            path.write_bytes(data)
        else:
            path.write(data)
        return
    from PIL import Image

    Image.fromarray(np.ascontiguousarray(pixels)).save(path, format="PNG")


def _save(path: Path, values: NDArray[Any]) -> None:
    with path.open("wb") as stream:
        np.save(stream, values, allow_pickle=False)
