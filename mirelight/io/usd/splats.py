"""Splats of a stage as a cloud, in its world: metres, Y up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from mirelight.base.errors import InputError
from mirelight.base.sh import COEFFICIENTS
from mirelight.io.safety import require_memory
from mirelight.io.splats.builder import ROWS, CloudBuilder
from mirelight.io.splats.edit import merge, transform
from mirelight.io.splats.info import SplatFileInfo
from mirelight.io.usd.process import Read, ask
from mirelight.io.usd.rows import Request, SplatRow
from mirelight.model import Sort, SplatCloud, SplatColorSpace

_AXES = "in metres and Y up, as the stage says; not turned as PLY captures are"
_DISPLAY = ("", "srgb_rec709_scene", "srgb_rec709_display", "sRGB", "srgb_texture", "raw", "identity", "data")
_LIGHT = ("lin_rec709_scene", "lin_rec709_display", "lin_rec709", "lin_srgb")
_SPACES: Mapping[str, SplatColorSpace] = {
    **dict.fromkeys(_DISPLAY, "srgb_rec709_display"),
    **dict.fromkeys(_LIGHT, "lin_rec709_display"),
    "acescct_ap1_scene": "ACEScct",
}
_SORTS: Mapping[str, Sort] = {"zDepth": "depth", "cameraDistance": "radial"}


def summary(path: Path) -> SplatFileInfo:
    """How many splats a stage has, and how it wants them shown. Raises InputError."""
    with ask(path, Request(path=str(path), part="head")) as read:
        rows = [row for row in read.answer.splats if row.count]
        if not rows:
            raise InputError(path, "no splats in it", "a mesh belongs under the proxy")
        hints = sorted({f"hints: projection {row.projection}, sorting {row.sorting}" for row in rows})
        sorts = {_SORTS.get(row.sorting) for row in rows}
        return SplatFileInfo(
            path=path,
            format="OpenUSD ParticleField3DGaussianSplat",
            count=sum(row.count for row in rows),
            sh_degree=max(row.degree for row in rows),
            antialiased=any(row.antialiased for row in rows),
            color_space=_space(path, rows[0]),
            sort=sorts.pop() if len(sorts) == 1 else None,
            notes=(_AXES, *hints, *read.answer.notes),
        )


def read(path: Path) -> SplatCloud:
    """Every splat of a stage, transforms applied.

    Values are taken as ParticleField3DGaussianSplat's documentation has them: linear scales, opacities from 0 to 1,
    coefficients splat by splat; what is too short counts as not given.

    Raises:
        InputError: no stage, no splats, or splats that cannot be placed.
    """
    with ask(path, Request(path=str(path), part="splats")) as read:
        rows = read.answer.splats
        info = sum(4 * row.count * (11 + 3 * COEFFICIENTS[row.degree]) for row in rows)
        require_memory(path, 2 * info, f"{sum(row.count for row in rows):,} splats")
        clouds = []
        for index, row in enumerate(rows):
            try:
                cloud = replace(_cloud(read, row, index), color_space=_space(path, row))
                clouds.append(transform(cloud, np.array(row.world)))
            except ValueError as e:
                raise InputError(path, str(e), field=row.prim) from None
    return merge(clouds)


def _space(path: Path, row: SplatRow) -> SplatColorSpace:
    if row.color_space not in _SPACES:
        remedy = "colours in sRGB (srgb_rec709_scene) and linear Rec.709 (lin_rec709_scene) are read"
        raise InputError(path, f"colours in {row.color_space[:40]!r}", remedy, field=row.prim)
    return _SPACES[row.color_space]


def _cloud(read: Read, row: SplatRow, index: int) -> SplatCloud:
    count, coefficients = row.count, COEFFICIENTS[row.degree]
    arrays = {name: read.array(f"{name}{index}") for name in ("positions", "orientations", "scales", "opacities", "sh")}
    positions = arrays["positions"]
    assert positions is not None  # a row without is not sent
    builder = CloudBuilder(read.path, count, coefficients)
    for first in range(0, count, ROWS):
        some = slice(first, min(first + ROWS, count))
        slot = builder.slot(some.stop - first)
        slot.means[:] = positions[some]
        slot.quats[:] = (1, 0, 0, 0)
        slot.scales[:], slot.opacities[:], slot.sh[:] = 1.0, 1.0, 0.0
        if (quats := arrays["orientations"]) is not None:
            slot.quats[:] = quats[some]
        if (scales := arrays["scales"]) is not None:
            slot.scales[:] = scales[some]
        if (opacities := arrays["opacities"]) is not None:
            slot.opacities[:] = opacities[some, 0]
        if (harmonics := arrays["sh"]) is not None:
            rows = slice(first * coefficients, some.stop * coefficients)
            slot.sh[:] = harmonics[rows].reshape(-1, coefficients, 3)
        builder.commit(slot)
    return builder.cloud(antialiased=row.antialiased)
