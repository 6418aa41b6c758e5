"""Cameras and their animation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io.gltf.animation import sample_cameras
from mirelight.io.gltf.scene import read_cameras, read_scene

PERSPECTIVE = {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1, "zfar": 50, "aspectRatio": 1.5}}


def test_perspective(glb: Any) -> None:
    glb.camera({"translation": [1, 2, 3], "name": "eye"}, **PERSPECTIVE)
    (camera,) = read_cameras(glb.save())
    assert (camera.name, camera.aspect, camera.projection) == ("eye", 1.5, "perspective")
    view = camera.to_camera(300, 200)
    assert view.fx == view.fy == pytest.approx(100 / math.tan(0.4))
    assert (view.cx, view.cy, view.near, view.far) == (150, 100, 0.1, 50)
    assert np.allclose(view.position, (1, 2, 3))


def test_orthographic(glb: Any) -> None:
    glb.camera(type="orthographic", orthographic={"xmag": 4, "ymag": 2, "znear": 0, "zfar": 10})
    (camera,) = read_cameras(glb.save())
    assert camera.aspect == 2
    view = camera.to_camera(400, 200)
    assert (view.projection, view.fx, view.fy, view.far) == ("orthographic", 50, 50, 10)
    # xmag 4: the image's right edge is 4 units to the right of its centre.
    assert view.cx + view.fx * 4 == 400


def test_every_camera_is_found_with_its_own_name(glb: Any) -> None:
    for x in range(3):
        glb.camera({"translation": [x, 0, 0]}, **PERSPECTIVE)
    glb.put("cameras", PERSPECTIVE)  # on no node: not in the scene
    cameras = read_scene(glb.save()).cameras
    assert [c.name for c in cameras] == ["camera", "camera 2", "camera 3"]
    assert [c.world[0, 3] for c in cameras] == [0, 1, 2]


def test_scale_in_the_hierarchy_does_not_reach_the_camera(glb: Any) -> None:
    turn = conventions.rotation_from_euler((10, 20, 30))
    w, x, y, z = conventions.quaternion_from_rotation(turn)
    child = glb.camera({"rotation": [x, y, z, w]}, **PERSPECTIVE)
    glb.top["scenes"][0]["nodes"] = []
    glb.node(children=[child], scale=[3, 3, 3], translation=[0, 5, 0])
    view = read_cameras(glb.save())[0].to_camera(10, 10)
    assert np.allclose(view.world_from_camera[:3, :3], turn, atol=1e-12)
    assert np.allclose(view.position, (0, 5, 0))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"type": "fisheye"}, r"cameras\[0\]\.type: 'fisheye'"),
        ({"type": "perspective"}, r"cameras\[0\]\.perspective\.yfov: missing"),
        ({"type": "perspective", "perspective": {"yfov": 0, "znear": 1}}, r"yfov: 0; it must be positive"),
        ({"type": "perspective", "perspective": {"yfov": 3.2, "znear": 1}}, r"yfov: 3.2; it must be below pi"),
        ({"type": "perspective", "perspective": {"yfov": 1, "znear": 0}}, r"znear: 0; it must be positive"),
        ({"type": "perspective", "perspective": {"yfov": 1, "znear": 1, "zfar": 0.5}}, r"zfar: 0.5; it must be above"),
        ({"type": "perspective", "perspective": {"yfov": 1, "znear": 1, "aspectRatio": -1}}, r"aspectRatio: -1"),
        ({"type": "orthographic", "orthographic": {"xmag": 0, "ymag": 1, "znear": 0, "zfar": 1}}, r"xmag: 0"),
        ({"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0}}, r"orthographic\.zfar: missing"),
        ({"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": -1, "zfar": 1}}, r"znear: -1"),
    ],
)
def test_cameras_outside_the_specification(glb: Any, fields: dict[str, Any], message: str) -> None:
    glb.camera(**fields)
    with pytest.raises(InputError, match=message):
        read_cameras(glb.save())


# --- animation -------------------------------------------------------------------------------------------------------

TIMES = np.array([1.0, 2.0, 4.0], dtype=np.float32)


def animate(glb: Any, node: int, path: str, values: np.ndarray[Any, Any], kind: str = "LINEAR") -> None:
    sampler = {"input": glb.accessor(TIMES), "output": glb.accessor(values.astype(np.float32)), "interpolation": kind}
    channel = {"sampler": 0, "target": {"node": node, "path": path}}
    glb.put("animations", {"samplers": [sampler], "channels": [channel]})


def test_linear_translation_and_its_ends(glb: Any) -> None:
    node = glb.camera(**PERSPECTIVE)
    animate(glb, node, "translation", np.array([[0, 0, 0], [1, 0, 0], [1, 4, 0]]))
    path = glb.save()
    assert read_scene(path).animated_cameras == ("camera",)
    samples = sample_cameras(path, "camera", count=7)
    assert [t for t, _ in samples] == pytest.approx(np.linspace(1, 4, 7))
    expected = np.array([[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 1, 0], [1, 2, 0], [1, 3, 0], [1, 4, 0]])
    assert np.allclose([m[:3, 3] for _, m in samples], expected)
    assert [t for t, _ in sample_cameras(path, fps=2)] == pytest.approx([1, 1.5, 2, 2.5, 3, 3.5, 4])


def test_steps_hold(glb: Any) -> None:
    animate(glb, glb.camera(**PERSPECTIVE), "translation", np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]]), "STEP")
    assert [m[0, 3] for _, m in sample_cameras(glb.save(), fps=2)] == [0, 0, 1, 1, 1, 1, 2]


def test_rotation_against_scipy_slerp(glb: Any) -> None:
    turns = Rotation.from_euler("xyz", [[0, 0, 0], [100, 20, 0], [-60, 50, 170]], degrees=True)
    keys = turns.as_quat() * [[1], [-1], [1]]  # a sign flip asks for the shorter arc
    animate(glb, glb.camera(**PERSPECTIVE), "rotation", keys)
    samples = sample_cameras(glb.save(), count=13)
    expected = Slerp(TIMES, turns)([t for t, _ in samples]).as_matrix()
    assert np.allclose([m[:3, :3] for _, m in samples], expected, atol=1e-6)


def test_cubic_spline_against_scipy(glb: Any) -> None:
    rng = np.random.default_rng(4)
    keys, into, out = (rng.normal(size=(3, 3)).astype(np.float32) for _ in range(3))
    values = np.stack([into, keys, out], axis=1).reshape(9, 3)
    animate(glb, glb.camera(**PERSPECTIVE), "translation", values, "CUBICSPLINE")
    for time, matrix in sample_cameras(glb.save(), count=11):
        k = min(int(np.searchsorted(TIMES, time, side="right")) - 1, 1)
        spline = CubicHermiteSpline(TIMES[k : k + 2], keys[k : k + 2], np.stack([out[k], into[k + 1]]))
        assert np.allclose(matrix[:3, 3], spline(time), atol=1e-5)


def test_ancestors_carry_the_camera(glb: Any) -> None:
    camera = glb.camera({"translation": [0, 0, 5]}, **PERSPECTIVE)
    glb.top["scenes"][0]["nodes"] = []
    table = glb.node(children=[camera], translation=[1, 0, 0])
    quarter = Rotation.from_euler("y", [[0], [90], [180]], degrees=True).as_quat()
    animate(glb, table, "rotation", quarter)
    positions = [m[:3, 3] for _, m in sample_cameras(glb.save(), count=3)]
    turn = math.radians(112.5)  # at 2.5 s, a quarter of the way from the second key to the third
    expected = np.array([[1, 0, 5], [1 + 5 * math.sin(turn), 0, 5 * math.cos(turn)], [1, 0, -5]])
    assert np.allclose(positions, expected, atol=1e-6)


def test_animation_errors_are_named(glb: Any) -> None:
    node = glb.camera({"name": "still"}, **PERSPECTIVE)
    with pytest.raises(InputError, match="no animated camera; its cameras: still"):
        sample_cameras(glb.save(), count=2)
    with pytest.raises(InputError, match="nothing moves the camera 'still'"):
        sample_cameras(glb.save(), "still", count=2)
    animate(glb, node, "translation", np.zeros((3, 3)))
    with pytest.raises(InputError, match="no camera 'other'; its cameras: still"):
        sample_cameras(glb.save(), "other", count=2)
    with pytest.raises(InputError, match="at most 1000000"):
        sample_cameras(glb.save(), fps=1e9)
    with pytest.raises(ValueError, match="either fps"):
        sample_cameras(glb.save(), fps=1, count=2)
    animate(glb, node, "translation", np.ones((3, 3)))
    with pytest.raises(
        InputError, match=r"animations\[1\]\.channels\[0\]\.target: nodes\[0\]\.translation is animated twice"
    ):
        sample_cameras(glb.save(), count=2)
    del glb.top["animations"][1]
    sampler = glb.top["animations"][0]["samplers"][0]
    sampler["interpolation"] = "CUBICSPLINE"
    with pytest.raises(InputError, match=r"animations\[0\]\.samplers\[0\]\.output"):
        sample_cameras(glb.save(), count=2)
    sampler["interpolation"] = "BEZIER"
    with pytest.raises(InputError, match="interpolation: 'BEZIER'"):
        sample_cameras(glb.save(), count=2)
    sampler |= {"interpolation": "LINEAR", "input": glb.accessor(TIMES[::-1].copy())}
    with pytest.raises(InputError, match="times that do not increase"):
        sample_cameras(glb.save(), count=2)
