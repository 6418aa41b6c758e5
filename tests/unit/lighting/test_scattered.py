"""Objects at random places: where they fit, the same for the same seed, and a line where they fit nowhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from mirelight.base.errors import InputError
from mirelight.lighting.objects import inserted
from mirelight.lighting.scattered import _touches
from mirelight.model import Deferred, Inserted, ProxyMesh, Scatter

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (0, 2) for z in (-1, 1)], np.float32)
FACES = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ],
    np.int32,
)
HOUSE = CORNERS * np.float32(1.5) + np.array([3, 0, 0], np.float32)  # x 1.5 to 4.5, z -1.5 to 1.5, 3 high
GROUND = np.array([[-6, 0, -6], [-6, 0, 6], [6, 0, 6], [6, 0, -6]], np.float32)
YARD = ProxyMesh(
    vertices=np.concatenate([HOUSE, GROUND]),
    faces=np.concatenate([FACES, np.array([[8, 9, 10], [8, 10, 11]], np.int32)]),
)


def box(seed: int, radius: float = 5.0, size: float = 0.5, **more: object) -> Inserted:
    mesh = ProxyMesh(vertices=CORNERS * np.float32(size), faces=FACES)
    where = Scatter(center=np.zeros(3), radius=radius, seed=seed)
    return Inserted(name="box", mesh=Deferred("box", lambda: mesh), scatter=where, source="box.glb", **more)  # type: ignore[arg-type]


def places(*objects: Inserted) -> np.ndarray:
    """(n, 8, 3) corners of the objects in the yard."""
    placed = inserted(objects, YARD)
    return np.asarray(placed.mesh.vertices[len(YARD.vertices) :].reshape(len(objects), 8, 3))


def test_objects_stand_on_the_ground_beside_the_house_and_in_sight_of_the_middle() -> None:
    feet = []
    for seed in range(25):
        (corners,) = places(box(seed))
        np.testing.assert_allclose(corners[:, 1].min(), 0, atol=1e-6)
        inside = (corners[:, 0] > 1.5) & (corners[:, 0] < 4.5) & (np.abs(corners[:, 2]) < 1.5)
        middle = corners[:, [0, 2]].mean(axis=0)
        assert not inside.any() and np.linalg.norm(middle) <= 5
        assert np.abs(corners[:, [0, 2]]).max() <= 6  # the whole foot is carried
        behind = middle[0] > 1.5 and abs(middle[1]) < middle[0]  # the house hides a quarter of what is beyond its face
        assert not behind
        feet.append(corners)
    np.testing.assert_array_equal(places(box(7))[0], feet[7])
    assert len({x.tobytes() for x in feet}) == 25
    turns = [np.arctan2(*(x[4] - x[0])[[2, 0]]) for x in feet]
    assert np.ptp(turns) > 3
    beyond = [x for x in feet if x[:, 0].min() > 0]
    assert beyond and len(beyond) < 12  # some stand beside the house, most before it


def test_objects_keep_clear_of_each_other() -> None:
    many = places(*(box(3, radius=1.2, size=0.25) for _ in range(6)))
    fixed = Inserted(name="fixed", mesh=box(0, size=0.5).mesh)
    beside = places(box(3, radius=1.2, size=0.25), fixed)
    for group in (many, beside):
        for i, one in enumerate(group):
            for other in group[:i]:
                apart = [
                    max((a @ axis).min() - (b @ axis).max() for a, b in ((one, other), (other, one)))
                    for edge in (one[4] - one[0], one[1] - one[0], other[4] - other[0], other[1] - other[0])
                    for axis in (edge / np.linalg.norm(edge),)
                ]
                assert max(apart) > -1e-6


def test_what_fits_nowhere_is_a_line() -> None:
    with pytest.raises(InputError, match=r"'box' fits nowhere within 0.5 of .* \(200 places tried\)") as refused:
        inserted([box(0, radius=0.5, size=7.0)], YARD)
    assert "\n" not in str(refused.value)


def test_where_no_place_is_level_the_ground_may_rise_and_fall() -> None:
    """A blanket: its folds are a sixth of the object high, and everywhere. What stands there does not reach into it."""
    x, z = (v.ravel() for v in np.meshgrid(np.linspace(-6, 6, 121), np.linspace(-6, 6, 121), indexing="ij"))
    height = 0.15 * (np.sin(2 * np.pi * x) * np.sin(2 * np.pi * z))
    i = np.arange(120)[:, None] * 121 + np.arange(120)
    quads = np.stack([i, i + 1, i + 122, i + 121], axis=-1).reshape(-1, 4)
    blanket = ProxyMesh(
        vertices=np.stack([x, height, z], axis=1).astype(np.float32),
        faces=np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32),
    )
    corners = inserted([box(2)], blanket).mesh.vertices[len(x) :]
    assert 0 <= corners[:, 1].min() <= 0.15
    bumpy = replace(blanket, vertices=blanket.vertices * np.array([1, 4, 1], np.float32))
    with pytest.raises(InputError, match="fits nowhere"):
        inserted([box(2)], bumpy)


def test_a_slope_carries_what_lies_along_it() -> None:
    steep = ProxyMesh(vertices=GROUND + GROUND[:, :1] * np.array([0, 0.5, 0], np.float32), faces=YARD.faces[-2:] - 8)
    with pytest.raises(InputError, match="fits nowhere"):
        inserted([box(1, radius=2.0)], steep)
    placed = inserted([box(1, radius=2.0, drop="tilt")], steep)
    corners = placed.mesh.vertices[4:]
    np.testing.assert_allclose(np.sort(corners[:, 1] - 0.5 * corners[:, 0])[:4], 0, atol=1e-5)


def test_triangles_touch_a_box_where_some_point_is_in_both() -> None:
    rng = np.random.default_rng(4)
    found = []
    for _ in range(80):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.2, 1.5, 3)
        here = np.eye(4)
        here[:3, :3], here[:3, 3] = axes, rng.normal(size=3) * 0.3
        corners = rng.normal(size=(3, 3))
        own = (corners - here[:3, 3]) @ np.linalg.inv(axes).T  # a mix of the corners that lies in the cube?
        limits = np.concatenate([own.T, -own.T])
        truth = linprog(np.zeros(3), limits, np.full(6, 0.5), np.ones((1, 3)), [1.0]).status == 0
        assert _touches(here, corners[None]) == truth
        found.append(truth)
    assert 15 < sum(found) < 65
