"""Planes put where pictures agree on what they show of them (a plane sweep: Collins, 1996).

Of a wall that has hardly a pattern an optimiser makes a layer of fog, and what is seen of that is its front. So a room
comes out too small, by one to two spacings all round: a lamp close to its ceiling may hang above it. What little is
drawn on a wall tells where it is: read there, it is in the same place to all pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base.together import each
from mirelight.model import F32, F64
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat
from mirelight.proxy.sweep_tuning import SWEEP
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.views import dot, length, rays, turned

Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """How far planes are from where pictures agree."""

    seen: tuple[Flat, ...]  # the planes as depth maps show them
    steps: tuple[float, ...]  # how far each is to be moved along its normal, world units
    spacing: float  # of the splats, world units

    @staticmethod
    def of(views: Sequence[DepthMap], flats: Sequence[Flat], spacing: float) -> Sweep:
        """Of planes that views show.

        Args:
            views: maps of a capture, as its splats show it; none: all planes stay.
            flats: the planes.
            spacing: of the splats, world units.
        """
        if not views:
            return Sweep(tuple(flats), (0.0,) * len(flats), spacing)
        drawn, eye = each(_drawn, views), np.median([view.camera.position for view in views], axis=0)
        fronts = [float(np.sign(flat.off(eye))) for flat in flats]
        found = each(lambda k: _step(views, drawn, flats[k], fronts[k], spacing), range(len(flats)))
        told = [step for step in found if step is not None]
        usual = float(np.median(told)) if told else 0.0  # fog is about as thick on all walls of a room
        steps = (front * (usual if step is None else step) for front, step in zip(fronts, found, strict=True))
        return Sweep(tuple(flats), tuple(steps), spacing)

    @property
    def flats(self) -> list[Flat]:
        """The planes where pictures agree."""
        return [replace(x, offset=x.offset + step) for x, step in zip(self.seen, self.steps, strict=True)]

    def along(self, flat: Flat) -> Flat:
        """A part of one of the planes, moved with it."""
        middle = flat.middles[flat.there.ravel()].mean(axis=0)
        for own, step in zip(self.seen, self.steps, strict=True):
            cosine = float(own.normal @ flat.normal)
            if abs(cosine) > 0.99 and abs(float(own.off(middle))) < TUNING.plane_tolerance * self.spacing:
                return replace(flat, offset=flat.offset + step * cosine)
        return flat

    def moved(self, view: DepthMap) -> DepthMap:
        """A view with what lies on planes, and in the fog about them, moved along with these."""
        if not any(self.steps):
            return view
        origins, directions = rays(view.camera)
        point = origins + directions * view.depth[..., None]
        depth, nearest = view.depth.copy(), np.full(view.depth.shape, 2.0)
        for flat, step in zip(self.seen, self.steps, strict=True):
            slope = dot(directions, flat.normal)
            off = np.abs(flat.off(point)) / (SWEEP.sweep_reach * self.spacing + view.spread * np.abs(slope))
            on = (view.depth > 0) & (off < nearest) & flat.inside(point)
            on &= np.abs(dot(view.normal, flat.normal)) > SWEEP.sweep_facing
            on &= np.abs(slope) > TUNING.label_facing * length(directions)
            depth[on] = view.depth[on] + np.clip(2 - off[on], 0, 1) * step / slope[on]
            nearest[on] = off[on]
        return replace(view, depth=depth.astype(np.float32))


def _drawn(view: DepthMap) -> F32:
    """(H, W) how much lighter pixels are than what is around them, display values."""
    from scipy.ndimage import gaussian_filter

    light = view.color.mean(axis=2)
    wide, narrow = (gaussian_filter(light, x) for x in (SWEEP.sweep_wide, SWEEP.sweep_narrow))
    return np.asarray(narrow - wide)


@dataclass(frozen=True, slots=True, eq=False)
class _Picture:
    """What a view shows of a plane."""

    view: DepthMap
    drawn: F32  # (H, W) as :func:`_drawn`
    own: Bool  # (H, W) pixels that show the plane, and nothing else beside them: outlines of things are not drawn on it

    @staticmethod
    def of(view: DepthMap, drawn: F32, flat: Flat, spacing: float) -> _Picture:
        from scipy.ndimage import minimum_filter

        origins, directions = rays(view.camera)
        facing = np.abs(dot(directions, flat.normal)) / length(directions)
        near = np.abs(flat.off(origins + directions * view.depth[..., None])) < SWEEP.sweep_near * spacing
        on = near & (view.depth > 0) & (facing > SWEEP.sweep_aslant)
        return _Picture(view, drawn, minimum_filter(on, 2 * round(SWEEP.sweep_wide) + 1))

    def read(self, at: F64) -> tuple[F64, Bool]:
        """(N,) what is drawn at points (N, 3), and whether the plane is seen there; else 0."""
        from scipy.ndimage import map_coordinates

        camera = self.view.camera
        local = turned(at - camera.position, camera.camera_from_world[:3, :3])
        ahead = np.maximum(-local[:, 2], 1e-12)
        row = camera.cy - 0.5 - camera.fy * local[:, 1] / ahead
        column = camera.cx - 0.5 + camera.fx * local[:, 0] / ahead
        place = np.stack([row, column])
        last = np.array([[camera.height - 1], [camera.width - 1]])
        there = (-local[:, 2] > camera.near) & ((place >= 0) & (place <= last)).all(axis=0)
        i, j = np.rint(place[:, there]).astype(np.int64)
        there[there] = self.own[i, j]
        out = np.zeros(len(at))
        out[there] = map_coordinates(self.drawn, place[:, there], order=1)
        return out, there


def _step(views: Sequence[DepthMap], drawn: Sequence[F32], flat: Flat, front: float, spacing: float) -> float | None:
    """How far along a plane's normal times `front` views agree best; 0 where they hardly agree anywhere, or no better
    than where it is; None where they do so everywhere alike."""
    if not flat.there.any():
        return 0.0
    at = _points(flat)
    pictures = [_Picture.of(view, x, flat, spacing) for view, x in zip(views, drawn, strict=True)]
    pictures = [x for x in pictures if x.read(at)[1].mean() > SWEEP.sweep_share]
    if len(pictures) < SWEEP.sweep_fewest:
        return 0.0
    pictures = pictures[:: -(-len(pictures) // SWEEP.sweep_views)]
    steps = np.arange(-SWEEP.sweep_most, SWEEP.sweep_most + 1) * SWEEP.sweep_step * spacing
    alike = np.array([_agreement(pictures, at + front * step * flat.normal) for step in steps])
    best = int(alike.argmax())
    if alike[best] < SWEEP.sweep_alike:
        return 0.0
    if alike[best] - max(alike[0], alike[-1]) < SWEEP.sweep_even:
        return None
    if alike[best] - alike[SWEEP.sweep_most] < SWEEP.sweep_gain:
        return 0.0
    before, peak, after = alike[best - 1 : best + 2]
    between = 0.5 * (before - after) / (before - 2 * peak + after)  # the top of the parabola through all three
    return float(steps[best] + between * SWEEP.sweep_step * spacing)


def _points(flat: Flat) -> F64:
    """(N, 3) points strewn over the cells where a plane is."""
    rng = np.random.default_rng(0)
    cells = np.argwhere(flat.there)
    return flat.at(cells[rng.integers(len(cells), size=SWEEP.sweep_points)] + rng.random((SWEEP.sweep_points, 2)))


def _agreement(pictures: Sequence[_Picture], at: F64) -> float:
    """0..1: how much of what is drawn at points (N, 3) is the same to all pictures."""
    total, square, count = np.zeros(len(at)), np.zeros(len(at)), np.zeros(len(at))
    for picture in pictures:
        drawn, there = picture.read(at)
        total += drawn
        square += drawn * drawn
        count += there
    several = count >= SWEEP.sweep_fewest
    common = (total[several] / count[several]) ** 2
    return float(common.sum() / max((square[several] / count[several]).sum(), 1e-30))
