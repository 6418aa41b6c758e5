"""Fields of splats of an open stage (ParticleField3DGaussianSplat)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.usd.rows import Answer, Request, SplatRow
from mirelight.io.usd.stage import RefusedError, Stage, rows

CAPTURED = "mirelight:captured"  # relates relit splats to those that they were made from
_KIND = "ParticleField3DGaussianSplat"
_HARMONICS = "radiance:sphericalHarmonicsCoefficients"
# Arrays by name: attribute, numbers of a splat (of SH, of a coefficient).
_ATTRIBUTES = {"positions": ("positions", 3), "orientations": ("orientations", 4), "scales": ("scales", 3)}
_ATTRIBUTES |= {"opacities": ("opacities", 1), "sh": (_HARMONICS, 3)}
_READ = "a mesh belongs under the proxy; splats are prims of ParticleField3DGaussianSplat"


def head(stage: Stage, _: Request) -> Answer:
    """How many splats there are, without handing them over, and how many other things."""
    from pxr import UsdGeom, UsdLux

    found: list[SplatRow] = []
    meshes = cameras = lamps = domes = 0
    for prim in stage.prims():
        if prim.GetTypeName() == _KIND:
            prim = _as_captured(stage, prim)
            found.append(_row(stage, prim, len(_values(stage, prim, "positions"))))
        meshes += prim.IsA(UsdGeom.Mesh) or prim.IsA(UsdGeom.PointInstancer)
        cameras += prim.IsA(UsdGeom.Camera)
        if prim.HasAPI(UsdLux.LightAPI):
            is_dome = str(prim.GetTypeName()).startswith("DomeLight")
            lamps, domes = lamps + (not is_dome), domes + is_dome
    return Answer(splats=found, counts=[meshes, cameras, lamps, domes])


def splats(stage: Stage, _: Request) -> Answer:
    """All fields, with their arrays."""
    found: list[SplatRow] = []
    for prim in stage.prims():
        if prim.GetTypeName() != _KIND:
            continue
        prim = _as_captured(stage, prim)
        positions = _values(stage, prim, "positions")
        count = len(positions)
        if not count:
            continue
        at = len(found)
        row = _row(stage, prim, count)
        stage.save(f"positions{at}", positions)
        for name in ("orientations", "scales", "opacities", "sh"):
            each = (row.degree + 1) ** 2 if name == "sh" else 1
            values = _values(stage, prim, name)
            if len(values) >= count * each > 0:
                stage.save(f"{name}{at}", values[: count * each])
            elif len(values):
                stage.note(f"{row.prim}: {len(values):,} {name} for {count:,} splats; they are not taken")
        found.append(row)
    if not found:
        raise RefusedError("no splats in it", _READ)
    return Answer(splats=found)


def _as_captured(stage: Stage, prim: Any) -> Any:
    """The splats that others were relit from, where this package wrote both: light falls on them once."""
    relation = prim.GetRelationship(CAPTURED)
    for target in relation.GetTargets() if relation else []:
        found = stage.stage.GetPrimAtPath(target)
        if found and found.GetTypeName() == _KIND:
            stage.note(f"{prim.GetPath()}: relit splats, of which those as captured are taken: {target}")
            return found
    return prim


def _row(stage: Stage, prim: Any, count: int) -> SplatRow:
    where = str(prim.GetPath())
    degree = prim.GetAttribute("radiance:sphericalHarmonicsDegree").Get()
    degree = 3 if degree is None else int(degree)
    if not 0 <= degree <= 3:
        raise RefusedError(f"spherical harmonics of degree {degree}", "degrees 0 to 3 are read", where)
    return SplatRow(
        prim=where,
        world=rows(stage.world(prim)),
        count=count,
        degree=degree,
        color_space=_color_space(prim),
        projection=str(prim.GetAttribute("projectionModeHint").Get() or "perspective"),
        sorting=str(prim.GetAttribute("sortingModeHint").Get() or "zDepth"),
        antialiased=bool(prim.GetCustomDataByKey("mirelight:antialiased")),
    )


def _color_space(prim: Any) -> str:
    """Of the coefficients; of the attribute itself, else what a prim at or above it says; "" where nobody does."""
    from pxr import Usd

    for name in (_HARMONICS, _HARMONICS + "h"):
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasColorSpace():
            return str(attribute.GetColorSpace())
    at = prim
    while at and not at.IsPseudoRoot():
        if at.HasAPI(Usd.ColorSpaceAPI):
            authored = Usd.ColorSpaceAPI(at).GetColorSpaceNameAttr()
            if authored and authored.HasAuthoredValue():
                return str(authored.Get())
        at = at.GetParent()
    return ""


def _values(stage: Stage, prim: Any, name: str) -> NDArray[Any]:
    """(n, width) of an attribute, of its half variant where that alone is there; empty where neither is."""
    attribute, width = _ATTRIBUTES[name]
    for half in (False, True):
        found = prim.GetAttribute(attribute + ("h" if half else ""))
        value = found.Get(stage.code) if found else None
        if value is not None and len(value):
            array = np.array(value)
            if name == "orientations":
                array = np.roll(array.reshape(len(value), 4), 1, axis=1)  # the library gives xyzw
            return np.asarray(array.reshape(-1, width), dtype=np.float32)
    return np.empty((0, width), np.float32)
