"""What cameras see and where things stand, found out before anything is rendered: inside the proxy, before nothing, or
too far from the origin.

A quick look at points of the proxy's surface and at the splats' centres; where it finds a camera that may be of no use,
rays against every triangle decide.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from mirelight.model import F64, Camera, Lighting, ProxyMesh, SplatCloud
from mirelight.model.triangles import crossed, distances_to

_POINTS = 12_000  # spread evenly over the proxy, on its triangles in turn, and of the splats
_CELLS = 12  # along the picture's longer side
_SIDE = 8  # cells along each edge of the cube of directions
_RAYS = 8  # along each side of the picture, where rays decide
_BALL = 32  # rays all around, where rays decide
_ENCLOSED = 0.75  # share of all directions that end on a back face, above which a camera is inside
_SUSPECT = 0.05  # share of the picture below which rays decide
_LITTLE = 0.02  # share of the picture that is hardly a picture
_PAIRS = 100_000  # of a ray and a triangle, at a time
_NEAREST = 64  # points whose triangles are measured
_SEVERAL = 4  # places that tell a room from a solid
_MOST = 50  # cameras, and places of lamps, that are looked at before a render
_NAMED = 5  # of those with a problem, said by name


@dataclass(frozen=True, slots=True)
class View:
    """What one camera has before it."""

    camera: str  # its name
    seen: float  # share of the picture, 0 to 1, in which there is something
    nearest: float  # world units to the nearest surface or splat centre, in any direction; inf: there is none
    inside: bool  # enclosed by the proxy's back faces (a room whose faces look inwards does not count)

    @property
    def problem(self) -> str:
        """Why the camera is of no use, in words that follow its name; empty where it is."""
        if self.inside:
            return "stands inside the proxy"
        if self.seen == 0:
            return "sees nothing"
        return f"sees hardly anything ({100 * self.seen:.1f}% of its picture)" if self.seen < _LITTLE else ""


def views(
    cameras: Sequence[Camera], *, proxy: ProxyMesh | None = None, splats: SplatCloud | None = None
) -> tuple[View, ...]:
    """What each camera has before it.

    Args:
        cameras: in the world of the scene.
        proxy: its triangles' winding says which side is the back.
        splats: their centres count.
    """
    surface = None if proxy is None or not len(proxy.faces) else _Surface.of(proxy)
    means = np.zeros((0, 3))
    if splats is not None:
        means = splats.means[:: max(1, math.ceil(len(splats) / _POINTS))].astype(np.float64)
    return tuple(_view(camera, surface, means) for camera in cameras)


def too_far(what: SplatCloud | ProxyMesh) -> str:
    """A line on splats or a mesh so far from the origin that single precision is too coarse there; empty where it is
    not."""
    name, why = "capture" if isinstance(what, SplatCloud) else "mesh", what.too_far
    return f"the {name} {why}; move capture, mesh and cameras to the origin before they are saved" if why else ""


def is_room(inside: Sequence[bool]) -> bool:
    """Whether places are enclosed because the mesh is a room whose faces look outwards, not because they lie in
    something solid: most of several are."""
    return len(inside) >= _SEVERAL and sum(inside) > len(inside) / 2


def remarks(cameras: Sequence[Camera], lightings: Sequence[Lighting], proxy: ProxyMesh) -> tuple[str, ...]:
    """A line for each kind of problem, with how many have it and who the first are; none where all is well.

    Args:
        cameras: that are to be rendered. Of more than fifty, about fifty are looked at, spread evenly.
        lightings: whose lamps are looked at, each place once, in the same way.
        proxy: what cameras see and lamps light.
    """
    if not len(proxy.faces):
        return ()
    judge = Judge(proxy)
    chosen, places = _spread(cameras), _spread(_places(lightings))
    inside = [judge.inside(camera) for camera in chosen]
    judge.room = is_room(inside)
    seen = [1.0 if there and not judge.room else judge.sees(x) for x, there in zip(chosen, inside, strict=True)]
    found = {
        "inside the proxy": [] if judge.room else [x.name for x, there in zip(chosen, inside, strict=True) if there],
        "where nothing of the proxy is in view": [x.name for x, s in zip(chosen, seen, strict=True) if s == 0],
        "where hardly anything of the proxy is in view": [
            x.name for x, s in zip(chosen, seen, strict=True) if 0 < s < _LITTLE
        ],
    }
    out = [line for where, names in found.items() for line in _counted(names, "camera", len(chosen), where)]
    held = [judge.holds(place) for _, place in places]
    if not judge.room and not is_room(held):
        lamps = [name for (name, _), there in zip(places, held, strict=True) if there]
        out += _counted(lamps, "light", len(places), "inside the proxy")
    return tuple(out)


def _places(lightings: Sequence[Lighting]) -> list[tuple[str, F64]]:
    """Where lamps stand, each place once, under the name of a lamp and of the first lighting that has one there."""
    known: dict[bytes, tuple[str, F64]] = {}
    for lighting in lightings:
        for light in lighting.lights:
            place = light.place
            if place is not None:
                known.setdefault(place.tobytes(), (f"{light.name} of {lighting.name}", place))
    return list(known.values())


Item = TypeVar("Item")


def _spread(every: Sequence[Item]) -> Sequence[Item]:
    return every[:: max(1, math.ceil(len(every) / _MOST))]


def _counted(names: Sequence[str], kind: str, of: int, where: str) -> list[str]:
    if not names:
        return []
    listed = ", ".join(names[:_NAMED]) + (", …" if len(names) > _NAMED else "")
    return [
        f"{kind} {listed} stands {where}"
        if len(names) == 1
        else f"{len(names):,} of {of:,} {kind}s stand {where}: {listed}"
    ]


class Judge:
    """Says of one camera after the other whether it is of use before a mesh."""

    def __init__(self, proxy: ProxyMesh) -> None:
        self._surface = _Surface.of(proxy)
        self.room = False  # the mesh is a room whose faces look outwards, so that being inside is no fault

    def inside(self, camera: Camera) -> bool:
        """Whether back faces enclose it."""
        return self.holds(camera.position)

    def holds(self, position: F64) -> bool:
        """Whether back faces enclose a place (3,)."""
        return self._surface.holds(position)

    def sees(self, camera: Camera) -> float:
        """The share of its picture in which the mesh is."""
        return _seen(camera, self._surface, self._surface.points)

    def approves(self, camera: Camera) -> bool:
        """Whether it stands in the open and sees more than hardly anything."""
        return (self.room or not self.inside(camera)) and self.sees(camera) >= _LITTLE


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """A mesh and points on it: half spread evenly, half on its triangles in turn, so that small ones have some."""

    triangles: F64  # (F, 3, 3)
    middles: F64  # (F, 3) of the triangles
    reach: F64  # (F,) squared distance from there to the farthest corner
    points: F64  # (N, 3)
    faces: np.ndarray  # (N,) the triangle of each
    normals: F64  # (N, 3) by the winding, of any length

    @staticmethod
    def of(mesh: ProxyMesh) -> _Surface:
        triangles = mesh.vertices.astype(np.float64)[mesh.faces]
        a, b, c = np.moveaxis(triangles, 1, 0)
        normals = crossed(triangles)
        areas = np.linalg.norm(normals, axis=1)
        count = np.arange(2 * _POINTS) + 0.5
        whole = np.cumsum(areas)
        evenly = np.minimum(np.searchsorted(whole, count[:_POINTS] / _POINTS * whole[-1]), len(areas) - 1)
        stride = max(1, math.ceil(len(areas) / _POINTS))
        faces = np.concatenate([evenly, np.arange(_POINTS) * stride % len(areas)])
        # The R2 sequence (M. Roberts, 2018), folded into the triangle.
        u, v = np.mod(count * 0.7548776662466927, 1), np.mod(count * 0.5698402909980532, 1)
        folded = u + v > 1
        u, v = np.where(folded, 1 - u, u)[:, None], np.where(folded, 1 - v, v)[:, None]
        points = a[faces] + u * (b - a)[faces] + v * (c - a)[faces]
        middles = triangles.mean(axis=1)
        reach = np.square(triangles - middles[:, None]).sum(axis=2).max(axis=1)
        return _Surface(triangles, middles, reach, points, faces, normals[faces])

    def holds(self, position: F64) -> bool:
        """Whether back faces enclose a place: rays decide, where a look at the points does not rule it out."""
        away = self.points - position
        distances = np.linalg.norm(away, axis=1)
        nearest = int(np.argmin(distances))
        if away[nearest] @ self.normals[nearest] <= 0 and _back_share(away, distances, self.normals) <= _ENCLOSED / 2:
            return False
        outwards = 0  # rays that meet a front, or nothing
        for side in _hits(self, np.broadcast_to(position, (_BALL, 3)), _ball(), 0.0, math.inf):
            outwards += side >= 0
            if outwards >= (1 - _ENCLOSED) * _BALL:
                return False
        return True


def _view(camera: Camera, surface: _Surface | None, means: F64) -> View:
    points = means if surface is None else np.concatenate([surface.points, means])
    distances = np.linalg.norm(points - camera.position, axis=1)
    nearest = float(distances.min()) if len(distances) else math.inf
    if surface is not None:
        nearest = min(nearest, _nearest(surface, camera.position, distances[: len(surface.points)]))
    inside = surface is not None and surface.holds(camera.position)
    return View(camera.name, _seen(camera, surface, points), nearest, inside)


def _seen(camera: Camera, surface: _Surface | None, points: F64) -> float:
    """Share of the picture in which there is something."""
    seen = _share(camera, points)
    if surface is None or seen >= _SUSPECT:
        return seen
    sides = list(_hits(surface, *_picture_rays(camera), camera.near, camera.far))
    return max(seen, sum(side != 0 for side in sides) / len(sides))


def _share(camera: Camera, points: F64) -> float:
    """Share of coarse cells of the picture on which points land."""
    m = camera.camera_from_world
    x, y, z = (points @ m[:3, :3].T + m[:3, 3]).T
    ahead = (-z > camera.near) & (-z < camera.far)
    x, y, w = x[ahead], y[ahead], -z[ahead] if camera.projection == "perspective" else np.ones(int(ahead.sum()))
    size = max(camera.width, camera.height) / _CELLS
    columns, rows = max(1, round(camera.width / size)), max(1, round(camera.height / size))
    u = (camera.cx + camera.fx * x / w) / camera.width
    v = (camera.cy - camera.fy * y / w) / camera.height
    on = (u >= 0) & (u < 1) & (v >= 0) & (v < 1)
    cells = (v[on] * rows).astype(np.intp) * columns + (u[on] * columns).astype(np.intp)
    return len(np.unique(cells)) / (rows * columns)


def _back_share(away: F64, distances: F64, normals: F64) -> float:
    """Share of all directions, as cells of a cube, in which the nearest point shows its back."""
    axis = np.argmax(np.abs(away), axis=1)
    row = np.arange(len(away))
    major = away[row, axis]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.nan_to_num(away[row, (axis + 1) % 3] / np.abs(major))
        v = np.nan_to_num(away[row, (axis + 2) % 3] / np.abs(major))
    iu, iv = (np.minimum(((x + 1) / 2 * _SIDE).astype(np.intp), _SIDE - 1) for x in (u, v))
    cell = ((axis * 2 + (major > 0)) * _SIDE + iu) * _SIDE + iv
    first = np.full(6 * _SIDE * _SIDE, np.inf)
    np.minimum.at(first, cell, distances)
    front = distances == first[cell]
    back = np.einsum("ni,ni->n", away[front], normals[front]) > 0
    return len(np.unique(cell[front][back])) / len(first)


def _nearest(surface: _Surface, position: F64, to_points: F64) -> float:
    """Distance to the nearest of the triangles around the nearest points."""
    count = min(_NEAREST, len(to_points))
    faces = np.unique(surface.faces[np.argpartition(to_points, count - 1)[:count]])
    return float(distances_to(surface.triangles[faces], position).min())


def _picture_rays(camera: Camera) -> tuple[F64, F64]:
    """Origins and directions (R, 3), the directions of length 1 along the view axis."""
    u = (np.arange(_RAYS) + 0.5) / _RAYS
    x, y = np.meshgrid((u * camera.width - camera.cx) / camera.fx, (camera.cy - u * camera.height) / camera.fy)
    flat = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    r = camera.world_from_camera[:3, :3]
    if camera.projection == "perspective":
        return np.broadcast_to(camera.position, flat.shape), np.add(flat, (0, 0, -1)) @ r.T
    return camera.position + flat @ r.T, np.broadcast_to(-r[:, 2], flat.shape)


def _ball() -> F64:
    """Directions (R, 3) all around: a Fibonacci lattice."""
    i = np.arange(_BALL)
    y = 1 - (2 * i + 1) / _BALL
    flat, turn = np.sqrt(1 - y * y), i * math.pi * (3 - math.sqrt(5))
    return np.stack([flat * np.sin(turn), y, flat * np.cos(turn)], axis=1)


def _hits(surface: _Surface, origins: F64, directions: F64, near: float, far: float) -> Iterator[float]:
    """What each ray meets first: 1 a front, -1 a back, 0 nothing. Möller and Trumbore (1997), on the triangles whose
    sphere it meets; as many rays at a time as fit."""
    many = max(1, _PAIRS // len(surface.middles))
    last: F64 | None = None
    for i in range(0, len(origins), many):
        o, d = origins[i : i + many], directions[i : i + many]
        if (o == o[0]).all():
            o = o[:1]
        if last is None or not np.array_equal(o, last):
            away = surface.middles - o[:, None]
            outside = np.einsum("rfi,rfi->rf", away, away) - surface.reach * (1 + 1e-9)
            last = o
        along = (away @ (d / np.linalg.norm(d, axis=1, keepdims=True))[:, :, None])[..., 0]
        ray, face = np.divmod(np.flatnonzero(along**2 >= outside), len(surface.middles))
        side, t = _met(surface.triangles[face], np.broadcast_to(o, d.shape)[ray], d[ray], near, far)
        out = np.zeros(len(d))
        order = np.argsort(t, kind="stable")[::-1]
        out[ray[order]] = side[order]  # the nearest, written last, stays
        yield from out


def _met(triangles: F64, o: F64, d: F64, near: float, far: float) -> tuple[F64, F64]:
    """Of N triangles with a ray each: the side (N,) that it meets, 0 for none, and how far along it, inf for none."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    e1, e2 = b - a, c - a
    p = np.cross(d, e2)
    det = np.einsum("ni,ni->n", e1, p)
    s = o - a
    q = np.cross(s, e1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("ni,ni->n", s, p) / det
        v = np.einsum("ni,ni->n", q, d) / det
        t = np.einsum("ni,ni->n", e2, q) / det
        there = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > near) & (t < far)
    return np.where(there, np.sign(det), 0.0), np.where(there, t, np.inf)
