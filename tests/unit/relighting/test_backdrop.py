"""What stands behind splats, against closed forms: known alpha over known light, one bright pixel, suns, a floor."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirelight.base import colour, conventions
from mirelight.base.errors import InputError
from mirelight.io import image, job, records
from mirelight.io.display import read_display
from mirelight.model import (
    Backdrop,
    Camera,
    DisplaySettings,
    Environment,
    Frame,
    Ground,
    Job,
    Lighting,
    Provenance,
    SunLight,
)
from mirelight.pipeline.backdrops import Backdrops
from mirelight.relighting import backdrop
from mirelight.relighting.surroundings import Map, Surroundings, solid_angles, surroundings_of

ALONG_X = Camera.look_at((0, 0, 0), (1, 0, 0), 64, 48, yfov=60)
SHARP = Backdrop()
JOB = """
splats = "splats.ply"
[[cameras]]
position = [0, 0, 3]
target = [0, 0, 0]
[display]
"""


def around(radiance: np.ndarray, rotation: float = 0.0) -> Surroundings:
    return Surroundings((Map(radiance.astype(np.float32), rotation, np.ones(3)),))


def spot(u: float, v: float, rows: int = 180) -> np.ndarray:
    """A black map with one bright pixel there."""
    out = np.zeros((rows, 2 * rows, 3))
    out[int(v * rows), int(u * 2 * rows)] = 1
    return out


@pytest.mark.parametrize("rotation", [0.0, 25.0])
def test_a_bright_pixel_is_seen_in_its_direction(rotation: float) -> None:
    u, v = 0.54, 0.46
    seen = backdrop.seen(ALONG_X, around(spot(u, v), rotation), SHARP)[..., 0]
    pixel = (int(u * 360) + 0.5) / 360, (int(v * 180) + 0.5) / 180
    way = conventions.rotation_from_euler((0, rotation, 0)) @ conventions.map_direction(*pixel)
    x, y, z = ALONG_X.camera_from_world[:3, :3] @ way
    place = ALONG_X.cy - ALONG_X.fy * y / -z, ALONG_X.cx + ALONG_X.fx * x / -z
    rows, columns = np.indices(seen.shape) + 0.5
    middle = [float((part * seen).sum() / seen.sum()) for part in (rows, columns)]
    np.testing.assert_allclose(middle, place, atol=0.25)


def test_a_blur_is_the_lobe_that_it_is_said_to_be() -> None:
    """A point spreads to exp((cos - 1) / sigma²) / (2 pi sigma² (1 - exp(-2 / sigma²))); nothing is lost, anywhere."""
    sigma, rows = np.radians(8), 90
    for v in (0.5, 0.1):
        point = backdrop.blurred(spot(0.5, v, rows), sigma)[..., 0].astype(np.float64)
        solid = solid_angles(rows)
        assert (point * solid).sum() == pytest.approx(solid[int(v * rows), 0], rel=0.02)
        row = int(v * rows)
        cosine = np.cos(np.pi * (np.arange(rows) - row) / rows)
        lobe = np.exp((cosine - 1) / sigma**2) / (2 * np.pi * sigma**2) * solid[row, 0]
        near = np.abs(np.arange(rows) - row) < 8
        np.testing.assert_allclose(point[near, rows], lobe[near], rtol=0.03)
    np.testing.assert_allclose(backdrop.blurred(np.full((32, 64, 3), 0.7, np.float32), 0.3), 0.7, rtol=1e-6)


@pytest.mark.parametrize("diameter", [0.2, 4.0])
def test_a_sun_brings_its_illuminance(diameter: float) -> None:
    to_sun = conventions.unit((1, 0.1, -0.05))
    lighting = Lighting(lights=(SunLight(name="sun", direction=-to_sun, intensity=5.0, angular_diameter=diameter),))
    found = surroundings_of(lighting)
    assert found is not None
    seen = backdrop.seen(ALONG_X, found, SHARP)[..., 0].astype(np.float64)
    _, way = ALONG_X.rays()
    solid = 1 / (ALONG_X.fx * ALONG_X.fy * np.linalg.norm(way, axis=-1) ** 3)
    assert (seen * solid).sum() == pytest.approx(5.0, rel=0.15)
    assert surroundings_of(Lighting()) is None


def test_a_floor_stays_where_it_is_when_the_camera_moves() -> None:
    """A point of the floor has the colour of its direction from where the panorama was taken, from anywhere."""
    ground = Ground(center=(1.0, 0.5, 0.0), height=2.0, radius=20.0)
    point, middle = np.array([4.0, 0.5, 1.0]), np.array([1.0, 2.5, 0.0])
    rng = np.random.default_rng(0)
    light = around(np.kron(rng.uniform(0, 1, (16, 32, 3)), np.ones((8, 8, 1))))
    expected = light.maps[0].seen(conventions.unit(point - middle))
    for eye in ((1.0, 2.5, 0.0), (0.0, 4.0, 3.0), (6.0, 1.0, -2.0)):
        camera = Camera.look_at(eye, point, 3, 3, yfov=0.1)
        seen = backdrop.seen(camera, light, Backdrop(ground=ground, exposure=1.0))[1, 1]
        np.testing.assert_allclose(seen, 2 * expected, rtol=1e-3)
    outside = Camera.look_at((100, 50, 0), (200, 90, 0), 3, 3, yfov=0.1)  # looks past floor and dome
    plain, laid = (backdrop.seen(outside, light, x) for x in (SHARP, Backdrop(ground=ground)))
    np.testing.assert_array_equal(plain, laid)


def test_the_ground_below_a_sky_is_lit_by_it() -> None:
    """Under a sky of radiance 1 the level ground receives pi."""
    sky = np.ones((64, 128, 3), np.float32)
    sky[32:] = 0
    lit = backdrop.with_lit_ground(sky, np.array([np.pi, 0, 0]), np.array([0.5, 0.5, 0.2]))
    np.testing.assert_allclose(lit[40, 3], [1.0, 0.5, 0.2], rtol=1e-3)
    assert (lit[:32] == 1).all()


def test_a_picture_fills_the_frame_by_its_middle() -> None:
    picture = np.zeros((10, 40, 3), np.float32)
    picture[:, 14:26] = 1
    np.testing.assert_allclose(backdrop.fitted(picture, ALONG_X.resized(5, 5), 0.0), 1, atol=1e-6)
    wide = backdrop.fitted(picture, ALONG_X.resized(8, 2), -1.0)[0, :, 0]
    np.testing.assert_allclose(wide, [0, 0, 0, 0.5, 0.5, 0, 0, 0], atol=0.16)


def test_leaks_of_walls_are_no_windows() -> None:
    alpha = np.array([[1.0, 0.99, 0.9, 0.5, 0.0]], np.float32)
    kept = backdrop.without_leaks(np.ones((1, 5, 3), np.float32), alpha)[0, :, 0]
    assert kept[0] == 0 and kept[1] < 0.03
    np.testing.assert_allclose(kept[2:], 1, atol=1e-6)


@pytest.fixture
def frame() -> Frame:
    """Half covered by red light; alpha falls from left to right."""
    alpha = np.linspace(1, 0, 64, dtype=np.float32) * np.ones((48, 1), np.float32)
    rgba = np.stack([0.5 * alpha, 0 * alpha, 0 * alpha, alpha], axis=-1)
    behind = np.full((48, 64, 3), (0.1, 0.2, 3.0), np.float32)
    made_by = Provenance(mirelight="0")
    return Frame(
        camera=ALONG_X,
        rgba=rgba,
        unlit=None,
        factor=None,
        lighting=None,
        splats=None,
        background=behind,
        made_by=made_by,
    )


def test_light_lies_behind_by_what_splats_let_through(frame: Frame, tmp_path: Path) -> None:
    """encode((a c + (1 - a) b) 2^exposure), in the PNG and in what shows the EXR."""
    display = DisplaySettings(exposure=-1.0, background=(1.0, 1.0, 1.0), backdrop=Backdrop())
    image.write(frame, tmp_path / "a.png", display)
    a = np.linspace(1, 0, 64)[:, None]
    light = a * [0.5, 0, 0] + (1 - a) * [0.1, 0.2, 3.0]
    expected = np.clip(colour.srgb_encode(light / 2), 0, 1) * 255
    shown = np.asarray(Image.open(tmp_path / "a.png"))
    np.testing.assert_allclose(shown[7], expected, atol=0.51)


def test_the_exr_keeps_alpha_and_what_is_behind(frame: Frame, tmp_path: Path) -> None:
    image.write(frame, tmp_path / "a.exr")
    back = image.read(tmp_path / "a.exr")
    assert back.background is not None and frame.background is not None
    np.testing.assert_array_equal(back.background, frame.background)
    np.testing.assert_array_equal(back.rgba, frame.rgba)
    image.write(replace(frame, background=None), tmp_path / "b.exr")
    assert image.read(tmp_path / "b.exr").background is None
    image.write(back, tmp_path / "a.png")
    np.testing.assert_array_equal(read_display(tmp_path / "a.exr"), np.asarray(Image.open(tmp_path / "a.png")))


def test_nothing_behind_is_an_alpha_channel(frame: Frame, tmp_path: Path) -> None:
    image.write(frame, tmp_path / "a.png", DisplaySettings(transparent=True))
    pixels = np.asarray(Image.open(tmp_path / "a.png"))
    np.testing.assert_allclose(pixels[3, :, 3], np.linspace(255, 0, 64), atol=0.51)
    assert (pixels[3, :-1, 0] == np.rint(255 * colour.srgb_encode(0.5))).all()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("background = [0.2, 0.4, 1]", DisplaySettings(background=(0.2, 0.4, 1.0))),
        ('background = "transparent"', DisplaySettings(transparent=True)),
        ('background = "environment"', DisplaySettings(backdrop=Backdrop())),
        (
            'background = { path = "environment", exposure = -1, blur = 4, ground = { height = 2 } }',
            DisplaySettings(backdrop=Backdrop(exposure=-1.0, blur=4.0, ground=Ground(height=2.0))),
        ),
    ],
)
def test_a_job_says_what_is_behind(tmp_path: Path, line: str, expected: DisplaySettings) -> None:
    found = loaded(tmp_path, line)
    assert found == expected
    assert records.made(DisplaySettings, asdict(found)) == found


def loaded(folder: Path, line: str) -> DisplaySettings:
    splats = Path(__file__).parents[2] / "data" / "splats" / "small_from_splat.ply"
    (folder / "a.toml").write_text(JOB.replace("splats.ply", str(splats)) + line, encoding="utf-8")
    return job.load(folder / "a.toml").display


def test_a_picture_behind_a_job(tmp_path: Path) -> None:
    Image.new("RGB", (8, 6), (255, 0, 0)).save(tmp_path / "plate.png")
    found = loaded(tmp_path, 'background = { path = "plate.png", exposure = 1 }')
    assert found.backdrop is not None and len(found.backdrop.identity) == 64
    whole = replace(job.load(tmp_path / "a.toml"), cameras=(ALONG_X,))
    light = Backdrops(whole, lambda x: x).of(ALONG_X, None)
    assert light is not None
    np.testing.assert_allclose(light, np.broadcast_to(np.array([2.0, 0, 0]), light.shape), atol=1e-6)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('background = "sky.hdr"', "there is no file 'sky.hdr'"),
        ("background = { exposure = 1 }", "nothing is given for it"),
        ('background = { path = "transparent", exposure = 1 }', "exposure without an environment"),
        ("background = { color = [0, 0, 0], blur = 1 }", "blur without an environment"),
        ('background = { path = "environment", ground = { radius = 1 } }', "radius 1 below the camera's height"),
        ("background = 3", "background: 3"),
    ],
)
def test_wrong_backgrounds_are_one_line(tmp_path: Path, line: str, said: str) -> None:
    with pytest.raises(InputError, match=said.replace("[", r"\[")):
        loaded(tmp_path, line)


def test_unlit_frames_stand_in_the_light_that_they_were_captured_in() -> None:
    """And lit ones in their own; surroundings of the last lighting are made once."""
    sky = [Lighting(environment=Environment(radiance=np.full((1, 1, 3), x, np.float32))) for x in (1.0, 2.0)]
    whole = replace(
        Job(source=Path("a.toml")),
        captured=sky[0],
        display=DisplaySettings(backdrop=Backdrop()),
    )
    made = Backdrops(whole, lambda x: x)
    for lighting, level in ((None, 1.0), (sky[1], 2.0), (sky[1], 2.0)):
        light = made.of(ALONG_X, lighting)
        assert light is not None and (light == level).all()
    assert Backdrops(replace(whole, captured=None), lambda x: x).of(ALONG_X, None) is None
