"""Albedo estimated from splats that were baked from a known one, under light whose field is known or traced apart."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.base import colour, sh
from mirelight.base.errors import RenderError
from mirelight.lighting import Tracer
from mirelight.lighting.albedo import colored_by, vertex_colors
from mirelight.lighting.observed import observed
from mirelight.model import (
    Camera,
    DirectionalLight,
    Environment,
    Lighting,
    Material,
    PointLight,
    ProxyMesh,
    RenderSettings,
    SplatCloud,
    SpotLight,
)
from mirelight.model.profiles import BRIGHTEST

F64 = NDArray[np.float64]
SETTINGS = RenderSettings(spp=16, max_depth=6, seed=3)
RED, GREEN, WHITE = np.array([0.6, 0.1, 0.08]), np.array([0.12, 0.45, 0.1]), np.array([0.7, 0.7, 0.7])


def quad(corner: Any, along: Any, across: Any, parts: int = 1) -> tuple[F64, NDArray[np.int32]]:
    """A parallelogram of parts x parts quads that faces along x across."""
    c, a, b = (np.asarray(x, np.float64) for x in (corner, along, across))
    s, t = np.meshgrid(np.linspace(0, 1, parts + 1), np.linspace(0, 1, parts + 1), indexing="ij")
    vertices = c + s.reshape(-1, 1) * a + t.reshape(-1, 1) * b
    i = np.arange(parts)[:, None] * (parts + 1) + np.arange(parts)
    first = i.ravel()
    one = np.stack([first, first + parts + 1, first + parts + 2], axis=1)
    two = np.stack([first, first + parts + 2, first + 1], axis=1)
    return vertices, np.concatenate([one, two]).astype(np.int32)


def joined(*pieces: tuple[F64, NDArray[np.int32]], weld: bool = False) -> ProxyMesh:
    starts = np.cumsum([0] + [len(v) for v, _ in pieces])
    vertices = np.concatenate([v for v, _ in pieces])
    faces = np.concatenate([f + s for (_, f), s in zip(pieces, starts, strict=False)])
    if weld:
        vertices, place = np.unique(vertices, axis=0, return_inverse=True)
        faces = place.ravel()[faces]
    return ProxyMesh(vertices=vertices.astype(np.float32), faces=faces.astype(np.int32))


def splats_on(points: F64, normals: F64, color: F64, size: float) -> SplatCloud:
    """Flat splats of linear colours; the quaternion turns z onto the normal."""
    half = np.stack([1 + normals[:, 2], -normals[:, 1], normals[:, 0], 0 * normals[:, 0]], axis=1)
    half[half[:, 0] < 1e-9] = [0, 1, 0, 0]
    fields: dict[str, Any] = {
        "means": points,
        "quats": half / np.linalg.norm(half, axis=1, keepdims=True),
        "scales": np.tile([size, size, size / 20], (len(points), 1)),
        "opacities": np.full(len(points), 0.9),
        "sh": ((colour.srgb_encode(color) - 0.5) / sh.C0)[:, None],
    }
    return SplatCloud(**fields)


def lit(towards: tuple[float, float, float], lux: float) -> Lighting:
    return Lighting(lights=(DirectionalLight(name="sun", direction=np.asarray(towards, np.float64), intensity=lux),))


def test_floor_under_a_sun() -> None:
    """A floor with no bounces: a = pi c / (E cos), whatever the colour and its change from place to place."""
    floor = joined(quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), parts=8))
    rng = np.random.default_rng(1)
    at = np.stack([rng.uniform(-1, 1, 6000), rng.normal(0, 0.002, 6000), rng.uniform(-1, 1, 6000)], axis=1)
    albedo = np.where(at[:, :1] < 0, RED, GREEN)
    color = albedo * 2.5 * np.cos(np.radians(40)) / np.pi
    sun = lit((0.0, -np.cos(np.radians(40)), np.sin(np.radians(40))), 2.5)
    up = np.tile([0.0, 1.0, 0.0], (len(at), 1))
    found = colored_by(splats_on(at, up, color, 0.02), floor, sun, SETTINGS)
    assert found.albedo is None and found.vertex_colors is not None
    for side, wanted in ((-1, RED), (1, GREEN)):
        inner = side * found.vertices[:, 0] > 0.3
        # 1.01: one percent of the light is added where it divides
        np.testing.assert_allclose(found.vertex_colors[inner], np.tile(wanted / 1.01, (inner.sum(), 1)), rtol=0.005)


def test_a_splat_brighter_than_white_tells_no_more_than_white() -> None:
    """Every third splat of a dark floor shows what lies behind it: four times what white would show there."""
    floor = joined(quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), parts=2))
    rng = np.random.default_rng(1)
    at = np.stack([rng.uniform(-1, 1, 9000), np.zeros(9000), rng.uniform(-1, 1, 9000)], axis=1)
    light, dark = 0.5 * np.cos(np.pi / 6), 0.05
    shown = np.full((9000, 3), dark) * light / np.pi
    shown[::3] = 4 * light / np.pi
    splats = splats_on(at, np.tile([0.0, 1.0, 0.0], (9000, 1)), shown, 0.02)
    found = colored_by(splats, floor, lit((-0.5, -np.sqrt(0.75), 0), 0.5), SETTINGS)
    np.testing.assert_allclose(np.asarray(found.vertex_colors), (2 * dark + BRIGHTEST) / 3, rtol=0.08)


def test_clipped_splats_count_only_where_there_are_no_others() -> None:
    """A floor under a lamp whose light ends at white in the middle: its colour is told by the splats round it."""
    floor = joined(quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), parts=2))  # the lamp's middle is one vertex of nine
    rng = np.random.default_rng(3)
    at = np.stack([rng.uniform(-2, 2, 20000), np.zeros(20000), rng.uniform(-2, 2, 20000)], axis=1)
    up = np.tile([0.0, 1.0, 0.0], (len(at), 1))
    squared = 1 + at[:, 0] ** 2 + at[:, 2] ** 2
    color = 0.7 * (2 * np.pi) / squared**1.5 / np.pi
    assert 0.02 < (color > 1).mean() < 0.2
    splats = splats_on(at, up, np.repeat(np.minimum(color, 1)[:, None], 3, axis=1), 0.02)
    lamp = Lighting(lights=(PointLight(name="lamp", position=np.array([0.0, 1, 0]), intensity=2 * np.pi),))
    found = colored_by(splats, floor, lamp, SETTINGS)
    assert found.vertex_colors is not None
    np.testing.assert_allclose(found.vertex_colors, 0.7, rtol=0.05)  # dark corners: a percent of the mean is added
    middle = np.abs(found.vertices[:, [0, 2]]).max(axis=1) < 0.1
    np.testing.assert_allclose(found.vertex_colors[middle], 0.7, rtol=0.02)
    # all of it past white: what is left is a lower bound, as bright as clipped splats say
    bright = replace(lamp, lights=(replace(lamp.lights[0], intensity=200 * np.pi),))
    bound = colored_by(splats_on(at, up, np.ones((len(at), 3)), 0.02), floor, bright, SETTINGS)
    assert bound.vertex_colors is not None
    assert 0 < bound.vertex_colors[middle].max() < 0.05


@pytest.mark.parametrize("parts", [4, 96])
def test_a_fine_mesh_has_the_colours_of_a_coarse_one(parts: int) -> None:
    """More vertices than splats: neither the noise of a splat nor that it is clipped is its vertex's colour."""
    floor = joined(quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), parts=parts))
    rng = np.random.default_rng(4)
    at = np.stack([rng.uniform(-2, 2, 4000), np.zeros(4000), rng.uniform(-2, 2, 4000)], axis=1)
    up = np.tile([0.0, 1.0, 0.0], (len(at), 1))
    squared = 1 + at[:, 0] ** 2 + at[:, 2] ** 2
    color = 0.7 * rng.uniform(0.7, 1.3, len(at)) * (2 * np.pi) / squared**1.5 / np.pi
    assert 0.02 < (color > 1).mean() < 0.2
    splats = splats_on(at, up, np.repeat(np.minimum(color, 1)[:, None], 3, axis=1), 0.02)
    lamp = Lighting(lights=(PointLight(name="lamp", position=np.array([0.0, 1, 0]), intensity=2 * np.pi),))
    found = colored_by(splats, floor, lamp, SETTINGS)
    assert found.vertex_colors is not None
    off = np.abs(found.vertex_colors / 0.7 - 1)
    assert np.median(off) < 0.1 and np.quantile(off, 0.95) < 0.25, np.quantile(off, [0.5, 0.95, 1])


