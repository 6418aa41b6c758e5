"""A street of houses under clouds, walked along both pavements: cars, a tree, lamp posts, an awning, a crossroads' end.

Captured without a sun, as people are told to, and relit by one. It is not shipped, and nothing is tuned on it:
`scripts/bench truth` makes it where it is needed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base.conventions import unit
from mirelight.model import Camera, Lighting, SpotLight
from scenegen.geometry import Part, blob, boxes, leaves, rectangle, sheet, soups, spline, tube
from scenegen.recipe import Recipe
from scenegen.skies import blue, clear, clouds
from scenegen.textures import Surface, paint, plain, plaster, srgb, stone, terracotta, wood
from scenegen.training import exposed
from scenegen.truth import Looks

LONG, ROAD, PAVEMENT = 11.0, 2.6, 4.6  # metres: half the street's length, half widths of the road and to the houses
DEEP = 5.0  # of the houses
HOUSES = (  # side, middle along x, width, height of the eaves, wall, door
    (-1, -7.6, 6.0, 6.2, "brick", "door red"),
    (-1, -2.2, 4.8, 5.4, "render", "door blue"),
    (-1, 3.4, 6.4, 6.6, "brick", "door green"),
    (-1, 9.0, 4.8, 5.6, "white", "door blue"),
    (1, -8.0, 5.6, 5.6, "white", "door green"),
    (1, -2.4, 5.6, 6.4, "render", "door red"),
    (1, 2.9, 5.0, 5.2, "brick", "door blue"),
    (1, 8.2, 5.6, 6.0, "render", "door green"),
)
STOREY = 2.75
LEGS = tuple((a, b) for a in (-0.18, 0.18) for b in (-0.18, 0.18))  # of a chair
CARS = ((-5.6, 1, "car silver"), (2.2, -1, "car red"), (6.4, 1, "car silver"))  # x, side of the road, material
TREES = (0.2, 7.4, -6.8)  # x, on the pavement at -Z
LANTERNS = ((-4.5, -1), (4.0, 1))  # x and side of the lamp posts


def surfaces() -> dict[str, Surface]:
    """Every material."""
    return {
        "asphalt": Surface(texture=stone(srgb(96, 96, 98), srgb(66, 66, 68), 701), size=3.0),
        "kerb": Surface(texture=stone(srgb(168, 164, 156), srgb(120, 116, 110), 703), size=1.5),
        "paving": Surface(texture=stone(srgb(158, 152, 144), srgb(112, 106, 100), 705), size=1.2),
        "paint": Surface(texture=paint(srgb(226, 226, 220), srgb(120, 120, 120), 707), size=1.5),
        "brick": Surface(texture=terracotta(srgb(150, 84, 62), 709), size=1.8),
        "render": Surface(
            texture=plaster(srgb(222, 198, 152), srgb(204, 172, 124), srgb(160, 134, 100), 711), size=4.0
        ),
        "white": Surface(texture=plaster(srgb(224, 222, 216), srgb(206, 204, 198), srgb(170, 166, 160), 713), size=4.0),
        "trim": Surface(texture=plain(srgb(232, 230, 224), 715, contrast=0.04), size=1.0),
        "glass": Surface(texture=plain(srgb(48, 56, 66), 717, contrast=0.3), size=1.4),
        "roof": Surface(texture=terracotta(srgb(148, 76, 54), 719), size=2.0),
        "slate": Surface(texture=stone(srgb(98, 102, 112), srgb(66, 68, 78), 721), size=1.6),
        "door red": Surface(texture=paint(srgb(150, 34, 34), srgb(96, 60, 50), 723), size=1.2),
        "door blue": Surface(texture=paint(srgb(36, 72, 124), srgb(80, 84, 90), 725), size=1.2),
        "door green": Surface(texture=paint(srgb(38, 92, 62), srgb(84, 84, 70), 727), size=1.2),
        "car silver": Surface(texture=plain(srgb(176, 180, 184), 729, contrast=0.03), size=2.0),
        "car red": Surface(texture=plain(srgb(160, 30, 34), 731, contrast=0.03), size=2.0),
        "tyre": Surface(texture=plain(srgb(40, 40, 42), 733, contrast=0.1), size=0.5),
        "iron": Surface(texture=plain(srgb(46, 54, 50), 735, contrast=0.08), size=0.5),
        "bark": Surface(texture=wood(srgb(112, 92, 74), srgb(70, 56, 46), 737), size=0.8),
        "leaf": Surface(texture=plain(srgb(84, 122, 58), 739, contrast=0.3), size=0.5),
        "cloth": Surface(texture=plain(srgb(206, 64, 46), 741, contrast=0.08), size=1.0),
        "wood": Surface(texture=wood(srgb(150, 112, 74), srgb(98, 70, 46), 743), size=0.8),
    }


def _ground() -> list[Part]:
    """A road with a broken line, kerbs and pavements; at +X it goes on to a field."""
    far = LONG + 14
    road = rectangle((-LONG - 4, 0, ROAD), (far + LONG + 4, 0, 0), (0, 0, -2 * ROAD), "asphalt")
    walks = [boxes((7.0, -0.02, s * (ROAD + 1.15)), (36.0, 0.28, 2.3), "paving", bevel=0.01) for s in (-1, 1)]
    kerbs = [boxes((7.0, -0.01, s * ROAD), (36.0, 0.28, 0.16), "kerb", bevel=0.02) for s in (-1, 1)]
    x = np.arange(-LONG, far, 2.4)
    line = boxes(np.stack([x, 0 * x, 0 * x], 1), np.tile([1.2, 0.012, 0.12], (len(x), 1)), "paint", bevel=0.001)
    field = rectangle((LONG + 1, -0.05, 30), (30, 0, 0), (0, 0, -60), "leaf", 1.0)
    return [road, *walks, *kerbs, line, field]


def _house(side: int, x: float, wide: float, eaves: float, wall: str, door: str) -> list[Part]:
    """A front with windows on two storeys, a door with steps, a roof with its ridge along the street."""
    z, out = side * PAVEMENT, -side
    middle = z + side * DEEP / 2
    parts = [boxes((x, eaves / 2, middle), (wide, eaves, DEEP), wall, bevel=0.02)]
    columns = np.arange(int(wide // 1.6)) - (int(wide // 1.6) - 1) / 2
    places = [(x + 1.6 * c, 1.45 + STOREY * k) for c in columns for k in range(int(eaves // STOREY))]
    way_in, *places = places
    at = np.array([[a, b, z] for a, b in places])
    tall = np.array([0.0, 0.0, 1.0])
    parts += [
        boxes(at, np.tile([1.02, 1.36, 0.16], (len(at), 1)), "trim", bevel=0.01),
        boxes(at + tall * out * 0.06, np.tile([0.86, 1.2, 0.06], (len(at), 1)), "glass", bevel=0.002),
        boxes(at + tall * out * 0.08, np.tile([0.05, 1.2, 0.06], (len(at), 1)), "trim", bevel=0.002),
        boxes(at + np.array([0, -0.72, out * 0.1]), np.tile([1.16, 0.08, 0.28], (len(at), 1)), "kerb", bevel=0.01),
        boxes((way_in[0], 1.22, z), (1.14, 2.2, 0.2), "trim", bevel=0.01),
        boxes((way_in[0], 1.18, z + out * 0.08), (0.92, 2.0, 0.08), door, bevel=0.01),
        boxes((way_in[0], 0.16, z + out * 0.25), (1.3, 0.2, 0.5), "kerb", bevel=0.02),
    ]
    over, ridge = 0.35, eaves + 1.7
    roof = "slate" if wall == "brick" else "roof"
    ends = (x - wide / 2, x + wide / 2)
    for s in (-1, 1):
        low, high = middle + s * (DEEP / 2 + over), middle
        for lift in (0.0, 0.12):
            edge = np.array([[[e, eaves - 0.15 + lift, low] for e in ends], [[e, ridge + lift, high] for e in ends]])
            parts.append(sheet(edge, roof, flip=(s > 0) == (lift > 0)))
    for k, e in enumerate(ends):
        foot = [[e, eaves, middle - DEEP / 2], [e, eaves, middle], [e, eaves, middle + DEEP / 2]]
        top = [[e, eaves, middle - DEEP / 2], [e, ridge, middle], [e, eaves, middle + DEEP / 2]]
        parts.append(sheet(np.array([foot, top]), wall, flip=k == 0))
    parts.append(boxes((x + wide / 3, ridge, middle), (0.7, 1.6, 0.6), "brick", bevel=0.02))
    return parts


def _end() -> list[Part]:
    """The street's end at -X: a house across it with a gate."""
    x = -LONG - 0.4
    block = boxes((x - 2.0, 3.2, 0), (4.0, 6.4, 2 * PAVEMENT + 2), "white", bevel=0.02)
    gate = boxes([[x, 1.35, 0], [x + 0.06, 1.3, 0]], [[0.2, 2.7, 2.6], [0.1, 2.5, 2.3]], "wood", bevel=0.01)
    at = np.array([[x, 4.3, z] for z in (-3.0, -1.0, 1.0, 3.0)] + [[x, 1.6, z] for z in (-3.2, 3.2)])
    frames = boxes(at, np.tile([0.16, 1.36, 1.02], (len(at), 1)), "trim", bevel=0.01)
    panes = boxes(at + np.array([0.06, 0, 0]), np.tile([0.06, 1.2, 0.86], (len(at), 1)), "glass", bevel=0.002)
    return [block, gate, frames, panes]


