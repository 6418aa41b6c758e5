"""Factors under a painted mask: taken from the surface around, in every camera, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import mirelight
from mirelight import dataset, relighting
from mirelight.base import colour, sh
from mirelight.base.errors import InputError
from mirelight.batch import executor
from mirelight.io import splats
from mirelight.io.gltf.write import write_glb
from mirelight.model import (
    Camera,
    Deferred,
    DirectionalLight,
    Job,
    Lighting,
    LightingBuffer,
    LightLayer,
    OutputSettings,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    SplatCloud,
)
from mirelight.model.dressing import Mask
from mirelight.pipeline import stages
from mirelight.pipeline.plan import plan
from mirelight.pipeline.scene import prepare
from mirelight.relighting.inpainting import inpainted
from mirelight.store import Store

F32 = NDArray[np.float32]
WIDTH, HEIGHT = 200, 40
BAND = slice(92, 110)  # columns that are painted


# --- pictures made by hand -------------------------------------------------------------------------------------------


def buffer(light: F32, albedo: float = 0.5) -> LightingBuffer:
    """A wall that faces the eye, lit by so much (H, W, 3), irradiance / pi."""
    shown, one = np.asarray(light * albedo, np.float32), np.ones((HEIGHT, WIDTH), np.float32)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    front = np.broadcast_to(np.array([0, 0, 1], np.float32), shown.shape)
    return LightingBuffer(
        camera=Camera.look_at((0, 0, 3), (0, 0, 0), WIDTH, HEIGHT),
        coverage=one,
        layers=(LightLayer(name="all", direct=shown, indirect=0 * shown),),
        depth=3 * one,
        position=(np.stack([columns, -rows, 0 * rows], axis=-1) / HEIGHT).astype(np.float32),
        normal=front,
        geometric_normal=front,
        albedo=np.full_like(shown, albedo),
    )


def lit(sun_from: int, strength: float = 1.0) -> F32:
    """(H, W, 3) light of 0.2 from all around, and that of a sun which falls from a column on."""
    light = np.full((HEIGHT, WIDTH, 3), 0.2, np.float32)
    light[:, sun_from:] += strength
    return light


def pattern() -> F32:
    """(H, W, 3) an albedo with a fine pattern."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return np.asarray(np.stack([0.5 + 0.1 * ((rows // 2 + columns // 3) % 2)] * 3, -1) * [0.9, 0.7, 0.4], np.float32)


def picture(light: F32) -> F32:
    """(H, W, 4) what a camera shows of the wall."""
    return np.concatenate([pattern() * light, np.ones((HEIGHT, WIDTH, 1))], -1).astype(np.float32)


def paint() -> NDArray[np.bool_]:
    out = np.zeros((HEIGHT, WIDTH), np.bool_)
    out[:, BAND] = True
    return out


@pytest.mark.parametrize("off", [-5, 4])
def test_a_ghost_of_a_shadow_goes_and_its_paint_stays(off: int) -> None:
    """The captured shadow ends at column 100, that of the proxy elsewhere; the new one ends in the paint as well."""
    captured, new = buffer(lit(100 + off)), buffer(lit(104, 0.7))
    found = inpainted(captured, paint(), captured, picture(lit(100)))
    assert found.captured is not None
    light = found.captured.beauty / 0.5
    assert np.abs(captured.beauty / 0.5 / lit(100) - 1).max() > 0.8
    np.testing.assert_allclose(light, lit(100), rtol=0.15)
    np.testing.assert_array_equal(found.captured.beauty[~paint()], captured.beauty[~paint()])
    np.testing.assert_array_equal(found.new(new).beauty, new.beauty)  # it was traced right