def test_pooling_keeps_walls_apart() -> None:
    """A few splats on either side of a fine wall, seen from both: colours do not mix through it."""
    front, back = (
        quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), parts=60),
        quad((-1, -1, -0.01), (0, 2, 0), (2, 0, 0), parts=60),
    )
    wall = joined(front, back)
    rng = np.random.default_rng(6)
    at = np.stack([rng.uniform(-1, 1, 1000), rng.uniform(-1, 1, 1000), np.where(np.arange(1000) % 2, 0, -0.01)], axis=1)
    side = np.where(np.arange(1000) % 2, 1.0, -1.0)
    normals = np.stack([np.zeros(1000), np.zeros(1000), side], axis=1)
    sky = Lighting(environment=Environment(radiance=np.full((1, 1, 3), 0.8, np.float32)))
    color = np.where(side[:, None] > 0, RED, GREEN) * 0.8
    found = colored_by(splats_on(at, normals, color, 0.02), wall, sky, SETTINGS)
    assert found.vertex_colors is not None
    for z, wanted in ((0.0, RED), (-0.01, GREEN)):
        there = np.abs(found.vertices[:, 2] - z) < 1e-4
        assert there.any()
        np.testing.assert_allclose(found.vertex_colors[there], np.tile(wanted / 1.01, (there.sum(), 1)), rtol=0.03)


