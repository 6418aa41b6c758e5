"""Model types keep their arrays read-only on every way that makes a new object of them."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from mirelight.model import (
    AreaLight,
    Camera,
    DirectionalLight,
    Environment,
    Lighting,
    LightingBuffer,
    LightLayer,
    Material,
    PointLight,
    ProxyMesh,
    SkyModel,
    SplatCloud,
    SplatLayer,
    SpotLight,
    SunLight,
)

UP = np.array([0.0, 1, 0])
VIEW = Camera.look_at([0, 0, 3], [0, 0, 0], 4, 2)
PLANE = np.arange(8, dtype=np.float32).reshape(2, 4)
COLOR = np.repeat(PLANE[..., None], 3, axis=-1)
OBJECTS: tuple[Any, ...] = (
    VIEW,
    DirectionalLight(name="a", direction=UP),
    PointLight(name="a", position=UP),
    SpotLight(name="a", position=UP, direction=UP),
    SunLight(name="a", direction=UP),
    AreaLight(name="a", world_from_light=np.eye(4), shape="rectangle", size=(1.0, 1.0)),
    Environment(radiance=COLOR),
    SkyModel(to_sun=UP),
    Lighting(lights=(PointLight(name="a", position=UP),), environment=Environment(radiance=COLOR)),
    SplatCloud(
        means=COLOR[0],
        quats=np.ones((4, 4), np.float32),
        scales=COLOR[0],
        opacities=PLANE[0],
        sh=np.ones((4, 1, 3), np.float32),
    ),
    Material(base_color_texture=COLOR),
    ProxyMesh(vertices=COLOR[0], faces=np.array([[0, 1, 2]], np.int32)),
    SplatLayer(camera=VIEW, color=COLOR, transmittance=PLANE, depth=PLANE, median_depth=PLANE),
    LightingBuffer(
        camera=VIEW,
        coverage=PLANE,
        layers=(LightLayer(name="a", direct=COLOR, indirect=COLOR),),
        depth=PLANE,
        position=COLOR,
        normal=COLOR,
        geometric_normal=COLOR,
        albedo=COLOR,
    ),
)


def arrays(value: Any) -> list[np.ndarray[Any, Any]]:
    """Every array in an object of the model, depth first."""
    if isinstance(value, np.ndarray):
        return [value]
    if isinstance(value, tuple):
        return [x for item in value for x in arrays(item)]
    if hasattr(value, "__dataclass_fields__"):
        return [x for field in fields(value) for x in arrays(getattr(value, field.name))]
    return []


@pytest.mark.parametrize("again", [lambda x: pickle.loads(pickle.dumps(x)), copy.copy, copy.deepcopy])
def test_arrays_stay_read_only_and_equal(again: Callable[[Any], Any]) -> None:
    for before in OBJECTS:
        after = again(before)
        assert type(after) is type(before)
        old, new = arrays(before), arrays(after)
        assert len(old) == len(new) > 0
        for a, b in zip(old, new, strict=True):
            assert np.array_equal(a, b) and a.dtype == b.dtype
            assert not b.flags.writeable, type(before).__name__
            with pytest.raises(ValueError, match="read-only"):
                b[...] = 0