def test_a_fault_of_the_surface_is_filled_in_both_lights() -> None:
    """A bump of the proxy darkens captured and new light alike, each in its own way."""
    bump = np.ones((HEIGHT, WIDTH, 1), np.float32)
    bump[10:30, 95:106] = 0.4
    captured, new = buffer(lit(0) * bump), buffer(lit(0, 0.3) * bump**2)
    found = inpainted(captured, paint(), captured, picture(lit(0)))
    assert found.captured is not None
    np.testing.assert_allclose(found.captured.beauty / 0.5, lit(0), rtol=0.01)
    np.testing.assert_allclose(found.new(new).beauty / 0.5, lit(0, 0.3), rtol=0.01)
    np.testing.assert_allclose(inpainted(new, paint()).new(new).beauty / 0.5, lit(0, 0.3), rtol=0.01)


def test_another_surface_beside_the_paint_says_nothing() -> None:
    before = buffer(lit(0) * np.where(paint()[..., None], np.float32(0.4), np.float32(1)))
    step = before.position.copy()
    step[:, BAND.stop :, 2] += 1  # what is right of the paint lies nearer
    beside = before.beauty.copy()
    beside[:, BAND.stop :] *= 9
    layers = (LightLayer(name="all", direct=beside, indirect=0 * beside),)
    before = replace(before, position=step, layers=layers)
    found = inpainted(before, paint()).new(before)
    np.testing.assert_allclose(found.beauty[:, BAND] / 0.5, lit(0)[:, BAND], rtol=0.03)


def test_paint_without_free_surface_around_changes_nothing() -> None:
    before = buffer(lit(100))
    for mask in (np.ones_like(paint()), np.zeros_like(paint())):
        found = inpainted(before, mask, before, picture(lit(100)))
        assert found.captured is before and found.new(before) is before
    with pytest.raises(ValueError, match="of others"):
        inpainted(before, paint()[:3])


# --- whole jobs ------------------------------------------------------------------------------------------------------

SUN = DirectionalLight(name="sun", direction=np.array([0.6, -0.8, 0.0]), intensity=6.0)
FILL = DirectionalLight(name="fill", direction=np.array([0.0, -1.0, 0.0]), intensity=1.5)
NEW = 4.0  # lux straight from above
ABOVE = Camera.look_at((0, 3, 0.01), (0, 0, 0), 192, 144, yfov=35, name="above")
ASIDE = Camera.look_at((1.5, 2.5, 1.0), (0, 0, 0), 160, 120, yfov=30, name="aside")
RATIO = RelightSettings(mode="ratio", delta=1e-4, repair=False)


def floor(light: F32 | float) -> SplatCloud:
    """A floor of splats with an albedo of 0.4, under so much light (N,) or everywhere; see `places`."""
    at = places()
    display = colour.srgb_encode(np.broadcast_to(0.4 * np.asarray(light) / np.pi, len(at)).astype(np.float32))
    fields: dict[str, Any] = {
        "means": at,
        "quats": np.tile([1.0, 0, 0, 0], (len(at), 1)),
        "scales": np.tile([0.05, 0.001, 0.05], (len(at), 1)),
        "opacities": np.full(len(at), 0.95),
        "sh": np.repeat((display[:, None, None] - 0.5) / sh.C0, 3, axis=2),
    }
    return SplatCloud(**fields)


def places() -> NDArray[np.float64]:
    x, z = (a.ravel() for a in np.meshgrid(np.arange(-2, 2, 0.05), np.arange(-1.5, 1.5, 0.05)))
    return np.stack([x, 0 * x, z], axis=1)


def roofed(x: float) -> ProxyMesh:
    """A floor, and a roof that shades it up to x."""
    corners: list[list[float]] = [[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]]
    corners += [[-9, 5, 2], [x - 3.75, 5, 2], [x - 3.75, 5, -2], [-9, 5, -2]]
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)
    return ProxyMesh(vertices=np.array(corners, np.float32), faces=faces, albedo=np.full(3, 0.5))


def stroke() -> F32:
    """(H, W) paint over the frame from above: along the ghost, but for its upper rows."""
    out = np.zeros((144, 192), np.float32)
    out[60:, 84:112] = 1
    return out