@pytest.mark.parametrize("facing", [1, -1])
def test_what_lies_inside_is_not_what_was_seen(facing: int) -> None:
    """A closed box of either winding: only its outside is lit, so only that can be what the splats show."""
    half = 0.5
    sides, normals = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            n = np.eye(3)[axis] * sign
            a = np.eye(3)[(axis + 1) % 3]
            b = np.cross(n, a)
            sides.append(quad(half * (n - a - b), a, b, parts=4))
            normals.append(n)
    box = joined(*sides)
    if facing < 0:
        box = replace(box, faces=box.faces[:, ::-1])
    rng = np.random.default_rng(2)
    n = np.repeat(normals, 400, axis=0)
    at = rng.uniform(-half, half, n.shape)
    at = np.where(np.abs(n) > 0.5, half * n, at)
    sky = Lighting(environment=Environment(radiance=np.full((1, 1, 3), 0.8, np.float32)))
    found = colored_by(splats_on(at, n, np.tile(GREEN * 0.8, (len(at), 1)), 0.02), box, sky, SETTINGS)
    assert found.vertex_colors is not None
    np.testing.assert_allclose(found.vertex_colors, np.tile(GREEN / 1.01, (len(found.vertices), 1)), rtol=0.01)


# --- a room whose walls light each other -----------------------------------------------------------------------------

WALLS: dict[str, tuple[Any, Any, Any, F64]] = {  # open towards +Z; corner, edges, albedo
    "floor": ((-1, -1, 1), (2, 0, 0), (0, 0, -2), WHITE),
    "ceiling": ((-1, 1, -1), (2, 0, 0), (0, 0, 2), WHITE),
    "back": ((-1, -1, -1), (2, 0, 0), (0, 2, 0), WHITE),
    "left": ((-1, -1, 1), (0, 0, -2), (0, 2, 0), RED),
    "right": ((1, -1, -1), (0, 0, 2), (0, 2, 0), GREEN),
}
LAMP = Lighting(lights=(PointLight(name="lamp", position=np.array([0.3, 0.6, 0.2]), intensity=4.0),))
LOW_LAMP = Lighting(lights=(PointLight(name="low", position=np.array([-0.5, -0.4, -0.3]), intensity=4.0),))


@cache
def true_room() -> ProxyMesh:
    pieces = [quad(*where[:3], 6) for where in WALLS.values()]
    colors = np.concatenate([np.tile(w[3], (len(v), 1)) for w, (v, _) in zip(WALLS.values(), pieces, strict=True)])
    return replace(joined(*pieces), vertex_colors=colors, albedo=None)


