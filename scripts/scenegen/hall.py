"""A small museum hall seen from inside: white walls, a skylight, a doorway into a dark room, a statue behind ropes.

Exposed for the hall, so the skylight and the sun's patch end at white. It is not shipped, and nothing is tuned on it:
`scripts/bench truth` makes it where it is needed.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mirelight.base.conventions import unit
from mirelight.model import Camera, Lighting, PointLight, SpotLight
from scenegen.geometry import Part, blob, boxes, lathe, place, soups, spline, tube
from scenegen.interior import outside, sunlight
from scenegen.recipe import Recipe
from scenegen.textures import F32, Surface, clouds, mix, plain, srgb, step, stone, wood
from scenegen.truth import Looks

WIDE, HIGH, DEEP, WALL = 4.5, 4.2, 3.5, 0.3  # metres: x from -WIDE to WIDE, z from -DEEP to DEEP
SKYLIGHT = ((-0.2, 1.8), (-0.9, 0.3))  # along x and z
DOOR, LINTEL = (0.5, 1.7), 2.3  # along z, in the wall at +X
BACK, LOW = 3.0, 2.7  # metres: how deep and high the side room is
TOP = 0.95  # of the plinth
WARM = np.array([1.0, 0.66, 0.38])
PICTURES = (  # centre, then width and height; on the walls at -X, -Z and +Z
    ((-WIDE, 1.75, -1.6), (1.5, 1.1)),
    ((-WIDE, 1.65, 1.5), (0.9, 1.2)),
    ((-2.4, 1.7, -DEEP), (1.2, 0.9)),
    ((1.3, 1.8, -DEEP), (2.0, 1.3)),
    ((0.6, 1.7, DEEP), (1.4, 1.0)),
)


def _painting(colours: tuple[tuple[int, int, int], ...], seed: int) -> F32:
    """Fields of colour with brushed edges."""
    made = srgb(*colours[0]) + np.zeros((256, 256, 3))
    for k, colour in enumerate(colours[1:]):
        made = mix(made, srgb(*colour) + np.zeros_like(made), step(clouds(256, seed + k, slope=1.8), 0.45, 0.25))
    made = made * (1 + 0.06 * clouds(256, seed + 9, slope=0.5, low=12))[..., None]
    return np.clip(made, 0.02, 0.86).astype(np.float32)


def surfaces() -> dict[str, Surface]:
    """Every material of the hall."""
    return {
        "wall": Surface(texture=plain(srgb(228, 226, 220), 601, contrast=0.012), size=3.0),
        "ceiling": Surface(texture=plain(srgb(232, 231, 228), 603, contrast=0.01), size=3.0),
        "floor": Surface(texture=wood(srgb(182, 136, 92), srgb(122, 84, 54), 605, size=1024), size=1.8),
        "side room": Surface(texture=plain(srgb(96, 92, 98), 607, contrast=0.05), size=1.5),
        "skirting": Surface(texture=plain(srgb(150, 146, 140), 609, contrast=0.05), size=0.5),
        "metal bars": Surface(texture=plain(srgb(92, 94, 96), 611, contrast=0.04), size=0.5),
        "marble": Surface(texture=stone(srgb(216, 210, 200), srgb(160, 154, 148), 613), size=0.9),
        "plinth": Surface(texture=stone(srgb(120, 116, 112), srgb(78, 76, 74), 615), size=1.1),
        "oak": Surface(texture=wood(srgb(150, 108, 70), srgb(88, 58, 36), 617), size=1.0),
        "gilt": Surface(texture=plain(srgb(176, 136, 66), 619, contrast=0.15), size=0.3),
        "brass": Surface(texture=plain(srgb(190, 150, 84), 621, contrast=0.05), size=0.3),
        "rope": Surface(texture=plain(srgb(120, 28, 34), 623, contrast=0.1), size=0.1),
        "picture 0": Surface(texture=_painting(((60, 92, 120), (214, 190, 140), (120, 70, 44)), 631), size=1.6),
        "picture 1": Surface(texture=_painting(((44, 36, 32), (150, 96, 60), (206, 170, 120)), 641), size=1.3),
        "picture 2": Surface(texture=_painting(((92, 120, 70), (180, 196, 208), (58, 70, 40)), 651), size=1.3),
        "picture 3": Surface(texture=_painting(((176, 60, 44), (222, 200, 160), (36, 48, 84)), 661), size=2.1),
        "picture 4": Surface(texture=_painting(((150, 156, 160), (70, 78, 90), (206, 150, 60)), 671), size=1.5),
    }


def _shell() -> list[Part]:
    """Floor, walls and a ceiling with a hole, all of slabs, so that light has no seam to come through."""
    out, deep = WALL / 2, 2 * (DEEP + WALL)
    end = WIDE + WALL
    x, z, y = WIDE + out, DEEP + out, HIGH + out
    (a, b), (c, d), (e, f) = *SKYLIGHT, DOOR
    ceiling = [[(a - end) / 2, y, 0], [(b + end) / 2, y, 0]]
    ceiling += [[(a + b) / 2, y, (q + s * (DEEP + WALL)) / 2] for q, s in ((c, -1), (d, 1))]
    sizes = [[a + end, WALL, deep], [end - b, WALL, deep]]
    sizes += [[b - a + 0.02, WALL, c + DEEP + WALL], [b - a + 0.02, WALL, DEEP + WALL - d]]
    bars = [[a + (b - a) * k / 3, y + 0.05, (c + d) / 2] for k in range(4)]
    bars += [[(a + b) / 2, y + 0.05, c + (d - c) * k / 2] for k in range(3)]
    wide = [*4 * [[0.06, 0.08, d - c]], *3 * [[b - a, 0.08, 0.06]]]
    tall, beside = HIGH + 0.02, ((e - deep / 2, e + deep / 2), (f + deep / 2, deep / 2 - f))
    return [
        boxes((0, -out, 0), (2 * end, WALL, deep), "floor", bevel=0.001),
        boxes(ceiling, sizes, "ceiling", bevel=0.001),
        boxes(bars, wide, "metal bars", bevel=0.004),
        boxes((-x, HIGH / 2, 0), (WALL, tall, deep), "wall", bevel=0.001),
        *(boxes((0, HIGH / 2, s * z), (2 * WIDE + 0.02, tall, WALL), "wall", bevel=0.001) for s in (-1, 1)),
        *(boxes((x, HIGH / 2, p / 2), (WALL, tall, q), "wall", bevel=0.001) for p, q in beside),
        boxes((x, (LINTEL + HIGH) / 2, (e + f) / 2), (WALL, HIGH - LINTEL + 0.02, f - e + 0.02), "wall", bevel=0.001),
        *_side_room(),
        *_skirting(),
    ]


def _side_room() -> list[Part]:
    """No light of its own; a chest in it that one sees from the hall."""
    near, z = WIDE + WALL - 0.02, sum(DOOR) / 2
    x, out = near + BACK / 2, WALL / 2
    at = [[x, -out, z], [x, LOW + out, z], [near + BACK + out, LOW / 2, z]]
    at += [[x, LOW / 2, z + s * (1.6 + out)] for s in (-1, 1)]
    sizes = [[BACK, WALL, 3.4], [BACK, WALL, 3.4], [WALL, LOW + 2 * WALL, 3.8], *2 * [[BACK, LOW + 2 * WALL, WALL]]]
    chest = boxes((near + BACK - 0.35, 0.45, z), (0.6, 0.9, 1.3), "oak", bevel=0.01, seed=2)
    return [boxes(at[:1], sizes[:1], "floor", bevel=0.001), boxes(at[1:], sizes[1:], "side room", bevel=0.001), chest]


def _skirting() -> list[Part]:
    e, f = DOOR
    at = [[0, 0.06, -DEEP + 0.01], [0, 0.06, DEEP - 0.01], [-WIDE + 0.01, 0.06, 0]]
    at += [[WIDE - 0.01, 0.06, (e - DEEP) / 2], [WIDE - 0.01, 0.06, (f + DEEP) / 2]]
    sizes = [*2 * [[2 * WIDE, 0.12, 0.03]], [0.03, 0.12, 2 * DEEP], [0.03, 0.12, DEEP + e], [0.03, 0.12, DEEP - f]]
    return [boxes(at, sizes, "skirting", bevel=0.004)]


def _statue() -> list[Part]:
    """A figure in a long robe, one arm raised, on a plinth."""
    plinth = boxes([[0, 0.07, 0], [0, TOP / 2, 0], [0, TOP - 0.05, 0]],
                   [[0.86, 0.14, 0.86], [0.66, TOP, 0.66], [0.78, 0.1, 0.78]], "plinth")  # fmt: skip
    robe = lathe(
        [(0, 0), (0.27, 0), (0.25, 0.12), (0.19, 0.5), (0.15, 0.72), (0.17, 0.8), (0, 0.83)], "marble", 90, ribs=15
    )
    at = place(0, TOP, 0, turn=25)
    raised = spline([[0.17, 1.2, 0], [0.34, 1.14, 0.06], [0.4, 1.38, 0.1], [0.36, 1.58, 0.1]], 24)
    hanging = spline([[-0.17, 1.2, 0], [-0.28, 1.0, 0.02], [-0.22, 0.82, 0.16], [-0.06, 0.8, 0.21]], 24)
    thick = np.linspace(0.062, 0.036, 24)
    body = [
        blob((0, 0.98, 0), (0.17, 0.26, 0.125), "marble", 0.03, 1, 30),
        blob((0, 1.17, 0), (0.215, 0.1, 0.115), "marble", 0.03, 2, 30),
        tube([[0, 1.2, 0], [0.01, 1.36, 0.01]], 0.06, "marble", 16),
        blob((0.01, 1.44, 0.025), (0.095, 0.125, 0.11), "marble", 0.04, 3, 30),
        blob((0.01, 1.49, -0.05), (0.105, 0.1, 0.1), "marble", 0.18, 4, 30),
        tube(raised, thick, "marble", 16),
        blob((0.36, 1.61, 0.1), (0.04, 0.06, 0.03), "marble", 0.1, 5, 16),
        tube(hanging, thick, "marble", 16),
        tube(spline([[0.2, 1.2, -0.05], [0, 1.06, 0.13], [-0.2, 0.85, 0.06]], 20), 0.05, "marble", 12),
    ]
    return [plinth, *(x.moved(at) for x in (robe, *body))]


def _ropes() -> list[Part]:
    """Six posts round the statue; between two of them there is no rope."""
    turn = np.radians(60 * np.arange(6) + 15)
    at = 1.25 * np.stack([np.sin(turn), 0 * turn, np.cos(turn)], 1)
    post = lathe([(0, 0), (0.14, 0), (0.13, 0.02), (0.02, 0.04), (0.02, 0.92), (0.03, 0.94), (0, 0.98)], "brass", 20)
    parts = [post.moved(place(*p)) for p in at]
    for one, other in pairwise(at):
        sag = np.linspace(0, 1, 17)[:, None]
        path = one * (1 - sag) + other * sag + [0, 0.9, 0] - 0.8 * sag * (1 - sag) * [0, 1, 0]
        parts.append(tube(path, 0.018, "rope", 8))
    return parts


def _furnished() -> list[Part]:
    """Framed pictures, a bench."""
    parts = []
    for k, (centre, (across, tall)) in enumerate(PICTURES):
        inward = np.where(np.abs(centre) >= [WIDE, HIGH, DEEP], -np.sign(centre), 0)
        size = np.where(inward != 0, 0.05, [across, tall, across])
        parts.append(boxes(centre + 0.025 * inward, size, "gilt", bevel=0.015))
        parts.append(boxes(centre + 0.035 * inward, size - np.where(inward != 0, 0, 0.14), f"picture {k}", bevel=0.002))
    bench = boxes([[-1.9, 0.44, 2.75], [-2.5, 0.2, 2.75], [-1.3, 0.2, 2.75]],
                  [[1.7, 0.08, 0.46], [0.08, 0.4, 0.4], [0.08, 0.4, 0.4]], "oak", bevel=0.01, seed=3)  # fmt: skip
    return [*parts, bench]


def looks() -> Looks:
    """Geometry and materials."""
    return Looks(soups=soups(_shell() + _statue() + _ropes() + _furnished()), surfaces=surfaces())


def _walk() -> tuple[Camera, ...]:
    """Twice round the statue looking at it, then along the walls looking at those, then up."""
    views = []
    for k in range(36):
        turn, high = 4 * np.pi * k / 36 + 0.1, (1.6, 1.35, 1.8)[k % 3]
        eye = np.array([(2.6, 3.2)[k // 18] * np.sin(turn), high, (2.3, 2.7)[k // 18] * np.cos(turn)])
        views.append((eye, np.array([0, (1.5, 1.2)[k % 2], 0])))
    for k in range(24):
        turn = 2 * np.pi * k / 24
        eye, yaw = np.array([2.1 * np.sin(turn), 1.6, 1.7 * np.cos(turn)]), turn + np.radians((28, -28)[k % 2])
        views.append((eye, eye + np.array([np.sin(yaw), (-0.12, 0.1, 0.0, -0.3)[k % 4], np.cos(yaw)])))
    for k in range(8):
        turn = 2 * np.pi * k / 8 + 0.3
        eye = np.array([2.8 * np.sin(turn), 1.6, 2.2 * np.cos(turn)])
        views.append((eye, np.array([0.8, 4.2, -0.3]) if k % 2 else np.array([-0.8, 2.1, -0.8]) * eye))
    return tuple(Camera.look_at(*view, 960, 640, yfov=60, name=f"{k}") for k, view in enumerate(views))


def _evening() -> Lighting:
    """Two lamps, and a spot on the statue."""
    at = np.array([1.6, 3.9, 2.2])
    spot = SpotLight(
        name="spot", position=at, direction=unit([0, 1.6, 0] - at), color=WARM**0.4, intensity=22.0,
        inner_cone_angle=np.radians(10), outer_cone_angle=np.radians(24),
    )  # fmt: skip
    places = ((-2.7, 3.1, -1.6), (2.6, 3.1, -1.4))
    lamps = [PointLight(name="lamp", position=np.array(p), color=WARM, intensity=4.2) for p in places]
    return Lighting(name="lamps", lights=(*lamps, spot))


def recipe() -> Recipe:
    """How the scene is made."""
    blue = outside("sky", 34.0, (16.0, 13.0, 10.0), 14, 41)
    day = Lighting(name="sunny", lights=(sunlight(14, 41, (1.0, 0.94, 0.84), 80.0, 0.6),), environment=blue)
    last = outside("evening sky", 16.0, (14.0, 7.0, 2.8), 74, 33)
    low = Lighting(name="low sun", lights=(sunlight(74, 33, (1.0, 0.64, 0.34), 85.0, 0.8),), environment=last)
    front = Camera.look_at((3.0, 1.6, 2.4), (-0.6, 1.3, -0.6), 960, 640, yfov=55, name="front")
    return Recipe(
        name="hall",
        title="A museum hall captured by day under its skylight; relit by clouds, by lamps and by a low sun.",
        looks=looks,
        captured=day,
        lightings=(Lighting(name="overcast", environment=outside("clouds", 45.0, (0, 0, 0), 0, 90)), _evening(), low),
        cameras=(front,),
        orbit=_walk(),
        pixels_per_splat=3.0,
        spacing=(0.012, 0.1),
        proxy_faces=48_000,
        proxy_error=0.004,
    )
