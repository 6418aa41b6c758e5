"""What can be told of a job before anything is rendered: how well its proxy fits its splats through its own cameras,
cameras that see nothing, lights that reach nothing.

It says what `mirelight.pipeline.frame_diagnostics` would say after a frame, without light.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mirelight.base.errors import InputError
from mirelight.lighting.sight import Sight
from mirelight.model import (
    F64,
    Camera,
    Job,
    Light,
    Lighting,
    PointLight,
    PosedLight,
    ProxyMesh,
    SplatCloud,
    SpotLight,
    camera_checks,
)
from mirelight.pipeline.frame_diagnostics import MOST_GAP, MOST_UNCOVERED, Finding
from mirelight.proxy import ProxyQuality, ProxySettings, judge, mesh_of
from mirelight.proxy.advice import UNEXPLAINED
from mirelight.proxy.mesh_tuning import MESH
from mirelight.proxy.views import rays

MOST_CAMERAS = 24  # looked through, spread evenly over the job's
_LEAST_SHOWN = 0.002  # share of the picture below which a camera sees no splats
_GRID = 32  # rays along a picture's longer side, to places that a light should reach
_BALL = 256  # rays all around a light
_PAIRS = 1 << 14  # of what a light falls on, and what cameras see
_SLACK = 1e-3  # of a distance


@dataclass(frozen=True, slots=True, eq=False)
class Check:
    """What was found. Views and findings are in the order of the job's cameras."""

    quality: ProxyQuality | None  # through the cameras that were looked through; None: nothing to compare
    cameras: int  # that the job has
    findings: tuple[Finding, ...]  # empty: nothing is wrong


