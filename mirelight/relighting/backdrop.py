"""What stands behind the splats of a view: the surroundings of a lighting as its camera sees them, or a picture.

It is light, as the frame's own colours are: a viewer sees ``rgba + (1 - alpha) backdrop``, exposed and encoded as one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base.conventions import Matrix, map_pixels, unit
from mirelight.model import F32, F64, Backdrop, Camera, Ground
from mirelight.relighting.surroundings import MOST_ROWS, Map, Sun, Surroundings, shrunk, solid_angles

_FINEST = 2  # pixels of a blurred map to a standard deviation
_LEAK = 0.1  # what splats let through that is less than this is no view past them
_REACH = 4.5  # standard deviations that a blur looks
_GROUND_ROWS = 512  # of a map of nothing but ground; as many as a computed sky has, so that both share a horizon


class Behind:
    """Makes what stands behind views; a picture, and the last lighting's surroundings made ready, are kept.

    Args:
        how: it is shown.
        read: gives the picture of a file (h, w, 3), linear.
    """

    def __init__(self, how: Backdrop, read: Callable[[str], F32]) -> None:
        self._how, self._read = how, read
        self._picture: F32 | None = None
        self._last: tuple[object, float, Surroundings | None] | None = None

    def of(self, camera: Camera, lighting: object, around: Callable[[], Surroundings | None]) -> F32 | None:
        """(H, W, 3) linear light at the pixels of a camera; None where there is none.

        Args:
            camera: of the frame.
            lighting: that `around` is asked for anew when another one comes.
            around: gives its surroundings.
        """
        how = self._how
        if how.picture is not None:
            if self._picture is None:
                self._picture = self._read(how.picture)
            return fitted(self._picture, camera, how.exposure)
        if self._last is None or self._last[0] is not lighting or self._last[1] != camera.fx:
            found = around()
            self._last = lighting, camera.fx, None if found is None else prepared(found, how, camera.fx)
        ready = self._last[2]
        return None if ready is None else seen(camera, ready, how)


def prepared(around: Surroundings, how: Backdrop, fx: float) -> Surroundings:
    """The surroundings as cameras of one focal length (pixels) are to see them: blurred, or no finer than pixels."""
    if how.blur > 0:
        sigma = np.radians(how.blur)
        rows = int(np.clip(np.ceil(_FINEST * np.pi / sigma), 16, MOST_ROWS))
        return Surroundings((Map(blurred(around.picture(rows), float(sigma)), 0.0, np.ones(3)),))
    finest = max(8, int(np.ceil(np.pi * fx)))
    return replace(around, maps=tuple(replace(x, radiance=shrunk(x.radiance, finest)) for x in around.maps))


def seen(camera: Camera, around: Surroundings, how: Backdrop) -> F32:
    """(H, W, 3) linear radiance of prepared surroundings at the pixels of a camera, the backdrop's exposure applied."""
    start, way = camera.rays()
    way = unit(way)
    at, is_ground = (way, None) if how.ground is None else _from_middle(how.ground, start, way)
    out = np.zeros(way.shape)
    for one in around.maps:
        out += one.seen(at)
    pixel = 1 / camera.fx if camera.projection == "perspective" else 0.0
    for sun in around.suns:
        share = _disc(sun, way, pixel)
        out += (share if is_ground is None else share * ~is_ground)[..., None] * radiance_of(sun)
    return np.asarray(out * 2.0**how.exposure, dtype=np.float32)


def fitted(picture: F32, camera: Camera, exposure: float) -> F32:
    """(H, W, 3) the middle of a picture (h, w, 3) linear, as large as the frame's shape allows, on its pixels."""
    from PIL import Image

    height, width = picture.shape[:2]
    scale = min(width / camera.width, height / camera.height)
    across, down = camera.width * scale, camera.height * scale
    left, top = (width - across) / 2, (height - down) / 2
    box = (left, top, left + across, top + down)
    size = (camera.width, camera.height)
    planes = [
        Image.fromarray(np.ascontiguousarray(picture[..., k])).resize(size, Image.Resampling.BILINEAR, box)
        for k in range(3)
    ]
    return np.stack([np.asarray(x, np.float32) for x in planes], axis=-1) * np.float32(2.0**exposure)


def without_leaks(light: F32, alpha: F32) -> F32:
    """Light (H, W, 3) behind splats, taken away where they are all but opaque, by their alpha (H, W).

    Walls of splats let a few hundredths through, which a sky would show as specks, and a sun as a spot on them.
    """
    open_part = np.clip((1 - alpha) / np.float32(_LEAK), 0, 1)
    return np.asarray(light * (open_part**2 * (3 - 2 * open_part))[..., None], dtype=np.float32)