def _car(x: float, side: int, paint_name: str) -> list[Part]:
    z = side * (ROAD - 1.0)
    s, t = np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 24), indexing="ij")
    cabin = 0.62 * np.clip(1 - np.abs((s + 0.08) / 0.66) ** 4, 0, 1) * np.clip(1 - np.abs(t) ** 6 * 0.5, 0, 1)
    hood = 0.78 - 0.1 * np.abs(s) ** 3 + cabin
    top = sheet(np.stack([x + 2.05 * s, hood, z + (0.86 - 0.14 * (cabin > 0.2)) * t], -1), paint_name, flip=True)
    body = boxes((x, 0.52, z), (4.1, 0.56, 1.74), paint_name, bevel=0.1)
    panes = boxes([[x - 0.15, 1.1, z + k * 0.76] for k in (-1, 1)], [[1.9, 0.3, 0.04]] * 2, "glass", bevel=0.01)
    wheels = [blob((x + a, 0.32, z + b), (0.32, 0.32, 0.12), "tyre", 0.0, 3, 18) for a in (-1.25, 1.25)
              for b in (-0.84, 0.84)]  # fmt: skip
    return [top, body, panes, *wheels]


def _lantern(x: float, side: int) -> list[Part]:
    z, up = side * (ROAD + 0.45), 3.6
    arm = spline([[x, up, z], [x, up + 0.35, z], [x, up + 0.4, z - side * 0.35], [x, up + 0.3, z - side * 0.6]], 20)
    return [
        tube([[x, 0.1, z], [x, 0.7, z], [x, 0.75, z], [x, up, z]], [0.11, 0.1, 0.05, 0.04], "iron", 12),
        tube(arm, 0.025, "iron", 8),
        blob((x, up + 0.2, z - side * 0.6), (0.16, 0.1, 0.16), "iron", 0.0, 4, 14),
    ]


