"""Cameras of an open stage."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from mirelight.io.usd.exact import kept
from mirelight.io.usd.rows import Answer, CameraRow, Request
from mirelight.io.usd.stage import Stage, rows

_SAME = 1e-6  # time codes
_LENS = ("focalLength", "horizontalAperture", "verticalAperture", "fStop", "focusDistance")


def cameras(stage: Stage, request: Request) -> Answer:
    """Every camera; with times, each camera once for each, the cameras of a time together."""
    from pxr import UsdGeom

    found = [prim for prim in stage.prims() if prim.IsA(UsdGeom.Camera)]
    codes = [stage.at(time) for time in request.times] or [None]
    exact = [kept(prim) for prim in found]
    taken = [_row(stage, prim, code, own) for code in codes for prim, own in zip(found, exact, strict=True)]
    return Answer(cameras=taken, times=keys(stage, found))


def _row(stage: Stage, prim: Any, code: Any, exact: dict[str, Any] | None) -> CameraRow:
    """`exact`: its lens in full, of a stage that this package wrote; of one that zooms, at its keys."""
    from pxr import UsdGeom

    camera = UsdGeom.Camera(prim)
    at = stage.code if code is None else code

    def number(attribute: Any) -> float:
        return float(attribute.Get(at) or 0.0)

    near, far = camera.GetClippingRangeAttr().Get(at)
    row = CameraRow(
        name=prim.GetName(),
        prim=str(prim.GetPath()),
        world=rows(stage.world(prim, code)),
        orthographic=camera.GetProjectionAttr().Get(at) == "orthographic",
        focal=number(camera.GetFocalLengthAttr()),
        apertures=[number(camera.GetHorizontalApertureAttr()), number(camera.GetVerticalApertureAttr())],
        offsets=[number(camera.GetHorizontalApertureOffsetAttr()), number(camera.GetVerticalApertureOffsetAttr())],
        clipping=[float(near) * stage.unit, float(far) * stage.unit],
        unit=stage.unit / 10,
        moves=len(_samples(prim, _LENS)) > 1,
        shutter=[number(x) / stage.rate for x in (camera.GetShutterOpenAttr(), camera.GetShutterCloseAttr())],
        **_lens_of(camera, at, stage.unit),
    )
    lens = dict(exact or {})
    if row.moves or code is not None:
        near_by = [values for key, values in lens.pop("keys", ()) if abs(key - at.GetValue()) < _SAME]
        at_key = near_by[0] if near_by else {}
        lens = (lens if near_by else {}) | (at_key if isinstance(at_key, dict) else {"focal": at_key})
    return replace(row, **lens)


def _lens_of(camera: Any, at: Any, unit: float) -> dict[str, float]:
    """Aperture and focus in metres, where both are there; focal lengths are tenths of a unit."""
    stop, focus = (float(x.Get(at) or 0.0) for x in (camera.GetFStopAttr(), camera.GetFocusDistanceAttr()))
    focal = float(camera.GetFocalLengthAttr().Get(at) or 0.0)
    if not (stop > 0 and focus > 0 and camera.GetProjectionAttr().Get(at) == "perspective"):
        return {}
    return {"aperture_radius": focal * unit / 10 / (2 * stop), "focus_distance": focus * unit}


def keys(stage: Stage, prims: Iterable[Any]) -> list[float]:
    """First and last moment (s) of an animation: the stage's range, else from key to key; empty where nothing moves."""
    times = sorted({x for prim in prims for x in _samples(prim, ())})
    if len(times) < 2:
        return []
    first, last = times[0], times[-1]
    if stage.stage.HasAuthoredTimeCodeRange():
        first, last = stage.stage.GetStartTimeCode(), stage.stage.GetEndTimeCode()
    return [float(first) / stage.rate, float(last) / stage.rate]


def _samples(prim: Any, only: tuple[str, ...]) -> set[float]:
    """Time codes at which a prim's own values (all, or those of these names) or its place have keys."""
    from pxr import UsdGeom

    own = [prim.GetAttribute(name) for name in only] if only else prim.GetAttributes()
    found = {float(x) for attribute in own for x in attribute.GetTimeSamples()}
    at = prim
    while at and not at.IsPseudoRoot():
        if at.IsA(UsdGeom.Xformable):
            found |= {float(x) for x in UsdGeom.Xformable(at).GetTimeSamples()}
        at = at.GetParent()
    return found
