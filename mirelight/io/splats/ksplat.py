"""KSPLAT, the container of mkkellogg's GaussianSplats3D (its `SplatBuffer.js`): sections of splats, SH up to degree 2.

Level 0 holds floats. Level 1 has half floats, and positions as 16 bits within the block of space whose centre a bucket
of splats has; level 2 has SH in 8 bits, too. Colours and opacity are bytes, scales linear, rotations wxyz. Splats are
in the axes of the PLY that they were made from.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.base.sh import COEFFICIENTS
from mirelight.io.safety import open_binary
from mirelight.io.splats import values
from mirelight.io.splats.builder import ROWS, CloudBuilder
from mirelight.io.splats.info import SplatFileInfo
from mirelight.io.splats.ply_header import Element, blocks
from mirelight.model import F32, SplatCloud

_HEAD, _SECTION = 4096, 1024  # bytes of the file's head, and of each section's
_HALF_RANGE = 32767  # steps on each side of a block's centre, where the file does not say
_SH_RANGE = 1.5  # of SH in 8 bits on each side of zero, where the file does not say
_MOST_SECTIONS = 1 << 16
_MOST_DEGREE = 2
_WHOLE = "the file is truncated or damaged"


@dataclass(frozen=True, slots=True)
class _Section:
    """Splats that share a degree and a size of blocks."""

    rows: Element
    degree: int
    step: float  # world units of a position's last bit
    zero: int  # the position of a block's centre
    full: int  # buckets of `each` splats, which come first
    each: int
    others: int  # buckets that have fewer
    buckets: int
    base: int  # where the counts of those are in the file, then the centres of all, then splats


@dataclass(frozen=True, slots=True)
class _Head:
    level: int
    lowest: float  # SH that is 0 in 8 bits
    highest: float  # and 255
    sections: tuple[_Section, ...]

    @property
    def count(self) -> int:
        return sum(x.rows.count for x in self.sections)

    @property
    def degree(self) -> int:
        return max((x.degree for x in self.sections), default=0)


def summary(path: Path) -> SplatFileInfo:
    """The head of a .ksplat file. Raises InputError."""
    head = _head(path)
    return SplatFileInfo(path=path, format=f"KSPLAT, level {head.level}", count=head.count, sh_degree=head.degree)


def read(path: Path) -> SplatCloud:
    """The splats of a .ksplat file, in the file's own axes. Raises InputError."""
    head = _head(path)
    builder = CloudBuilder(path, head.count, COEFFICIENTS[head.degree])
    for section in head.sections:
        centres = _centres(path, section) if head.level else None
        first = 0
        for block in blocks(path, section.rows, ROWS):
            slot = builder.slot(len(block))
            if centres is None:
                slot.means[:] = block["mean"]
            else:
                with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is dropped
                    offsets = (block["mean"].astype(np.float64) - section.zero) * section.step
                    slot.means[:] = centres.of(first, len(block)) + offsets
            slot.scales[:] = block["scale"]
            slot.quats[:] = block["wxyz"]
            rgba = block["rgba"] / np.float32(255)
            slot.sh[:, 0] = values.dc_from_rgb(rgba[:, :3])
            slot.opacities[:] = rgba[:, 3]
            slot.sh[:, 1:] = 0
            for degree in range(1, section.degree + 1):
                rest = block[f"sh{degree}"].astype(np.float32)
                if head.level == 2:
                    with np.errstate(over="ignore", invalid="ignore"):
                        rest *= (head.highest - head.lowest) / 255
                        rest += head.lowest
                slot.sh[:, COEFFICIENTS[degree - 1] : COEFFICIENTS[degree]] = rest.swapaxes(1, 2)
            builder.commit(slot)
            first += len(block)
    return builder.cloud()