def _tree(x: float, side: int, seed: int) -> list[Part]:
    """On the pavement in a square of earth, a round crown of leaves about a core."""
    rng = np.random.default_rng(seed)
    z = side * (ROAD + 0.6)
    trunk = spline([[x, 0.05, z], [x + 0.05, 1.2, z], [x - 0.05, 2.3, z], [x, 3.0, z]], 14)
    centre = np.array([x, 3.5, z])
    d = rng.normal(size=(900, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    at = centre + d * [0.95, 1.05, 0.95] * rng.uniform(0.75, 1.08, (len(d), 1))
    crown = leaves(at, d + 0.7 * rng.normal(size=d.shape), rng.uniform(0.12, 0.22, len(d)), "leaf", rng, width=0.6)
    return [
        tube(trunk, np.linspace(0.12, 0.07, 14), "bark", 12),
        blob(centre, (0.78, 0.86, 0.78), "leaf", 0.2, seed, 24),
        crown,
        boxes((x, 0.11, z), (1.0, 0.06, 1.0), "wood", bevel=0.01),
    ]


def _things() -> list[Part]:
    """An awning over a shop's front, tables and chairs, bins, a letter box, posts along a kerb."""
    z = PAVEMENT
    awning = [
        sheet(np.array([[[x, high, z], [x, low, z - 1.3]] for x in (-4.6, -0.4)]), "cloth", flip=below)
        for high, low, below in ((2.75, 2.3, False), (2.73, 2.28, True))
    ]
    tables = []
    for x in (-3.6, -1.6):
        tables += [
            boxes((x, 0.84, z - 0.9), (0.7, 0.04, 0.7), "wood", bevel=0.005),
            tube([[x, 0.12, z - 0.9], [x, 0.84, z - 0.9]], 0.04, "iron", 8),
            boxes(
                [[x + 0.65, 0.56, z - 0.9], [x + 0.86, 0.82, z - 0.9]],
                [[0.42, 0.05, 0.42], [0.04, 0.5, 0.42]],
                "wood",
                bevel=0.005,
            ),
            boxes(
                [[x + 0.65 + a, 0.33, z - 0.9 + b] for a, b in LEGS],
                [[0.04, 0.44, 0.04]] * 4,
                "wood",
                bevel=0.003,
            ),
        ]
    bins = boxes(
        [[6.3, 0.65, -PAVEMENT + 0.45], [7.0, 0.65, -PAVEMENT + 0.45]],
        [[0.55, 1.05, 0.6]] * 2,
        "door green",
        bevel=0.04,
    )
    box = boxes((-0.4, 0.75, -ROAD - 0.5), (0.5, 1.3, 0.45), "door red", bevel=0.05)
    posts = [tube([[x, 0.1, ROAD + 0.3], [x, 0.95, ROAD + 0.3]], 0.06, "iron", 10) for x in np.arange(-1.0, 2.1, 1.0)]
    return [*awning, *tables, bins, box, *posts]


def looks() -> Looks:
    """Geometry and materials."""
    parts = _ground() + _end() + _things()
    for car in CARS:
        parts += _car(*car)
    for house in HOUSES:
        parts += _house(*house)
    for at in LANTERNS:
        parts += _lantern(*at)
    for k, x in enumerate(TREES):
        parts += _tree(x, -1, 61 + k)
    return Looks(soups=soups(parts), surfaces=surfaces())


def _lit() -> Lighting:
    """The lamp posts at night."""
    spots = tuple(
        SpotLight(
            name=f"lantern {k}",
            position=np.array([x, 3.6, side * (ROAD - 0.15)]),
            direction=unit(np.array([0.05, -1.0, -0.15 * side])),
            color=np.array([1.0, 0.7, 0.42]),
            intensity=60.0,
            inner_cone_angle=0.5,
            outer_cone_angle=1.15,
        )
        for k, (x, side) in enumerate(LANTERNS)
    )
    return Lighting(name="lanterns", lights=spots, environment=blue(0, 8, 0.1))


def _walk() -> list[Camera]:
    """Along both pavements, looking across; along the road, looking up and down it; from both ends."""
    ways: list[tuple[ArrayLike, ArrayLike]] = []
    for k in range(20):
        across = (1.05, 3.0, -1.35, 0.3)[k % 4], 0.1 * (k % 3)
        ahead = (4.0, -4.0)[k % 2], 0.2 * (k % 3), (-1.6, 1.2, 0.4)[k % 3]
        x = -8.0 + 0.77 * k
        ways += [
            ((x, 1.6, 3.5), (*across, -3.0)),
            ((x + 0.23, 1.7, -3.5), (*across, 3.0)),
            ((x + 0.46, 1.5, 0.3), ahead),
        ]
    for k in range(12):
        eye = np.array(((-9.5, 8.5)[k % 2], 1.2 + 0.15 * k, 2.4 * np.sin(2.1 * k)))
        ways.append((eye, np.array((0.0, 1.6, 1.5 * np.cos(1.3 * k))) - eye))
    return [
        Camera.look_at(eye, np.add(eye, look), 960, 640, yfov=58, name=f"{k}") for k, (eye, look) in enumerate(ways)
    ]


def recipe() -> Recipe:
    """How the scene is made."""
    front = Camera.look_at((6.0, 1.7, 0.8), (-2.0, 1.9, -0.5), 960, 640, yfov=52, name="front")
    return Recipe(
        name="street",
        title="A street captured under clouds; relit by a high sun, a low one and its lanterns at night.",
        looks=looks,
        captured=exposed(clouds(), 0.75),
        lightings=(
            clear("clear day", (62, 46), (1.0, 0.94, 0.85), 3.8, 1.1),
            clear("low sun", (-18, 20), (1.0, 0.62, 0.32), 4.2, 0.75),
            _lit(),
        ),
        cameras=(front,),
        orbit=tuple(_walk()),
        pixels_per_splat=3.0,
        spacing=(0.03, 0.2),
        proxy_faces=60_000,
        proxy_error=0.01,
    )
