"""The picture of far light that the studio's ball shows: what is bright is where it comes from, in the world."""

from __future__ import annotations

import io
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mirelight.apps.studio.around import Around
from mirelight.base import conventions
from mirelight.model import Environment, Lighting, SunLight
from mirelight.pipeline.scene import Scene


class Resolved:
    """A scene in which all light is given."""

    def resolved(self, lighting: Lighting) -> Lighting:
        return lighting


def picture(lighting: Lighting) -> bytes:
    around = Around()
    around.look(cast(Scene, Resolved()), lighting, 1)
    return around.png


def brightest(lighting: Lighting) -> NDArray[np.float64]:
    """Unit direction of the mean of the brightest pixels."""
    pixels = np.asarray(Image.open(io.BytesIO(picture(lighting))).convert("L"), dtype=np.float64)
    ways = conventions.map_pixels(len(pixels))[pixels == pixels.max()]
    return conventions.unit(ways.mean(axis=0))


@pytest.mark.parametrize(("rotation", "way"), [(0, (0, 0, 1)), (90, (1, 0, 0)), (180, (0, 0, -1))])
def test_a_panorama_is_shown_as_it_is_turned(rotation: float, way: tuple[float, ...]) -> None:
    """Its column u = 0.75 looks along +Z, which a quarter turn brings to +X."""
    radiance = np.full((16, 32, 3), 0.1, np.float32)
    radiance[7:9, 23:25] = 5
    lighting = Lighting(environment=Environment(radiance=radiance, rotation=rotation))
    np.testing.assert_allclose(brightest(lighting), way, atol=0.05)


def test_a_sun_is_shown_where_it_stands() -> None:
    sun = SunLight(name="sun", direction=np.array([0.6, -0.8, 0]), angular_diameter=20.0)
    np.testing.assert_allclose(brightest(Lighting(lights=(sun,))), (-0.6, 0.8, 0), atol=0.1)


def test_no_far_light_is_no_picture() -> None:
    assert picture(Lighting()) == b""
