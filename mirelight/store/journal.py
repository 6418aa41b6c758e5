"""What was made, as rows: one file a process, a line a frame. Readers merge them all, skip a torn last line, and count
what is no row."""

from __future__ import annotations

import json
import math
import os
import secrets
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from io import BufferedReader
from pathlib import Path
from typing import Any

from mirelight.io import owner
from mirelight.io.atomic import output_error
from mirelight.io.safety import open_file


@dataclass(frozen=True, slots=True)
class FileRow:
    """One file as it was when it was written."""

    key: str  # digest of what it was made from
    bytes: int
    mtime_ns: int
    sha256: str  # hex


@dataclass(frozen=True, slots=True)
class Row:
    """One finished frame, or one that failed."""

    frame: str  # its name, "camera.lighting"
    files: Mapping[str, FileRow]  # by suffix; none where it failed
    seconds: float  # that it took, what its camera's frames share included, but not what all frames do
    error: str = ""  # what went wrong, the first or last line for people
    wanted: Mapping[str, str] = field(default_factory=dict)  # of a failed one: by suffix the keys that it was to have


_LONGEST = 1 << 20  # bytes of a line that are read
_MOST_SKIPPED = 1 << 26  # bytes of a longer one that are looked through for its end; a file without ends holds no more
_MOST_SAID = 1 << 16  # characters of an error that are kept


class Journal:
    """The rows of a folder. This process adds to a file of its own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._own: int | None = None
        self._read: dict[str, int] = {}  # bytes of each file that were read
        self.bad = 0  # lines among them that are no rows

    def rows(self) -> Iterator[Row]:
        """Every row of every process, in no order that matters; what cannot be read is skipped."""
        self._read, self.bad = {}, 0
        return self.new_rows()

    def new_rows(self) -> Iterator[Row]:
        """The rows since those that were asked for before; of each file only its end is read."""
        for rows in self._new():
            yield from rows

    def by_process(self) -> Iterator[list[Row]]:
        """The rows of each process in the order in which it wrote them."""
        self._read, self.bad = {}, 0
        return self._new()

    def _new(self) -> Iterator[list[Row]]:
        try:
            files = sorted(self._folder.glob("*.jsonl"))
        except OSError:
            return
        for file in files:
            begin = self._read.get(file.name, 0)
            try:
                if file.stat().st_size <= begin:
                    continue
                rows = []
                with open_file(file) as stream:
                    stream.seek(begin)
                    while size := (line := stream.readline(_LONGEST + 1)) and _to_its_end(stream, line):
                        begin += size
                        row = _row(line) if size == len(line) else None
                        if row is None:
                            self.bad += 1
                        else:
                            rows.append(row)
            except OSError:
                continue
            self._read[file.name] = begin  # a line without its end may still be growing, or is torn for good
            yield rows

    def add(self, row: Row) -> None:
        """Write a row and see it to the disk. The files that it names must be there already, and their folder synced.

        Raises:
            OutputError: it cannot be written.
        """
        try:
            if self._own is None:
                path = self._folder / f"{owner.token()}-{secrets.token_hex(4)}.jsonl"
                self._own = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
                sync_folder(self._folder)
            entry = {name: value for name, value in asdict(row).items() if value or name in ("files", "seconds")}
            if len(row.error) > _MOST_SAID:
                half = _MOST_SAID // 2
                entry["error"] = f"{row.error[:half]} … {row.error[-half:]}"
            rest = json.dumps(entry, sort_keys=True).encode() + b"\n"
            while rest:
                rest = rest[os.write(self._own, rest) :]
            os.fsync(self._own)
        except OSError as e:
            self.close()  # what may be torn stays the end of its file: the next row begins another
            raise output_error(self._folder, e) from None

    def close(self) -> None:
        """No more rows from this process."""
        if self._own is not None:
            os.close(self._own)
            self._own = None


def sync_folder(folder: Path) -> None:
    """See the names in a folder to the disk: without that, a row could outlive the file that it names."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return  # some systems cannot open folders; then there is nothing to do
    try:
        os.fsync(handle)
    except OSError:
        pass
    finally:
        os.close(handle)


def said_of(bad: int) -> str:
    """A line about rows that are none, empty where there are none."""
    if not bad:
        return ""
    those = "a row of the journal is" if bad == 1 else f"{bad} rows of the journal are"
    return f"{those} damaged and left out; frames are known by their files"


def _to_its_end(stream: BufferedReader, line: bytes) -> int:
    """Bytes of a line, of which `line` has just been read; 0 where it has no end, or none that is worth looking for."""
    size = len(line)
    while not line.endswith(b"\n"):
        line = stream.readline(_LONGEST)
        size += len(line)
        if not line or size > _MOST_SKIPPED:
            return 0
    return size


def _row(line: bytes) -> Row | None:
    try:
        values = json.loads(line.decode())
        files = {_word(suffix): _file(entry) for suffix, entry in values["files"].items()}
        wanted = {_word(suffix): _word(key) for suffix, key in values.get("wanted", {}).items()}
        seconds = values["seconds"]
        if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0 <= float(seconds) < math.inf:
            return None
        return Row(_word(values["frame"]), files, float(seconds), _word(values.get("error", "")), wanted)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        return None


def _file(entry: Mapping[str, Any]) -> FileRow:
    sizes = entry["bytes"], entry["mtime_ns"]
    if len(entry) != len(fields(FileRow)) or not all(isinstance(x, int) and not isinstance(x, bool) for x in sizes):
        raise ValueError
    return FileRow(_word(entry["key"]), *sizes, _word(entry["sha256"]))


def _word(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError
    return value
