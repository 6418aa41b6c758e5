"""The path-traced truth that the scenes and the benchmark are measured against."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scenegen import training
from scenegen.geometry import Soup
from scenegen.textures import Surface
from scenegen.truth import Looks, Truth

from mirelight.model import Camera, Lighting, SunLight

AWAY = 2.0  # metres from the wall to what shades it


def _square(x: float, z: float, half: float) -> NDArray[np.float64]:
    """(2, 3, 3) a square that faces +Z."""
    a, b, c, d = ((x + half * i, half * j, z) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    return np.array([[a, b, c], [a, c, d]])


def _chalk(squares: NDArray[np.float64]) -> Looks:
    """Triangles (F, 3, 3) that face +Z, half as bright as the light on them."""
    soup = Soup(
        positions=squares,
        normals=np.broadcast_to([0.0, 0.0, 1.0], squares.shape).copy(),
        uvs=np.zeros((len(squares), 3, 2)),
        material="chalk",
        solid=True,
    )
    return Looks(soups=[soup], surfaces={"chalk": Surface(texture=np.full((2, 2, 3), 0.5, np.float32))})


@pytest.mark.parametrize("x", [-8.0, 0.0, 8.0])
def test_sun_of_the_truth_shines_from_one_direction_all_over_a_scene(x: float) -> None:
    squares = np.concatenate([_square(0, 0, 20), _square(x, AWAY, 0.5)])
    looks = _chalk(squares)
    sun = SunLight(
        name="sun", direction=np.array([-1.0, 0, -1]) / np.sqrt(2), color=np.ones(3), intensity=1, angular_diameter=0.5
    )
    expected = x - AWAY  # the sun stands 45 degrees to the side
    camera = Camera.look_at((expected, 0, 1.5), (expected, 0, 0), 128, 128, yfov=90)

    picture = Truth(looks, Lighting(name="sun", lights=(sun,))).picture(camera, 64)[..., 0]

    dark = 1 - picture / picture.max()
    across = (np.arange(128) + 0.5) / 128 * 3.0 - 1.5  # metres on the wall, from the middle of the picture
    shade = np.where(dark > 0.2, dark, 0)  # without the noise and the light that comes back
    assert np.sum(shade * across) / shade.sum() == pytest.approx(0, abs=0.01)


def _scene() -> tuple[Looks, Lighting]:
    """A square beside the middle, lit from the front."""
    looks = _chalk(_square(0.6, 0, 0.5))
    sun = SunLight(name="sun", direction=np.array([0.0, 0, -1]), color=np.ones(3), intensity=3, angular_diameter=0.5)
    return looks, Lighting(name="sun", lights=(sun,))


@pytest.mark.parametrize("size", [(96, 54), (54, 54)])
def test_pictures_show_things_where_their_cameras_have_them(size: tuple[int, int]) -> None:
    looks, lighting = _scene()
    wide = Camera.look_at((0, 0, 3), (0, 0, 0), 96, 54, yfov=50)
    how = training.Shooting(size=size)

    (shown,) = training.shots(Truth(looks, lighting), lighting, [wide], how)
    (camera,) = training.known([wide], how)

    assert shown.shape[:2] == (camera.height, camera.width)
    share = shown[..., 0] / shown.max()
    middle = [np.sum(share * x) / share.sum() + 0.5 for x in np.meshgrid(*map(np.arange, size))]
    across = np.sqrt(share.sum())  # px, of the square's sides
    assert middle == pytest.approx([camera.cx + camera.fx * 0.6 / 3, camera.cy], abs=0.1)
    assert across == pytest.approx(camera.fy / 3, rel=0.05)


def test_pixels_that_are_not_square_are_refused() -> None:
    with pytest.raises(ValueError, match="not square"):
        Truth(*_scene()).picture(Camera.look_at((0, 0, 3), (0, 0, 0), 96, 54, yfov=50).resized(54, 54), 1)