@cache
def room_splats() -> SplatCloud:
    """2,000 splats a wall, showing what the true room sends out under the lamp."""
    rng = np.random.default_rng(5)
    at, normal, albedo = [], [], []
    for corner, along, across, color in WALLS.values():
        s, t = rng.uniform(0, 1, (2, 2000, 1))
        at.append(np.asarray(corner) + s * np.asarray(along) + t * np.asarray(across))
        n = np.cross(along, across) / np.linalg.norm(np.cross(along, across))
        normal.append(np.tile(n, (2000, 1)))
        albedo.append(np.tile(color, (2000, 1)))
    points, normals = np.concatenate(at), np.concatenate(normal)
    light = Tracer(true_room(), replace(SETTINGS, seed=77)).point_layers(LAMP, points, normals, 256).total
    return splats_on(points, normals, np.concatenate(albedo) * light / np.pi, 0.02)


@cache
def found_room(parts: int, weld: bool) -> ProxyMesh:
    gray = joined(*(quad(*where[:3], parts) for where in WALLS.values()), weld=weld)
    return colored_by(room_splats(), gray, LAMP, SETTINGS)


def wall_colors(room: ProxyMesh, name: str) -> NDArray[np.float32]:
    """Vertex colours of the faces of one wall."""
    corner, along, across, _ = WALLS[name]
    n = np.cross(along, across)
    v = room.vertices[room.faces].astype(np.float64)
    on = np.abs((v - np.asarray(corner)) @ n).max(axis=1) < 1e-4
    assert room.vertex_colors is not None
    return np.asarray(room.vertex_colors[room.faces[on].ravel()])


@pytest.mark.parametrize(("parts", "weld"), [(6, False), (6, True), (1, True)])
def test_walls_keep_their_own_colours(parts: int, weld: bool) -> None:
    """Also where walls share the vertices of their edges, and where a wall is two triangles."""
    room = found_room(parts, weld)
    for name, (_, _, _, wanted) in WALLS.items():
        colors = wall_colors(room, name)
        assert len(colors) == 6 * parts * parts
        np.testing.assert_allclose(colors.mean(axis=0), wanted, rtol=0.05, atol=0.005)
        np.testing.assert_allclose(colors, np.tile(wanted, (len(colors), 1)), rtol=0.12, atol=0.02)


def test_bounced_light_has_the_right_colour_under_another_light() -> None:
    """Next to the red wall the floor's indirect light is that of the true room; a gray one has it wrong."""
    camera = Camera.look_at((0, 0, 3.2), (0, 0, 0), 32, 32, yfov=36)
    settings = replace(SETTINGS, spp=256)

    def spread(room: ProxyMesh) -> NDArray[np.float32]:
        """Indirect irradiance, over pi."""
        buffer = Tracer(room, settings).trace(LOW_LAMP, camera)
        indirect = sum((x.indirect for x in buffer.layers), np.zeros_like(buffer.albedo))
        return np.asarray(indirect / buffer.albedo, np.float32)

    true, found = spread(true_room()), spread(found_room(1, True))
    gray = spread(replace(true_room(), albedo=np.full(3, 0.5)))
    error = np.abs(found - true).mean(axis=(0, 1)) / true.mean(axis=(0, 1))
    assert np.all(error < 0.04)
    assert np.all(np.abs(gray - true).mean(axis=(0, 1)) / true.mean(axis=(0, 1)) > 4 * error)


# --- the rest --------------------------------------------------------------------------------------------------------


def test_a_clipped_thing_is_as_bright_as_it_shows_at_least() -> None:
    """A light rug that lies in the sun as a whole, red past white: the dark floor does not tell its colour."""
    floor = joined(quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), parts=40))
    rng = np.random.default_rng(5)
    at = np.stack([rng.uniform(-2, 2, 40000), np.zeros(40000), rng.uniform(-2, 2, 40000)], axis=1)
    cone = np.arctan(0.55)
    spot = SpotLight(
        name="sun",
        position=np.array([0.0, 1, 0]),
        direction=np.array([0.0, -1, 0]),
        intensity=8.0,
        inner_cone_angle=float(cone) * 0.95,
        outer_cone_angle=float(cone),
    )
    lamp = replace(lit((0.0, -1.0, 0.0), 0.4), lights=(spot, *lit((0.0, -1.0, 0.0), 0.4).lights))
    rug = np.abs(at[:, [0, 2]]).max(axis=1) < 0.35
    dye = np.where(rug[:, None], [0.8, 0.3, 0.2], [0.2, 0.15, 0.1])
    up = np.tile([0.0, 1.0, 0.0], (len(at), 1))
    shown = dye * Tracer(floor, SETTINGS).point_layers(lamp, at, up, 16).total / np.pi
    assert (shown[rug, 0] > 1).all() and (shown[:, 1:] < 1).all()
    found = colored_by(splats_on(at, up, np.minimum(shown, 1), 0.02), floor, lamp, SETTINGS)
    middle = np.abs(found.vertices[:, [0, 2]]).max(axis=1) < 0.21
    red, green, blue = np.asarray(found.vertex_colors)[middle].T
    assert (red > 0.37).all()  # white, in light of 8.4 at the middle
    np.testing.assert_allclose(np.mean(green), 0.3, rtol=0.04)
    np.testing.assert_allclose(np.mean(blue), 0.2, rtol=0.04)