def check(job: Job, *, every_camera: bool = False) -> Check:
    """Look at a job's splats and proxy through its cameras.

    Args:
        job: with a proxy that is there, as otherwise it is made now.
        every_camera: not `MOST_CAMERAS` of them alone.

    Raises:
        InputError: a file that the job names cannot be used.
        BackendError: the variant cannot be used on this machine.
    """
    splats = None if job.splats is None else job.splats.value
    mesh = mesh_of(job)
    step = 1 if every_camera else max(1, -(-len(job.cameras) // MOST_CAMERAS))
    cameras = job.cameras[::step]
    found = _idle_cameras(cameras, mesh, splats)
    quality = None
    if splats is not None and mesh is not None and cameras:
        settings = ProxySettings(variant=job.render.variant, threads=job.render.threads)
        try:
            took = () if job.made_proxy is None else job.made_proxy.cameras
            quality = judge(splats, mesh, cameras, captured=took, settings=settings, source=job.source)
        except InputError as refused:  # fog, a handful of splats: frames are made, but there is no surface to fit
            found.append(Finding("gap", f"the splats have no surface to compare with: {refused.found}", refused.remedy))
        else:
            found += _misfits(quality, own=job.made_proxy is not None)
    if mesh is not None and len(mesh.faces) and job.lightings:
        sight = Sight(mesh, job.render.variant, job.render.threads)
        found += hidden_lights(job.lightings, cameras, sight)
    return Check(quality, len(job.cameras), tuple(found))


def _idle_cameras(cameras: Sequence[Camera], mesh: ProxyMesh | None, splats: SplatCloud | None) -> list[Finding]:
    remedy = "move it, or leave cameras out: one is placed that sees all"
    return [
        Finding("nothing", f"camera {view.camera!r} {view.problem}", remedy)
        for view in camera_checks.views(cameras, proxy=mesh, splats=splats)
        if view.problem
    ]


def _misfits(quality: ProxyQuality, *, own: bool) -> list[Finding]:
    """Of the whole where the mesh misfits everywhere, else of the views in which it does; `own`: it was made of the
    splats."""
    wrong = quality.uncovered > MOST_UNCOVERED or quality.leaks > MESH.advice_leaks
    if quality.advice:
        *what, remedy = quality.advice
        if remedy == UNEXPLAINED:
            other = "it was made from them, so they have no clear surface there"
            remedy = other if own else 'try `mirelight proxy SPLATS --fit MESH`, or proxy = "splats"'
            remedy = f"--heat DIR shows where; {remedy}"
        return [Finding("uncovered" if wrong else "gap", "; ".join(what), remedy)]
    found = []
    look = "--heat DIR shows where"
    for view in quality.by_view:
        if view.shown < _LEAST_SHOWN:
            continue
        if view.uncovered > MOST_UNCOVERED:
            text = f"through camera {view.camera!r} the proxy does not cover {view.uncovered:.0%} of the splats' pixels"
            found.append(Finding("uncovered", f"{text} (right ones leave up to 13 %)", look))
        elif view.gap_median > MOST_GAP * quality.size:
            side = "before" if view.before > 0.5 else "behind"
            text = f"through camera {view.camera!r} the proxy lies {view.gap_median:.3g} units {side} the splats"
            found.append(Finding("gap", text, look))
    return found


# --- lights ----------------------------------------------------------------------------------------------------------


def hidden_lights(lightings: Iterable[Lighting], cameras: Sequence[Camera], sight: Sight) -> list[Finding]:
    """Lights at a place that reach nothing of what cameras see: enclosed by the mesh, out of range, turned away.

    A lamp behind a wall is none of them where what it falls on is seen: its light comes round the corner.
    """
    points = _seen(cameras, sight)
    found = []
    for lighting in lightings:
        for light in lighting.lights:
            if light.place is not None and light.intensity > 0:
                wrong = _wrong(light, light.place, points, sight)
                if wrong is not None:
                    found.append(Finding("light", f"light {light.name!r} of {lighting.name!r} {wrong[0]}", wrong[1]))
    return found


def _wrong(light: Light, at: F64, points: F64, sight: Sight) -> tuple[str, str] | None:
    if not len(points):
        return None
    away = points - at
    far = np.linalg.norm(away, axis=1)
    if isinstance(light, PointLight | SpotLight) and far.min() > light.range:
        text = f"reaches {light.range:.3g} units, and the nearest surface that cameras see is {far.min():.3g} away"
        return text, "make its range larger, or leave it out"
    if isinstance(light, SpotLight):
        cosine = away @ light.direction / np.maximum(far, 1e-12)
        if cosine.max() < np.cos(light.outer_cone_angle):
            return "shines past all that cameras see", "turn it, or widen its cone"
    if isinstance(light, PosedLight) or _reaches(at, points, sight):  # an area often lies on a wall
        return None
    return "is inside the proxy, or closed in: nothing of it reaches what cameras see", "move it, or open the mesh"


def _reaches(at: F64, points: F64, sight: Sight) -> bool:
    """Whether places see a light, or something that the light falls on."""
    if _free(np.broadcast_to(at, points.shape), points, sight).any():
        return True
    i = np.arange(_BALL)
    y, turn = 1 - (2 * i + 1) / _BALL, i * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - y * y)
    ways = np.stack([flat * np.sin(turn), y, flat * np.cos(turn)], axis=1)
    face, distance = sight.first_hits(at, ways)
    hit = face >= 0
    lit = at + (1 - _SLACK) * distance[hit, None] * ways[hit]
    if not len(lit):
        return True  # nothing is around it, so it is in the open, and something stands before all places
    pairs = np.random.default_rng(0)
    starts, ends = lit[pairs.integers(0, len(lit), _PAIRS)], points[pairs.integers(0, len(points), _PAIRS)]
    return bool(_free(starts, ends, sight).any())


def _free(starts: F64, ends: F64, sight: Sight) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Whether nothing stands between points (N, 3) of either side."""
    _, share = sight.first_hits(starts, ends - starts)
    return np.asarray(share >= 1)


def _seen(cameras: Sequence[Camera], sight: Sight) -> F64:
    """(N, 3) places just before what cameras see of the mesh: a sheet seen from outside is not lit from inside."""
    found = [np.zeros((0, 3))]
    for camera in cameras:
        small = camera.scaled(min(_GRID / max(camera.width, camera.height), 1.0))
        origins, directions = rays(small)
        starts = np.broadcast_to(origins, directions.shape).reshape(-1, 3)
        face, distance = sight.first_hits(starts, directions.reshape(-1, 3))
        hit = face >= 0
        found.append(starts[hit] + (1 - _SLACK) * distance[hit, None] * directions.reshape(-1, 3)[hit])
    return np.concatenate(found)
