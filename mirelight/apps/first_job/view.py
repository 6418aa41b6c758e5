"""A camera that shows a capture well: of many that might, the one whose small picture is full, sharp and rich."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mirelight.base import colour, conventions
from mirelight.base.errors import InputError
from mirelight.base.progress import ShareProgress, passed, quiet
from mirelight.model import F32, F64, Camera, SplatCloud, SplatLayer
from mirelight.proxy.depth import shows
from mirelight.proxy.guessed import Guess, taken_from
from mirelight.proxy.one_picture import without_far
from mirelight.proxy.types import ProxySettings
from mirelight.proxy.views import dot, evenly, length

if TYPE_CHECKING:
    from mirelight.compositor import Compositor

YFOV = 40.0  # degrees
ROOM_YFOV = 60.0
_WIDTH, _HEIGHT = 160, 90
_AZIMUTHS = np.arange(0, 360, 30.0)
_ELEVATIONS = (12.0, 25.0)
_ENCLOSED = 0.9  # mean alpha around the middle, above which a capture is a room
_LEVEL = 16.0  # degrees: of what is seen level all round
_WALLS = 3.0  # times as far from the middle of the cameras as those stand
_FOG = 0.06  # of their distance, over which they blend: walls 0.015, skies 0.18
_SHOWN_ABOVE = 0.05  # of what is above, that a picture may show where it is not known to be open
_HALF_OPEN = 0.2  # alpha that its most open side must have: a skylight, a wall of glass
_ROOF = 0.75  # alpha of what is above where people stood in rooms: 0.84 to 0.95; in a street under a white sky to 0.66
_MOST_EYES = 7  # places where people stood that are asked for walls
_IN_THE_AIR = 0.6  # of the way from an eye in a room to what it looks at
_LOW = 0.1  # slope of a level look: people show the floor
_MOST_CAPTURED = 24  # cameras of the capture that are tried
_STEEP = 0.95  # of a look straight up or down, beyond which a camera shows no level picture
_CUT = 8.0  # by how much of e a view is worth less that cuts off as much as it is wide
_RIM = 2  # pixels
_SKY = 1.5  # times the farthest depth: where there is nothing
_STANDS_OUT = 1.15  # times as far is what a thing stands before
_FREE = 0.15  # of its radius: how far off the walls of a room are
_FILL = 0.94  # of the picture: what the splats within the bounds fill
_SKY_WHITE = 0.95  # in all channels, as splats have them: a white sky
_UP = 4  # of the sides that a room has
_COVERED = 3  # pictures of the median point from about the same side: fewer leave surfaces that are hardly known
_SAME_SIDE = 0.87  # cosine between the ways in which two cameras see a point
_MOST_TAKEN = 200  # pictures of a capture that are asked for that
_LITTLE = 1e-6  # worth of a picture in which nothing is clear
_NOTHING = 0.05  # mean alpha
_HIGH = 0.6  # sine of the height above which a thing is seen from above
_FLOATING = 0.1  # of the extent of the middle 98 %: splats further out than this are floaters


@dataclass(frozen=True, slots=True, eq=False)
class FirstView:
    """A chosen camera and what it shows."""

    camera: Camera
    target: F64  # (3,) the middle of what it shows; in a room that was stood in, in the air before that
    room: bool  # seen from inside
    luminance: float  # median of the splats' pixels as captured, linear: a sky is no part of the surface
    white: float  # share of them at the end of a channel
    depth: float  # of what they blend, as a share of the capture's radius
    picture: SplatLayer  # small

    @property
    def brightness(self) -> str:
        """How bright it is, a line for people."""
        white = f"{self.white:.1%} of their pixels are white"
        return f"As captured, the splats' median luminance is {self.luminance:.2f}; {white}."


def best(
    cloud: SplatCloud,
    source: str,
    captured: Sequence[Camera] = (),
    *,
    guess: Guess | None = None,
    outside: bool = False,
    progress: ShareProgress = quiet,
) -> FirstView:
    """The view to show first.

    Args:
        cloud: in the world, +Y up.
        source: whom to name in an error.
        captured: cameras of the capture in the same world, it stands where one of these did; none: where one is
            guessed to have stood, if the splats tell.
        guess: gives guessed cameras; None: that is done now.
        outside: whether it is known to be no room, closed as it may be.
        progress: hears how many views are looked at.

    Raises:
        InputError: nothing is to be seen of it from anywhere.
        BackendError: this machine cannot composite.
    """
    from mirelight.compositor import Compositor

    solid = cloud.means[without_far(cloud, captured).opacities > 0.1].astype(np.float64)
    if not len(solid):
        raise InputError(source, "no splat shows (every opacity is below 0.1)", "check the file")
    low, high = _bounds(solid)
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    if not radius > 0:
        raise InputError(source, "all splats lie in one place", "check the file")
    points = solid[((solid >= low) & (solid <= high)).all(axis=1)]
    points = points[:: max(1, len(points) // 4000)] if len(points) else solid
    compositor = Compositor(cloud)
    stood_at = captured or (guess() if guess else taken_from(cloud, ProxySettings()))
    room = not outside and (
        _is_inside(compositor, stood_at) or (bool(captured) and _is_walled(compositor, captured))
        if stood_at
        else _is_room([compositor.composite(c, depth=True) for c in _around(middle, radius)], radius)
    )
    tried = captured[:: -(-len(captured) // _MOST_CAPTURED) or 1]
    if not captured and stood_at:
        around = _is_around(compositor, middle, stood_at)
        if not cloud.sh_degree:  # from where plain colours look clear tells nothing of what people aim at
            tried = [] if around else _about(stood_at)
        else:
            tried = _whole_from(points, middle, stood_at) if around else [_wide(x) for x in stood_at]
    some = evenly(captured, _MOST_TAKEN)
    level = [c for c in tried if not is_steep(c)]
    views = [_within(c, radius) for c in (level or (captured and tried))]
    stood = bool(views)
    amid = stood and not captured and not cloud.sh_degree
    if not stood:
        views = list(_inside(low, high) if room else _outside(points, middle))

    def worth(layer: SplatLayer) -> float:
        score = _detail(layer) * (1 if amid else _deep(layer, middle, radius))
        score = (score + _LITTLE) * (_share(points, layer.camera) if stood else 1)
        score *= _covered(points, layer.camera, some) if captured else 1
        # who took pictures aimed at things; guessed cameras may have them at the rim
        return score * _whole(layer) if stood and not captured else score

    shown = (compositor.composite(x, depth=True) for x in passed(views, progress, "looking for a first view"))
    score, layer = max(((worth(x), x) for x in shown), key=lambda x: x[0])
    if not score > 0:
        raise InputError(source, "nothing is to be seen of it", "check its opacities and sizes")
    on = layer.transmittance < 0.5
    deep = float(np.median(np.abs(layer.depth - layer.median_depth)[on])) / radius if on.any() else np.inf
    own = _colors(layer)
    light = np.zeros((1, 3)) if not len(own) else own if layer.linear else colour.srgb_decode(own)
    white = float((light.max(axis=-1) > 0.99).mean())
    target = _ahead(layer, room) if stood and (layer.median_depth > 0).any() else middle
    return FirstView(layer.camera, target, room, float(np.median(colour.luminance(light))), white, deep, layer)


def _bounds(points: F64) -> tuple[F64, F64]:
    """Corners of a box around all but floaters: the feet of a thing stay in its picture."""
    least, low, high, most = np.quantile(points, [0.001, 0.01, 0.99, 0.999], axis=0)
    beyond = _FLOATING * (high - low)
    return np.where(low - least <= beyond, least, low), np.where(most - high <= beyond, most, high)


def _is_around(compositor: Compositor, middle: F64, cameras: Sequence[Camera]) -> bool:
    """Whether cameras stood around all that there is, as around a thing alone or one cut out: turned round,
    they would show nothing."""
    behind = [
        Camera.look_at(x.position, 2 * x.position - middle, 48, 48, yfov=90, near=x.near)
        for x in evenly(cameras, _MOST_EYES)
    ]
    shown = [1 - float(compositor.composite(x).transmittance.mean()) for x in behind]
    return bool(shown) and float(np.mean(shown)) < _NOTHING


def _whole_from(points: F64, middle: F64, cameras: Sequence[Camera]) -> list[Camera]:
    """All points (N, 3) from the sides where cameras stood, not from high above where any stood lower."""
    ways = [x.position - middle for x in cameras]
    ways = [way / np.linalg.norm(way) for way in ways]
    return [_framed(points, middle, way) for way in [x for x in ways if x[1] < _HIGH] or ways]


def _ahead(layer: SplatLayer, room: bool) -> F64:
    """(3,) amid what the middle of a picture shows; in a room in the air before most of that.

    The middle of all splats may lie in a wall, in a statue or behind a camera that somebody aimed.
    """
    h, w = layer.median_depth.shape
    shown = layer.median_depth[h // 4 : h - h // 4, w // 4 : w - w // 4]
    shown = shown[shown > 0] if (shown > 0).any() else layer.median_depth[layer.median_depth > 0]
    away = _IN_THE_AIR * float(np.quantile(shown, 0.25)) if room else float(np.median(shown))
    return layer.camera.position - away * layer.camera.world_from_camera[:3, 2]


def _about(cameras: Sequence[Camera]) -> list[Camera]:
    """Level looks to all sides from some of the places where cameras stood: from outside of a flat, or of a square, its
    walls have backs that nobody saw."""
    eyes = list({tuple(x.position): x for x in cameras}.values())
    turns = np.radians(_AZIMUTHS[::2])
    ways = np.stack([np.sin(turns), np.full_like(turns, -_LOW), np.cos(turns)], axis=1)
    return [
        Camera.look_at(x.position, x.position + way, _WIDTH, _HEIGHT, yfov=ROOM_YFOV, name=x.name)
        for x in evenly(eyes, _MOST_EYES)
        for way in ways
    ]


def _wide(camera: Camera) -> Camera:
    """From where a camera stands, the same way, with a lens as rooms are shown by: it stands amid of what it shows."""
    ahead = -camera.world_from_camera[:3, 2]
    return Camera.look_at(camera.position, camera.position + ahead, _WIDTH, _HEIGHT, yfov=ROOM_YFOV, name=camera.name)


def is_steep(camera: Camera) -> bool:
    """Whether it looks straight up or down, and shows no level picture."""
    return bool(abs(camera.world_from_camera[1, 2]) > _STEEP)


def _within(camera: Camera, radius: float) -> Camera:
    """A level picture, in the first one's shape or upright as a telephone's, of what a camera of the capture saw; as it
    was held where it is steep.

    Where it stood splats were seen from, and past the rims of its picture there may be none.
    """
    ahead = -camera.world_from_camera[:3, 2]
    up = camera.world_from_camera[:3, 1] if is_steep(camera) else np.array([0.0, 1.0, 0.0])
    width, height = (_HEIGHT, _WIDTH) if camera.height > camera.width else (_WIDTH, _HEIGHT)
    half = min(camera.height / 2 / camera.fy, camera.width / 2 / camera.fx * height / width)
    yfov = 2 * float(np.degrees(np.arctan(half)))
    held = conventions.look_at(camera.position, camera.position + ahead, up)
    return Camera.perspective(held, width, height, yfov=yfov, near=1e-3 * radius, name=camera.name)


def _share(points: F64, camera: Camera) -> float:
    """Of points (N, 3), that a camera has in its picture: an overview has many, and a detail few."""
    return float(shows(camera, points.astype(np.float32)).mean())


def _covered(points: F64, camera: Camera, captured: Sequence[Camera]) -> float:
    """Up to 1: where pictures `captured` show most of the points (N, 3) that a camera has in its own from its side."""
    at = points[shows(camera, points.astype(np.float32))].astype(np.float32)
    own, many = at - camera.position, np.zeros(len(at))
    for other in captured:
        way = at - other.position
        along = dot(way, own) / np.maximum(length(way) * length(own), 1e-30)
        many += (along > _SAME_SIDE) & shows(other, at)
    return min(float(np.median(many)) / _COVERED, 1.0) if len(at) else 0.0


def _whole(layer: SplatLayer) -> float:
    """1 where the rims of a picture cut off nothing that stands out before what is beside it there, 0 where much.

    A floor or a wall, whose depth goes on along a rim, is cut off by any picture.
    """
    from scipy import ndimage

    depth = layer.median_depth.astype(np.float64)
    depth = np.where(depth > 0, depth, _SKY * depth.max() or 1)
    cut = 0.0  # pixels
    for side in (depth[:_RIM], depth[-_RIM:], depth[:, :_RIM].T, depth[:, -_RIM:].T):
        rim, widest = side.min(axis=0), side.shape[1] // 2  # of a thing; what is wider is a wall
        behind = ndimage.grey_closing(np.pad(rim, widest, mode="edge"), widest)[widest:-widest]
        cut += float(np.clip(behind / rim - _STANDS_OUT, 0, 1).sum())
    return float(np.exp(-_CUT * cut / depth.shape[1]))


def _around(middle: F64, radius: float) -> Iterable[Camera]:
    directions = np.array([[1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1], [0.1, 0.99, 0], [0.1, -0.99, 0]])
    for way in directions:
        yield Camera.look_at(middle, middle + way, 48, 48, yfov=90, near=0.01 * radius)


def _is_room(sides: Sequence[SplatLayer], radius: float) -> bool:
    """Whether all sides but one are closed, and none is near; those of :func:`_around`."""
    depths = _depths(sides)
    return _is_closed(_alphas(sides)) and len(depths) > 0 and float(np.quantile(depths, 0.2)) > _FREE * radius


def _is_inside(compositor: Compositor, cameras: Sequence[Camera]) -> bool:
    """Whether where cameras stood most have walls all round and a ceiling, not much farther off than they went.

    The middle of a hall may lie in a statue, that of a flat in a wall.
    """
    eyes = np.array([x.position for x in cameras])
    went = float(np.linalg.norm(eyes - eyes.mean(axis=0), axis=1).max())
    if not went > 0:
        return False
    shown = [
        [compositor.composite(c, depth=True) for c in _around(camera.position, went)]
        for camera in evenly(cameras, _MOST_EYES)
    ]
    alphas = np.median([_alphas(sides) for sides in shown], axis=0)
    depths = np.concatenate([_depths(sides) for sides in shown])
    return _is_closed(alphas) and alphas[_UP] > _ROOF and float(np.quantile(depths, 0.9)) < _WALLS * went


def _alphas(sides: Sequence[SplatLayer]) -> F64:
    """(6,) how closed each side of :func:`_around` is; splats of a white sky are no ceiling."""
    alphas = np.array([1 - float(x.transmittance.mean()) for x in sides])
    alphas[_UP] *= 1 - _white(sides[_UP])
    return alphas


def _depths(sides: Sequence[SplatLayer]) -> F32:
    """(P,) of the pixels of all sides in which splats hide more than half."""
    return np.concatenate([x.median_depth[x.median_depth > 0] for x in sides])


def _is_closed(alphas: F64) -> bool:
    """Whether all sides but one are closed, and that in part."""
    least, *others = np.sort(alphas)
    return float(np.mean(others)) > _ENCLOSED and float(least) > _HALF_OPEN


def _white(layer: SplatLayer) -> float:
    """Share of what is shown, that is white."""
    own = _colors(layer)
    return float((own.min(axis=-1) > _SKY_WHITE).mean()) if len(own) else 0.0


def _colors(layer: SplatLayer) -> F32:
    """(P, 3) of the pixels in which splats hide more than half, as splats have them."""
    on = layer.transmittance < 0.5
    return np.asarray(layer.color[on] / (1 - layer.transmittance[on, None]))


def _is_walled(compositor: Compositor, captured: Sequence[Camera]) -> bool:
    """Whether cameras that never look up have walls all round, hardly farther off than they went: a room without its
    ceiling, as pictures of things on a table show it."""
    eyes = np.array([x.position for x in captured])
    amid = eyes.mean(axis=0)
    went = float(np.linalg.norm(eyes - amid, axis=1).max())
    x, z = (a.ravel() for a in np.meshgrid(*2 * [np.linspace(-1, 1, 9)]))
    above = amid + went * np.stack([x, np.ones_like(x), z], axis=1)
    # what `proxy.ceiling` asks of planes of a mesh; there is none yet, and to a level look a wall of windows is open
    if not went > 0 or any(_share(above, camera) > _SHOWN_ABOVE for camera in captured):
        return False
    turns = np.radians(_AZIMUTHS)
    level = [amid + np.array([np.sin(a), 0, np.cos(a)]) for a in turns]
    looks = [Camera.look_at(amid, at, 32, 24, yfov=_LEVEL, near=1e-3 * went) for at in level]
    sides = [compositor.composite(camera, depth=True) for camera in looks]
    closed = float(np.mean([1 - x.transmittance.mean() for x in sides]))
    far = np.concatenate([x.median_depth[x.median_depth > 0] for x in sides])
    mean = np.concatenate([x.depth[x.median_depth > 0] for x in sides])
    if closed < _ENCLOSED or np.quantile(far, 0.9) > _WALLS * went:
        return False
    return float(np.median(np.abs(mean - far) / far)) < _FOG  # splats of a sky hang anywhere


def _inside(low: F64, high: F64) -> Iterable[Camera]:
    middle, extent = (low + high) / 2, high - low
    for azimuth in np.radians(_AZIMUTHS):
        way = np.array([np.sin(azimuth), 0, -np.cos(azimuth)])
        eye = middle - 0.28 * extent * way
        eye[1] = low[1] + 0.5 * extent[1]
        target = eye + way * float(np.linalg.norm(extent)) - (0, 0.08 * extent[1], 0)
        yield Camera.look_at(eye, target, _WIDTH, _HEIGHT, yfov=ROOM_YFOV, near=float(extent.max()) / 1000)


def _outside(points: F64, middle: F64) -> Iterable[Camera]:
    for elevation in np.radians(_ELEVATIONS):
        for azimuth in np.radians(_AZIMUTHS):
            flat = np.cos(elevation)
            way = np.array([flat * np.sin(azimuth), np.sin(elevation), flat * np.cos(azimuth)])
            yield _framed(points, middle, way)


def _framed(points: F64, middle: F64, way: F64) -> Camera:
    """A camera on that side, as near as the points allow; its target is the middle of what it shows."""
    target, away = middle, 0.0
    half = np.tan(np.radians(YFOV / 2)) * _FILL
    for _ in range(3):
        pose = Camera.look_at(target + way, target, _WIDTH, _HEIGHT, yfov=YFOV, near=1e-3).world_from_camera
        own = (points - target) @ pose[:3, :3]  # along right, up, and towards the camera
        reach_x = np.abs(own[:, 0]) / (half * _WIDTH / _HEIGHT) + own[:, 2]
        reach_y = np.abs(own[:, 1]) / half + own[:, 2]
        away = float(max(reach_x.max(), reach_y.max()))
        seen = own[:, :2] / (away - own[:, 2:])
        shift = (seen.min(axis=0) + seen.max(axis=0)) / 2 * away
        target = target + pose[:3, :2] @ shift
    return Camera.look_at(target + way * away, target, _WIDTH, _HEIGHT, yfov=YFOV, near=away / 1000)


def _detail(layer: SplatLayer) -> float:
    """How much there is to see: detail of opaque parts, less what is neither there nor not."""
    alpha = 1 - layer.transmittance
    solid = alpha > 0.9
    if not solid.any():
        return float(alpha.mean()) * 1e-3
    gray = np.clip(layer.color.mean(axis=-1), 0, 1)
    both_x, both_y = solid[:-1, 1:] & solid[:-1, :-1], solid[1:, :-1] & solid[:-1, :-1]
    detail = np.abs(gray[:-1, 1:] - gray[:-1, :-1])[both_x].sum() + np.abs(gray[1:, :-1] - gray[:-1, :-1])[both_y].sum()
    fuzzy = float(((alpha > 0.1) & ~solid).sum() / (alpha > 0.1).sum())
    return float(detail / alpha.size) * (1 - fuzzy)


def _deep(layer: SplatLayer, middle: F64, radius: float) -> float:
    """Up to 1: what lies beyond the middle counts more than what lies before it, or a courtyard is shown from behind
    its walls."""
    solid = layer.transmittance < 0.1
    if not solid.any():
        return 1.0
    ahead = -float((layer.camera.camera_from_world @ np.append(middle, 1.0))[2])
    return float(np.clip((layer.depth[solid].mean() - ahead + radius) / (2 * radius), 0.02, 1)) ** 3
