"""INRIA PLY: one row of floats a splat, log scales, logit opacity, SH coefficients channel by channel.

Written by Kerbl et al. 2023 and nearly every trainer since. Property order, extra properties and number types are
free. Also read: 2D Gaussian splats (no `scale_2`: flat along their third axis) and Mip-Splatting's `filter_3D`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.sh import COEFFICIENTS, degree_of
from mirelight.io.atomic import atomic_path
from mirelight.io.splats import values
from mirelight.io.splats.builder import ROWS, CloudBuilder, Slot
from mirelight.io.splats.info import SplatFileInfo
from mirelight.io.splats.ply_header import NO_SPLATS, Element, PlyHeader, blocks, comment_lines, read_ply_header
from mirelight.model import F32, SplatCloud

_MEANS = ("x", "y", "z")
_DC = ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALES = ("scale_0", "scale_1", "scale_2")
_QUATS = ("rot_0", "rot_1", "rot_2", "rot_3")
_FLAT, _FILTER = "scale_2", "filter_3D"


def summary(path: Path) -> SplatFileInfo:
    """The head of an INRIA PLY file. Raises InputError."""
    header = read_ply_header(path)
    vertex = _vertex(header)
    stored, kept = _rest_per_channel(header, vertex)
    notes = []
    if stored > kept:
        notes.append("SH above degree 3 is left out")
    if _FLAT not in vertex.names:
        notes.append("2D Gaussian splats, read as flat 3D ones")
    if _FILTER in vertex.names:
        notes.append("Mip-Splatting's 3D filter is applied")
    return SplatFileInfo(
        path=path,
        format="INRIA PLY",
        count=vertex.count,
        sh_degree=degree_of(1 + kept),
        antialiased=header.antialiased or _FILTER in vertex.names,
        notes=tuple(notes),
    )


def read(path: Path) -> SplatCloud:
    """The splats of an INRIA PLY file, in the file's own axes. Raises InputError."""
    header = read_ply_header(path)
    vertex = _vertex(header)
    stored, kept = _rest_per_channel(header, vertex)
    rest = [f"f_rest_{i}" for i in range(3 * stored)]
    builder = CloudBuilder(path, vertex.count, 1 + kept)
    for block in blocks(path, vertex, ROWS):
        table = _Table(block)
        slot = builder.slot(len(block))
        slot.means[:] = table.columns(_MEANS)
        slot.quats[:] = table.columns(_QUATS)
        values.sigmoid(table.columns(("opacity",))[:, 0], out=slot.opacities)
        flat = _FLAT not in vertex.names
        values.exponential(table.columns(_SCALES[:2] if flat else _SCALES), out=slot.scales[:, : 2 if flat else 3])
        if flat:
            slot.scales[:, 2] = 0
        slot.sh[:, 0] = table.columns(_DC)
        if kept:
            by_channel = table.columns(rest).reshape(len(block), 3, stored)[:, :, :kept]
            slot.sh[:, 1:] = by_channel.transpose(0, 2, 1)
        if _FILTER in vertex.names:
            _apply_3d_filter(slot, table.columns((_FILTER,)))
        builder.commit(slot)
    return builder.cloud(antialiased=header.antialiased or _FILTER in vertex.names)


def write(cloud: SplatCloud, path: Path, comments: Sequence[str] = ()) -> None:
    """Write an INRIA PLY file with INRIA's property order (normals included, zero). Raises OutputError."""
    k = cloud.sh.shape[1]
    names = [
        *_MEANS,
        "nx",
        "ny",
        "nz",
        *_DC,
        *(f"f_rest_{i}" for i in range(3 * (k - 1))),
        "opacity",
        *_SCALES,
        *_QUATS,
    ]
    comment = ["comment SplatRenderMode: mip"] if cloud.antialiased else []
    comment += comment_lines(comments)
    lines = ["ply", "format binary_little_endian 1.0", *comment, f"element vertex {len(cloud)}"]
    lines += [f"property float {name}" for name in names] + ["end_header", ""]
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write("\n".join(lines).encode("ascii"))
        for first in range(0, len(cloud), ROWS):
            rows = slice(first, first + ROWS)
            n = len(cloud.means[rows])
            columns = (
                cloud.means[rows],
                np.zeros((n, 3), dtype=np.float32),
                cloud.sh[rows, 0],
                cloud.sh[rows, 1:].transpose(0, 2, 1).reshape(n, -1),
                values.logit(cloud.opacities[rows])[:, None],
                values.log_scale(cloud.scales[rows]),
                cloud.quats[rows],
            )
            file.write(np.concatenate(columns, axis=1, dtype="<f4").tobytes())


class _Table:
    """A block of rows as float32 columns: strided views where all properties are floats, else copies."""

    def __init__(self, block: NDArray[Any]) -> None:
        self._block = block
        names = block.dtype.names or ()
        self._index = {name: i for i, name in enumerate(names)}
        plain = all(block.dtype[name] == np.dtype("<f4") for name in names)
        self._floats: F32 | None = block.view("<f4").reshape(len(block), -1) if plain else None

    def columns(self, names: Sequence[str]) -> F32:
        """(n, len(names)) float32; a view where the columns stand side by side."""
        if self._floats is None:
            with np.errstate(over="ignore"):
                return np.stack([self._block[name].astype(np.float32) for name in names], axis=1)
        where = [self._index[name] for name in names]
        if where == list(range(where[0], where[0] + len(where))):
            return self._floats[:, where[0] : where[0] + len(where)]
        return self._floats[:, where]


def _vertex(header: PlyHeader) -> Element:
    """The splat table, checked for what a splat needs."""
    vertex = header.elements.get("vertex")
    if vertex is None:
        raise header.fail("no element 'vertex' that could be read", "is this a splat file?")
    needed = (*_MEANS, *_DC, "opacity", *_SCALES[:2], *_QUATS)
    missing = [name for name in needed if name not in vertex.names]
    if missing:
        found = f"no property {missing[0]!r}" + (f" (and {len(missing) - 1} more)" if len(missing) > 1 else "")
        raise header.fail(found, NO_SPLATS)
    return vertex


def _rest_per_channel(header: PlyHeader, vertex: Element) -> tuple[int, int]:
    """SH coefficients above degree 0 for each channel: in the file, and of those the ones that are read."""
    count = sum(name.startswith("f_rest_") for name in vertex.names)
    if count not in (0, 9, 24, 45, 72) or any(f"f_rest_{i}" not in vertex.names for i in range(count)):
        raise header.fail(f"{count} properties f_rest_*", "expected f_rest_0 on, 0, 9, 24 or 45 of them")
    return count // 3, min(count // 3, COEFFICIENTS[3] - 1)


def _apply_3d_filter(slot: Slot, width: F32) -> None:
    """Mip-Splatting's 3D smoothing filter (Yu et al. 2024, eq. 9): wider by `width`, fainter by the same volume."""
    with np.errstate(over="ignore", invalid="ignore"):
        before = slot.scales.copy()
        np.hypot(slot.scales, width, out=slot.scales)
        ratio = np.divide(before, slot.scales, out=np.ones_like(before), where=slot.scales > 0)
        np.multiply(slot.opacities, ratio.prod(axis=1), out=slot.opacities)