RUG = np.array([0.8, 0.4, 0.25])
NOON = Lighting(
    lights=(
        SpotLight(
            name="sun",
            position=np.array([0.0, 0.9, 0.0]),
            direction=np.array([0.0, -1.0, 0.0]),
            intensity=40.0,
            inner_cone_angle=float(np.radians(14)),
            outer_cone_angle=float(np.radians(15)),
        ),
    )
)


def test_light_from_a_patch_past_white_is_as_bright_as_it_was() -> None:
    """A closed room lit by a patch of sun alone, on a rug that goes on around it; two of its channels are white."""
    walls = WALLS | {"front": ((1, -1, 1), (-2, 0, 0), (0, 2, 0), WHITE)}
    pieces = [quad(c, a, b, 24 if name == "floor" else 6) for name, (c, a, b, _) in walls.items()]
    gray, rng = joined(*pieces), np.random.default_rng(5)
    colors, at, up = [], [], []
    for (corner, along, across, color), (vertices, _) in zip(walls.values(), pieces, strict=True):
        on_rug = (vertices[:, 1] == -1) & (np.abs(vertices[:, [0, 2]]).max(axis=1) < 0.76) & (len(vertices) > 100)
        colors.append(np.where(on_rug[:, None], RUG, color))
        s, t = rng.uniform(0, 1, (2, 4000 if len(vertices) > 100 else 1000, 1))
        at.append(np.asarray(corner) + s * np.asarray(along) + t * np.asarray(across))
        n = np.cross(along, across) / np.linalg.norm(np.cross(along, across))
        up.append(np.tile(n, (len(s), 1)))
    points, normals = np.concatenate(at), np.concatenate(up)
    true = replace(gray, vertex_colors=np.concatenate(colors).astype(np.float32), albedo=None)
    tracer = Tracer(true, replace(SETTINGS, seed=77))
    shown = tracer.materials_at(points, normals)[0] * tracer.point_layers(NOON, points, normals, 64).total / np.pi
    patch = np.hypot(points[:, 0], points[:, 2]) < 0.4
    lit_rug = shown[patch & (points[:, 1] == -1)]
    assert (lit_rug[:, :2] > 1).all() and (lit_rug[:, 2] < 0.97).all()
    assert 0.02 < (shown > 1).any(axis=1).mean() < 0.1
    found = colored_by(splats_on(points, normals, np.minimum(shown, 1), 0.02), gray, NOON, SETTINGS)

    high = np.array([[x, 1.0, z] for x in (-0.5, 0.0, 0.5) for z in (-0.5, 0.0, 0.5)])
    down = np.tile([0.0, -1.0, 0.0], (len(high), 1))

    def bounced(room: ProxyMesh) -> F64:
        """(3,) on the ceiling."""
        light = Tracer(room, replace(SETTINGS, seed=9)).point_layers(NOON, high, down, 1024).total
        return np.asarray(light.mean(axis=0), np.float64)

    np.testing.assert_allclose(bounced(found), bounced(true), rtol=0.06)


def test_same_seed_same_bits() -> None:
    gray = joined(*(quad(*where[:3], 6) for where in WALLS.values()))
    again = colored_by(room_splats(), gray, LAMP, SETTINGS)
    first = found_room(6, False)
    assert first.vertex_colors is not None and again.vertex_colors is not None
    np.testing.assert_array_equal(again.vertex_colors, first.vertex_colors)