def job(*masks: Mask) -> Job:
    """The shadow of the capture ends at x = 0, that of the proxy at 0.15."""
    return Job(
        source=Path("floor.toml"),
        splats=Deferred.of(floor(np.where(places()[:, 0] > 0, FILL.intensity + 0.8 * SUN.intensity, FILL.intensity))),
        proxy=Deferred.of(roofed(0.15)),
        masks=masks,
        cameras=(ABOVE, ASIDE),
        lightings=(Lighting(name="noon", lights=(replace(FILL, name="noon", intensity=NEW),)),),
        captured=Lighting(name="captured", lights=(SUN, FILL)),
        render=RenderSettings(spp=16, max_depth=1),
        relight=RATIO,
    )


def painted() -> Mask:
    return Mask(camera=ABOVE, painted=Deferred("stroke", stroke))


def test_every_camera_sees_the_paint_on_the_surface() -> None:
    plain, made = prepare(job()), prepare(job(painted()))
    for camera in (ABOVE, ASIDE):
        before, after = (stages.frame(x, camera, x.job.lightings[0]) for x in (plain, made))
        flat = prepare(replace(job(), splats=Deferred.of(floor(NEW))))
        truth = relighting.unlit_rgba(flat.compositor.composite(camera))[..., :3]
        assert before.lighting is not None
        x, z = before.lighting.position[..., 0], before.lighting.position[..., 2]
        ghost = (x > 0.03) & (x < 0.12) & (z > -0.1) & (z < 0.8) & (truth[..., 0] > 0.1)
        left, was = (np.abs(f.rgba[ghost, :3] / truth[ghost] - 1).mean() for f in (after, before))
        assert ghost.sum() > 100 and was > 1.0 and left < 0.15
        away = (np.abs(x) > 0.5) | (z < -0.35)
        np.testing.assert_array_equal(after.rgba[away], before.rgba[away])
        assert made.keys.frame(camera, made.job.lightings[0]) != plain.keys.frame(camera, plain.job.lightings[0])


def test_masks_of_a_job_file(tmp_path: Path) -> None:
    write_glb(tmp_path / "proxy.glb", roofed(0.15))
    splats.write(floor(1.0), tmp_path / "floor.ply")
    Image.fromarray((stroke() * 255).astype(np.uint8)).save(tmp_path / "ghost.png")
    text = """
splats = "floor.ply"
proxy = "proxy.glb"
captured = { lights = [{ type = "directional", direction = [0, -1, 0], intensity = 1 }] }
relight = { mask = MASK }
lights = [{ type = "point", position = [0, 3, 0], intensity = 1 }]
cameras = [{ name = "above", position = [0, 3, 0.01], target = [0, 0, 0] }]
resolution = [192, 144]
render = { spp = 1 }
"""
    one = '{ path = "ghost.png", camera = "above" }'
    file = tmp_path / "job.toml"
    for given, count in ((one, 1), (f"[{one}, {one}]", 2)):
        file.write_text(text.replace("MASK", given))
        found = mirelight.load(file)
        assert len(found.masks) == count and "ghost.png" in found.inputs
        np.testing.assert_array_equal(found.masks[0].painted.value, stroke())
        prepare(found)
    wrong = (
        (text.replace("MASK", one.replace("above", "abov")), "no camera is named"),
        (text.replace("mask = MASK", f'mask = {one}, per = "splat"'), "light that is found for splats"),
        (text.replace("MASK", one) + 'output = { store = "layers" }\n', "frames that are mixed from layers"),
    )
    for given, says in wrong:
        file.write_text(given)
        with pytest.raises(InputError, match=says):
            prepare(mirelight.load(file))


def test_a_data_set_of_painted_frames_is_refused(tmp_path: Path) -> None:
    made = replace(job(painted()), output=OutputSettings(directory=tmp_path, store="both", png=False))
    made = replace(made, cameras=(ASIDE.resized(32, 24),))
    store = Store(made)
    store.open()
    executor.run(plan(made), store)
    store.close()
    with pytest.raises(InputError, match="painted mask"):
        dataset.open(tmp_path)
