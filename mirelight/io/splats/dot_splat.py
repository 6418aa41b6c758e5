""".splat (antimatter15): 32 bytes a splat, no header and no SH above degree 0.

Position and linear scale as 3 floats each, colour and opacity as 4 bytes, rotation wxyz as 4 bytes around 128.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirelight.base.errors import InputError
from mirelight.io.atomic import atomic_path
from mirelight.io.safety import open_binary
from mirelight.io.splats import values
from mirelight.io.splats.builder import ROWS, CloudBuilder
from mirelight.io.splats.info import SplatFileInfo
from mirelight.io.splats.ply_header import Element, blocks
from mirelight.model import SplatCloud

_ROW = np.dtype([("mean", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("wxyz", "u1", 4)])


def summary(path: Path) -> SplatFileInfo:
    """The count of a .splat file, from its size. Raises InputError."""
    return SplatFileInfo(path=path, format=".splat", count=_element(path).count, sh_degree=0)


def read(path: Path) -> SplatCloud:
    """The splats of a .splat file, in the file's own axes. Raises InputError."""
    element = _element(path)
    builder = CloudBuilder(path, element.count, 1)
    for block in blocks(path, element, ROWS):
        slot = builder.slot(len(block))
        slot.means[:] = block["mean"]
        slot.scales[:] = block["scale"]
        rgba = block["rgba"] / np.float32(255)
        slot.sh[:, 0] = values.dc_from_rgb(rgba[:, :3])
        slot.opacities[:] = rgba[:, 3]
        # Writers multiply by 128 and add 128; only that centre reads the identity back exactly.
        slot.quats[:] = block["wxyz"].astype(np.float32) - 128
        builder.commit(slot)
    return builder.cloud()


def write(cloud: SplatCloud, path: Path) -> None:
    """Write a .splat file; SH above degree 0 is lost. Splats are ordered by size x opacity, largest first, as viewers
    expect that load the file while they draw it.

    Raises:
        OutputError: it cannot be written.
    """
    volume = np.prod(cloud.scales, axis=1, dtype=np.float64) * cloud.opacities
    order = np.argsort(-volume, kind="stable")
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        for rows in np.split(order, range(ROWS, len(order), ROWS)):
            block = np.empty(len(rows), dtype=_ROW)
            block["mean"], block["scale"] = cloud.means[rows], cloud.scales[rows]
            rgb = values.rgb_from_dc(cloud.sh[rows, 0])
            rgba = np.concatenate([rgb, cloud.opacities[rows, None]], axis=1)
            block["rgba"] = np.clip(np.round(rgba * 255), 0, 255)
            block["wxyz"] = np.clip(np.round(cloud.quats[rows] * 128 + 128), 0, 255)
            file.write(block.tobytes())


def _element(path: Path) -> Element:
    with open_binary(path) as file:
        size = file.seek(0, 2)
    if size == 0 or size % _ROW.itemsize:
        found = f"{size:,} bytes are not a whole number of 32-byte splats"
        raise InputError(path, found, "the file is truncated, or not a .splat file")
    return Element("splats", size // _ROW.itemsize, _ROW, 0)