def test_surface_stays_and_glow_stays() -> None:
    """Vertices are split, never moved; the file's own colours go, its emission does not."""
    lamp = Material(name="lamp", base_color=np.array([0.2, 0.9, 0.1]), emissive=np.array([3.0, 2.0, 1.0]))
    gray = joined(*(quad(*where[:3], 2) for where in WALLS.values()), weld=True)
    normals = np.tile(np.array([0, 1, 0], np.float32), (len(gray.vertices), 1))
    gray = replace(
        gray,
        materials=(Material(), lamp),
        normals=normals,
        face_materials=(np.arange(len(gray.faces)) % 2).astype(np.int32),
    )
    found = colored_by(room_splats(), gray, LAMP, SETTINGS)
    np.testing.assert_array_equal(found.vertices[found.faces], gray.vertices[gray.faces])
    assert found.face_materials is not None and found.normals is not None
    assert found.normals.shape == found.vertices.shape
    np.testing.assert_array_equal(found.materials[1].emissive, lamp.emissive)
    np.testing.assert_array_equal(found.materials[1].base_color, np.ones(3))


def test_vertices_without_splats_take_their_neighbours_colour() -> None:
    """Splats cover half of a strip; the other half, and an island beside it, are filled."""
    strip = joined(quad((-1, 0, 0.1), (2, 0, 0), (0, 0, -0.2), parts=12), quad((3, 0, 0), (0.1, 0, 0), (0, 0, -0.1)))
    rng = np.random.default_rng(1)
    at = np.stack([rng.uniform(-1, 0, 3000), np.zeros(3000), rng.uniform(-0.1, 0.1, 3000)], axis=1)
    color = np.tile(RED / np.pi, (len(at), 1))
    found = colored_by(splats_on(at, np.tile([0.0, 1, 0], (3000, 1)), color, 0.01), strip, lit((0, -1, 0), 1), SETTINGS)
    assert found.vertex_colors is not None
    np.testing.assert_allclose(found.vertex_colors, np.tile(RED / 1.01, (len(found.vertices), 1)), rtol=0.01)


def test_what_was_never_seen_is_not_as_bright_as_the_outline_of_what_was() -> None:
    """A red strip was seen as far as its middle, and its last splats there show light bled from a white wall."""
    strip = joined(quad((-1, 0, 0.1), (2, 0, 0), (0, 0, -0.2), parts=48))
    rng = np.random.default_rng(1)
    at = np.stack([rng.uniform(-1, 0, 3000), np.zeros(3000), rng.uniform(-0.1, 0.1, 3000)], axis=1)
    outline = at[:, 0] > -0.04
    assert 80 < outline.sum() < 160
    color = np.where(outline[:, None], 0.9, RED) / np.pi
    found = colored_by(splats_on(at, np.tile([0.0, 1, 0], (3000, 1)), color, 0.01), strip, lit((0, -1, 0), 1), SETTINGS)
    assert found.vertex_colors is not None
    unseen = found.vertex_colors[found.vertices[:, 0] > 0.1]
    assert np.all(unseen >= RED / 1.02)
    assert np.all(unseen < (RED + 0.9) / 2)  # the next splats alone would make it white
    seen = found.vertex_colors[found.vertices[:, 0] < -0.3]
    np.testing.assert_allclose(seen, np.tile(RED / 1.01, (len(seen), 1)), rtol=0.01)


def test_what_no_edge_joins_to_splats_looks_like_the_nearest_that_faces_the_same_way() -> None:
    """A red floor and a green one, and beside the green one an island that no splat lies on."""
    pieces = [quad((x, 0, 0.5), (1, 0, 0), (0, 0, -1), parts=4) for x in (-3, 1)]
    floors = joined(*pieces, quad((2.2, 0, 0.5), (0.2, 0, 0), (0, 0, -1)))
    at = np.random.default_rng(4).uniform(-0.5, 0.5, (6000, 3)) * [1, 0, 1] + np.repeat(
        [[-2.5, 0, 0], [1.5, 0, 0]], 3000, 0
    )
    color = np.repeat([RED, GREEN], 3000, axis=0) / np.pi
    found = colored_by(
        splats_on(at, np.tile([0.0, 1, 0], (6000, 1)), color, 0.01), floors, lit((0, -1, 0), 1), SETTINGS
    )
    assert found.vertex_colors is not None
    island = found.vertices[:, 0] > 2.1
    np.testing.assert_allclose(found.vertex_colors[island], np.tile(GREEN / 1.01, (island.sum(), 1)), rtol=0.01)