class _Centres:
    """Of the blocks that a section's splats lie in."""

    def __init__(self, ends: NDArray[np.int64], centres: F32) -> None:
        self._ends, self._centres = ends, centres  # (B,) splats up to a bucket's last; (B, 3) world units

    def of(self, first: int, count: int) -> F32:
        """(count, 3) of splats from the first on."""
        return self._centres[np.searchsorted(self._ends, np.arange(first, first + count), side="right")]


def _centres(path: Path, section: _Section) -> _Centres:
    with open_binary(path) as file:
        file.seek(section.base)
        lengths = np.frombuffer(file.read(4 * section.others), "<u4").astype(np.int64)
        centres = np.frombuffer(file.read(12 * section.buckets), "<f4").reshape(-1, 3)
    each = np.full(section.full, section.each, np.int64)
    ends = np.cumsum(np.concatenate([each, lengths]))
    if section.rows.count > (ends[-1] if len(ends) else 0):
        raise InputError(path, "buckets that do not hold its splats", _WHOLE)
    return _Centres(ends, centres)


def _head(path: Path) -> _Head:
    with open_binary(path) as file:
        size = file.seek(0, 2)
        file.seek(0)
        head = file.read(_HEAD)
        if len(head) < _HEAD or head[0] != 0 or head[1] < 1:
            raise InputError(path, "no .ksplat file of version 0.1", "give one that GaussianSplats3D wrote")
        words, floats = np.frombuffer(head, "<u4"), np.frombuffer(head, "<f4")
        count, level = int(words[1]), int(np.frombuffer(head, "<u2")[10])
        if level > 2:
            raise InputError(path, f"compression level {level}, and there are 0, 1 and 2", _WHOLE)
        if not 0 < count <= min(_MOST_SECTIONS, (size - _HEAD) // _SECTION):
            raise InputError(path, f"{count:,} sections in {size:,} bytes", _WHOLE)
        heads = file.read(_SECTION * count)
    lowest, highest = float(floats[9]) or -_SH_RANGE, float(floats[10]) or _SH_RANGE
    return _Head(level, lowest, highest, tuple(_sections(path, level, heads, size)))


def _sections(path: Path, level: int, heads: bytes, size: int) -> Iterator[_Section]:
    base = _HEAD + len(heads)
    for k in range(0, len(heads), _SECTION):
        words = np.frombuffer(heads[k : k + _SECTION], "<u4")
        count, each, buckets, zero, full, others = (int(words[i]) for i in (1, 2, 3, 6, 8, 9))
        block = float(words.view("<f4")[4])
        degree, bytes_of_bucket = (int(words.view("<u2")[i]) for i in (20, 10))
        if level and full + others > buckets:
            raise InputError(path, f"{full + others:,} buckets of which {buckets:,} are there", _WHOLE)
        if degree > _MOST_DEGREE:
            raise InputError(path, f"SH of degree {degree}, and there are at most {_MOST_DEGREE}", _WHOLE)
        if level and bytes_of_bucket != 12:
            raise InputError(path, f"buckets of {bytes_of_bucket} bytes, and they have 12", _WHOLE)
        start = base + (4 * others + 12 * buckets if level else 0)
        rows = Element("splats", count, _row(level, degree), start)
        end = start + count * rows.dtype.itemsize
        if end > size:
            raise InputError(path, f"a section of {count:,} splats that ends {end - size:,} bytes past its end", _WHOLE)
        zero = zero or _HALF_RANGE
        yield _Section(rows, degree, block / 2 / zero, zero, full, each, others, buckets, base)
        base = end


def _row(level: int, degree: int) -> np.dtype[np.void]:
    place, number, sh = (("<f4", "<f4", "<f4"), ("<u2", "<f2", "<f2"), ("<u2", "<f2", "u1"))[level]
    fields = [("mean", place, 3), ("scale", number, 3), ("wxyz", number, 4), ("rgba", "u1", 4)]
    return np.dtype([*fields, *((f"sh{x}", sh, (3, 2 * x + 1)) for x in range(1, degree + 1))])
