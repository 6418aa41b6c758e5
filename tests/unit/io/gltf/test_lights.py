"""KHR_lights_punctual: poses, defaults, names, and values outside the specification."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io.gltf.scene import read_lights, read_scene
from mirelight.model import DirectionalLight, PointLight, SpotLight


def test_defaults_of_the_specification(glb: Any) -> None:
    for kind in ("directional", "point", "spot"):
        glb.light(type=kind, **({"spot": {}} if kind == "spot" else {}))
    sun, lamp, spot = read_lights(glb.save())
    assert isinstance(sun, DirectionalLight) and isinstance(lamp, PointLight) and isinstance(spot, SpotLight)
    for light in (sun, lamp, spot):
        assert light.color.tolist() == [1, 1, 1] and light.intensity == 1
    assert sun.direction.tolist() == [0, 0, -1]
    assert lamp.range == spot.range == math.inf
    assert (spot.inner_cone_angle, spot.outer_cone_angle) == (0, math.pi / 4)


def test_a_light_follows_its_node_and_keeps_its_strength(glb: Any) -> None:
    node = {"rotation": [-math.sqrt(0.5), 0, 0, math.sqrt(0.5)], "translation": [1, 0, 0], "scale": [3, 5, 7]}
    index = glb.light(node, type="spot", intensity=25, range=4.5, color=[1, 0.5, 0], spot={"innerConeAngle": 0.2})
    glb.top["scenes"][0]["nodes"] = []
    glb.node(children=[index], scale=[2, 2, 2], translation=[0, 10, 0])
    (light,) = read_lights(glb.save())
    assert isinstance(light, SpotLight)
    assert np.allclose(light.position, (2, 10, 0))
    assert np.allclose(light.direction, (0, -1, 0))  # -90 degrees about X turns -Z to -Y
    assert (light.intensity, light.range, light.inner_cone_angle) == (25, 4.5, 0.2)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    turns=st.lists(st.lists(st.floats(-180, 180), min_size=3, max_size=3), min_size=1, max_size=4),
    scales=st.lists(st.floats(0.2, 5), min_size=4, max_size=4),
)
def test_direction_is_the_world_matrix_minus_z(new_glb: Any, turns: list[list[float]], scales: list[float]) -> None:
    glb = new_glb()
    world = np.eye(4)
    poses = [
        conventions.compose((1, 2, 3), conventions.rotation_from_euler(t), s)
        for t, s in zip(turns, scales, strict=False)
    ]
    for pose in poses:
        world = world @ pose
    index = glb.light({"matrix": poses[-1].T.reshape(-1).tolist()}, type="directional")
    for pose in reversed(poses[:-1]):
        index = glb.node(children=[index], matrix=pose.T.reshape(-1).tolist())
    glb.top["scenes"][0]["nodes"] = [index]
    (light,) = read_lights(glb.save())
    assert isinstance(light, DirectionalLight)
    assert np.allclose(light.direction, conventions.unit(world[:3, :3] @ (0, 0, -1)), atol=1e-9)


def test_names_are_unique_and_come_from_light_node_or_kind(glb: Any) -> None:
    glb.light({"name": "left"}, type="point", name="lamp")
    glb.light({"name": "right"}, type="point", name="lamp")
    glb.light({"name": "post"}, type="point")
    glb.light(type="spot", spot={})
    glb.light(type="spot", spot={})
    glb.light(type="point", name="key")
    assert [x.name for x in read_lights(glb.save())] == ["left", "right", "post", "spot", "spot 2", "key"]


def test_one_light_on_several_nodes(glb: Any) -> None:
    first = glb.light({"translation": [1, 0, 0]}, type="point", name="bulb")
    glb.node(translation=[2, 0, 0], extensions=glb.top["nodes"][first]["extensions"])
    lights = read_scene(glb.save()).lights
    assert [x.name for x in lights] == ["bulb", "bulb 2"]
    assert [x.position[0] for x in lights if isinstance(x, PointLight)] == [1, 2]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"type": "point", "range": 0}, r"lights\[0\]\.range: 0; it must be positive"),
        ({"type": "point", "range": -1}, r"lights\[0\]\.range: -1"),
        ({"type": "point", "range": math.inf}, "finite"),
        ({"type": "point", "intensity": -2}, r"lights\[0\]\.intensity: -2"),
        (
            {"type": "point", "color": [2, 0, 0]},
            r"lights\[0\]\.color: \[2.0, 0.0, 0.0\]; every component must lie in 0..1",
        ),
        ({"type": "point", "color": [1, 1]}, r"lights\[0\]\.color: 2 numbers, expected 3"),
        ({"type": "area"}, r"lights\[0\]\.type: 'area'; expected directional, point or spot"),
        ({}, r"lights\[0\]\.type: missing"),
        (
            {"type": "spot", "spot": {"innerConeAngle": 0.5, "outerConeAngle": 0.5}},
            r"spot\.innerConeAngle: 0.5, with outer",
        ),
        ({"type": "spot", "spot": {"innerConeAngle": 0.9}}, r"spot\.innerConeAngle: 0.9, with outerConeAngle 0.785"),
        ({"type": "spot", "spot": {"innerConeAngle": -0.1}}, r"spot\.innerConeAngle: -0.1"),
        ({"type": "spot", "spot": {"outerConeAngle": 1.6}}, r"spot\.outerConeAngle: 1.6; it must lie above 0"),
        ({"type": "spot", "spot": {"outerConeAngle": 0}}, r"spot\.outerConeAngle: 0;"),
        ({"type": "spot", "spot": 3}, r"lights\[0\]\.spot: 3, expected an object"),
    ],
)
def test_values_outside_the_specification_are_refused_by_name(glb: Any, fields: dict[str, Any], message: str) -> None:
    glb.light(**fields)
    with pytest.raises(InputError, match=message):
        read_lights(glb.save())


def test_a_light_that_is_not_there_or_has_no_direction(glb: Any, new_glb: Any) -> None:
    glb.light(type="point")
    glb.top["nodes"][0]["extensions"]["KHR_lights_punctual"]["light"] = 4
    with pytest.raises(InputError, match=r"nodes\[0\]\.extensions\.KHR_lights_punctual\.light: there is no light 4"):
        read_lights(glb.save())
    flat = new_glb()
    flat.light({"scale": [1, 1, 0]}, type="directional")
    with pytest.raises(InputError, match=r"nodes\[0\]: its Z axis has length zero"):
        read_lights(flat.save())


def test_single_precision_pi_half_is_accepted(glb: Any) -> None:
    glb.light(type="spot", spot={"outerConeAngle": 1.5707964})
    (light,) = read_lights(glb.save())
    assert isinstance(light, SpotLight) and light.outer_cone_angle == math.pi / 2