def test_what_no_edge_joins_to_splats_goes_on_as_its_plane_does() -> None:
    """A green kerb beside a red floor; where the floor goes on unseen, the kerb is nearer than what was seen of it."""
    pieces = (
        quad((-3, 0, 0.5), (1, 0, 0), (0, 0, -1), parts=4),
        quad((-0.9, 0.1, 0.5), (0.2, 0, 0), (0, 0, -1), parts=4),
    )
    ground = joined(*pieces, quad((-0.6, 0, 0.5), (0.4, 0, 0), (0, 0, -1)))
    rng = np.random.default_rng(4)
    floor, kerb = (
        rng.uniform(-0.5, 0.5, (3000, 3)) * [w, 0, 1] + [x, y, 0] for x, y, w in ((-2.5, 0, 1), (-0.8, 0.1, 0.2))
    )
    color = np.repeat([RED, GREEN], 3000, axis=0) / np.pi
    splats = splats_on(np.concatenate([floor, kerb]), np.tile([0.0, 1, 0], (6000, 1)), color, 0.01)
    found = colored_by(splats, ground, lit((0, -1, 0), 1), SETTINGS)
    assert found.vertex_colors is not None
    unseen = found.vertices[:, 0] > -0.65
    np.testing.assert_allclose(found.vertex_colors[unseen], np.tile(RED / 1.01, (unseen.sum(), 1)), rtol=0.02)


def test_dark_capture_tells_no_colour_but_stays_finite() -> None:
    gray = joined(quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)))
    at = np.zeros((10, 3))
    splats = splats_on(at, np.tile([0.0, 1, 0], (10, 1)), np.tile(RED, (10, 1)), 0.02)
    found = colored_by(splats, gray, Lighting(), SETTINGS)
    assert found.vertex_colors is not None
    np.testing.assert_allclose(found.vertex_colors, BRIGHTEST)


def test_splats_on_edges_count_for_no_less_than_nothing_at_the_corner_across() -> None:
    """Weights of corners that are rounded below nothing cancelled what others told, and left colours undefined."""
    along, across = np.array([2.3, 0.1, 0.7]), np.array([0.31, 0.2, -2])
    floor = joined(quad((1.7, 0.3, 9), along, across, parts=24))
    edge = np.repeat(floor.faces[:, [1, 2]], 16, axis=0)
    share = np.random.default_rng(2).dirichlet([1, 1], len(edge))
    at = np.einsum("nk,nki->ni", share, floor.vertices[edge].astype(np.float64))
    up = np.tile(np.cross(along, across) / np.linalg.norm(np.cross(along, across)), (len(at), 1))
    splats = splats_on(at, up, np.tile(RED / np.pi, (len(at), 1)), 0.02)
    tracer = Tracer(floor, SETTINGS, layers=False, aovs=False)
    face, corners, _ = tracer.nearest_along(at, up, 0.01)
    assert corners[face >= 0].min() < 0  # so the case is there
    assert observed(splats, (), floor, tracer).deposits(1 << 16).corners.min() >= 0


def test_what_the_colours_are_known_by() -> None:
    """Two of the twenty pieces of a strip, which share no corners, have splats on them."""
    strip = joined(*(quad((x, 0, 0.1), (0.1, 0, 0), (0, 0, -0.2)) for x in np.arange(-1, 1, 0.1)), weld=False)
    at = np.stack([np.tile([-0.95, -0.85], 50), np.zeros(100), np.zeros(100)], axis=1)
    splats = splats_on(at, np.tile([0.0, 1, 0], (100, 1)), np.tile(RED, (100, 1)), 0.01)
    found = vertex_colors(splats, strip, lit((0, -1, 0), 1), SETTINGS)
    assert found.lit
    np.testing.assert_allclose(found.met, 0.1, rtol=1e-5)
    dark = vertex_colors(splats, strip, Lighting(), SETTINGS)
    assert not dark.lit and dark.met == found.met


def test_splats_elsewhere_are_refused_in_one_line() -> None:
    gray = joined(quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)))
    far = splats_on(np.tile([0.0, 5.0, 0.0], (10, 1)), np.tile([0.0, 1, 0], (10, 1)), np.tile(RED, (10, 1)), 0.02)
    with pytest.raises(RenderError, match=r"no splat lies within 0\.0283 world units of the proxy") as error:
        colored_by(far, gray, lit((0, -1, 0), 1), SETTINGS)
    assert "\n" not in str(error.value)