def blurred(radiance: F32, sigma: float) -> F32:
    """A map (h, 2h, 3) seen through a lobe exp((cos - 1) / sigma²) over the sphere, `sigma` in radians.

    The lobe depends on the two rows and the difference of longitudes alone, so each pair of rows is one circular
    convolution.
    """
    rows = len(radiance)
    theta = np.pi * (np.arange(rows) + 0.5) / rows
    turn = np.cos(2 * np.pi * np.arange(2 * rows) / (2 * rows))
    share = solid_angles(rows)
    waves = np.fft.rfft(radiance, axis=1)
    out = np.empty(radiance.shape, dtype=np.float32)
    for row in range(rows):
        near = np.flatnonzero(np.abs(theta - theta[row]) <= _REACH * sigma + np.pi / rows)
        cosine = np.cos(theta[row]) * np.cos(theta[near, None]) + np.sin(theta[row]) * np.sin(theta[near, None]) * turn
        lobe = np.exp((cosine - 1) / sigma**2) * share[near]
        total = (np.fft.rfft(lobe, axis=1)[..., None] * waves[near]).sum(axis=0)
        out[row] = np.maximum(np.fft.irfft(total, 2 * rows, axis=0) / lobe.sum(), 0)
    return out


def _from_middle(ground: Ground, start: F64, way: F64) -> tuple[Matrix, NDArray[np.bool_]]:
    """Where rays meet a floor or the dome above it, as unit directions (H, W, 3) from where the panorama was taken,
    and which meet the floor (H, W). What looks past both sees as from far away."""
    foot = np.asarray(ground.center)
    middle = foot + np.array([0, ground.height, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        down = (foot[1] - start[..., 1]) / way[..., 1]
        met = start + down[..., None] * way
        reach = np.hypot(met[..., 0] - foot[0], met[..., 2] - foot[2])
        is_ground = (down > 0) & (way[..., 1] < 0) & (reach**2 <= ground.radius**2 - ground.height**2)
    off = start - middle
    along = (off * way).sum(axis=-1)
    inside = along**2 - ((off * off).sum(axis=-1) - ground.radius**2)
    far = np.sqrt(np.maximum(inside, 0)) - along
    dome = off + far[..., None] * way
    out = np.where(is_ground[..., None], met - middle, np.where(((inside > 0) & (far > 0))[..., None], dome, way))
    return unit(out), is_ground


def _disc(sun: Sun, way: F64, pixel: float) -> F64:
    """(H, W) share of each pixel, `pixel` radians wide, that a sun's disc fills."""
    radius = np.radians(sun.diameter / 2)
    across = np.linalg.norm(way + sun.direction, axis=-1)  # chord between unit directions
    angle = 2 * np.arcsin(np.clip(across / 2, 0, 1))
    if pixel == 0:
        return np.asarray(angle <= radius, dtype=np.float64)
    largest = min(1.0, np.pi * radius**2 / pixel**2)
    return np.asarray(np.clip(0.5 + (max(radius, pixel / 2) - angle) / pixel, 0, 1) * largest)


def radiance_of(sun: Sun) -> F64:
    """(3,) of the disc: its illuminance over its projected solid angle."""
    return np.asarray(sun.lux / (np.pi * np.sin(np.radians(sun.diameter / 2)) ** 2))


def ground_under(suns: tuple[Sun, ...], albedo: F64) -> Map:
    """A map that holds nothing but a matt ground of that albedo (3,) under suns."""
    lux = sum((x.lux * max(0.0, -float(x.direction[1])) for x in suns), np.zeros(3))
    return Map(with_lit_ground(np.zeros((_GROUND_ROWS, 2 * _GROUND_ROWS, 3), np.float32), lux, albedo), 0.0, np.ones(3))


def with_lit_ground(sky: F32, irradiance: F64, albedo: F64) -> F32:
    """A map whose lower half is dark with a matt ground of that albedo in its place, lit by suns of `irradiance` (3,)
    on the level ground and by the map itself."""
    rows = len(sky)
    above = slice(0, rows // 2)
    facing = (map_pixels(rows)[above, :, 1] * solid_angles(rows)[above])[..., None]
    whole = irradiance + (sky[above] * facing).sum(axis=(0, 1), dtype=np.float64)
    out = sky.copy()
    out[rows // 2 :] = np.asarray(albedo) / np.pi * whole
    return out
