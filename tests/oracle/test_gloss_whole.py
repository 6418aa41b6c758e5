"""Gloss in whole frames: nothing changes in the captured light, and what glows lights what is beside it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

import mirelight
from mirelight.base import colour
from mirelight.base.errors import InputError
from mirelight.base.sh import C0
from mirelight.io import splats
from mirelight.lighting import Tracer
from mirelight.model import (
    F32,
    Camera,
    Deferred,
    Frame,
    Lighting,
    PointLight,
    RelightSettings,
    RenderSettings,
    SplatCloud,
)
from mirelight.model.dressing import dressed
from mirelight.pipeline import stages
from mirelight.pipeline.scene import prepare

from .test_objects_whole import JOB, folder

__all__ = ["folder"]
FLOOR = "\n[[materials]]\nroughness = 0.3\n[relight]\ngloss = true\n"
LAMP = 'lightings = [{ name = "lamp", lights = [{ type = "point", position = [0, 1, -2], intensity = 3 }] }]'


def made(folder: Path, text: str) -> Frame:
    (folder / "gloss.toml").write_text(text, encoding="utf-8")
    job = mirelight.load(folder / "gloss.toml")
    scene = mirelight.prepare(job)
    return stages.frame(scene, job.cameras[0], job.lightings[0])


@pytest.mark.parametrize("listed", ["captured", "by its name"])
def test_in_the_captured_light_a_glossy_floor_is_as_captured(folder: Path, listed: str) -> None:
    low = JOB.replace("[-0.5, -1, -0.3]", "[0, -0.3, 1]")  # mirrored brighter than the splats show
    text = low.replace("splats.ply", "two-coloured.ply")
    cloud = splats.read(folder / "splats.ply")
    splats.write(
        replace(cloud, sh=np.where(cloud.means[:, :1, None] < 0, 0, 0.5) * np.ones_like(cloud.sh)),
        folder / "two-coloured.ply",
    )
    if listed == "by its name":
        before, after = text.split("[captured]\n")
        light, rest = after.split("[render]")
        light = light.replace("[[captured.lights]]", "[[lightings.lights]]")
        before = before.replace('lightings = "captured"', 'captured = { lighting = "noon" }')
        text = f'{before}[[lightings]]\nname = "noon"\n{light}[render]{rest}'
    frame = made(folder, text + FLOOR)
    assert frame.unlit is not None
    lit = frame.unlit[..., 3] > 0.9
    np.testing.assert_allclose(frame.rgba[lit], frame.unlit[lit], rtol=0.02)


def test_a_new_lamp_is_mirrored_where_it_must_be(folder: Path) -> None:
    text = JOB.replace('lightings = "captured"', LAMP)
    plain = made(folder, text).rgba[..., :3]
    added = (made(folder, text + FLOOR).rgba[..., :3] - plain).mean(axis=-1)
    assert added.max() > 0.02
    row, column = np.unravel_index(added.argmax(), added.shape)
    camera = mirelight.load(folder / "gloss.toml").cameras[0]
    eye, lamp = camera.position, np.array([0.0, 1, -2])
    share = eye[1] / (eye[1] + lamp[1])
    point = eye + share * (lamp - eye)  # where the floor mirrors it
    point[1] = 0
    x, y, z = (camera.camera_from_world @ np.append(point, 1))[:3]
    assert abs(row + 0.5 - (camera.cy - camera.fy * y / -z)) < 4
    assert abs(column + 0.5 - (camera.cx + camera.fx * x / -z)) < 4


def test_a_part_glows_in_every_lighting(folder: Path) -> None:
    text = JOB.replace('lightings = "captured"', LAMP)
    glow = "\n[[materials]]\nbox = [[-3, -1, -3], [0, 1, 3]]\nemission = [0, 0, 2]\n"
    (folder / "gloss.toml").write_text(text + glow, encoding="utf-8")
    job = mirelight.load(folder / "gloss.toml")
    scene = prepare(job)
    lit = stages.light(scene, job.cameras[0], job.lightings[0])
    assert scene.glows and lit.captured is not None
    for buffer in (lit.new, lit.captured):
        layer = next(x for x in buffer.layers if x.name == "emission")
        assert layer.total[..., 2].max() == pytest.approx(2.0, rel=0.02) and not layer.total[..., :2].any()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ('profile = "playcanvas"\n', "relight.gloss: gloss and the profile playcanvas"),
    ],
)
def test_gloss_is_refused_where_it_is_not(folder: Path, change: str, said: str) -> None:
    text = change + JOB.replace('lightings = "captured"', LAMP) + FLOOR
    with pytest.raises(InputError, match=said):
        made(folder, text.replace("[relight]", '[relight]\nmode = "tint"'))


@pytest.mark.parametrize("shown", ["seen", "blurred", "not seen"])
def test_a_captured_highlight_goes_as_far_as_it_is_there_and_the_new_one_comes(folder: Path, shown: str) -> None:
    """A floor whose splats hold, in their base colour, what it mirrors of the captured lamp: under another lamp it is
    what a tracer says of a floor that nobody captured. Where they do not hold it there is no hole either."""
    old, new = (PointLight(name="lamp", position=np.array([x, 1.3, -0.5]), radius=0.1, intensity=4) for x in (-1, 1))
    rough = FLOOR.replace("0.3", "0.3" if shown == "blurred" else "0.5")
    (folder / "gloss.toml").write_text(JOB + rough, encoding="utf-8")
    job = mirelight.load(folder / "gloss.toml")
    assert job.proxy is not None
    slope = np.linspace(0.45, 0.55, 4, dtype=np.float32)[:, None] * np.ones(3, np.float32)  # colours that somebody told
    proxy = replace(job.proxy.value, vertex_colors=slope, albedo=None)
    floor, camera = (
        dressed(proxy, job.materials),
        Camera.look_at((0, 2.5, 3.5), (0, 0, 0), 60, 40, yfov=45, name="above"),
    )

    def seen(lamp: PointLight) -> tuple[F32, F32]:
        """(H, W, 3) light of a true floor, and of its lobe alone."""
        settings, light = RenderSettings(spp=64), Lighting(lights=(lamp,))
        matt, lobe = (Tracer(floor, settings, aovs=False, lobes=x).trace(light, camera).beauty for x in (False, True))
        return np.asarray(matt + lobe, np.float32), lobe

    (captured, before), (truth, after) = seen(old), seen(new)
    held = captured - before if shown == "not seen" else captured
    cloud = splats.read(folder / "splats.ply")
    there = cloud.means[:, 1] == 0
    eye = np.concatenate([cloud.means[there], np.ones((int(there.sum()), 1))], axis=1) @ camera.camera_from_world.T
    column, row = (
        camera.cx - camera.fx * eye[:, 0] / eye[:, 2] - 0.5,
        camera.cy + camera.fy * eye[:, 1] / eye[:, 2] - 0.5,
    )
    light = np.stack(
        [ndimage.map_coordinates(held[..., k], [row, column], order=1, mode="nearest") for k in range(3)], axis=1
    )
    baked = SplatCloud(
        means=cloud.means[there],
        quats=cloud.quats[there],
        scales=cloud.scales[there],
        opacities=np.full(int(there.sum()), 0.99, np.float32),
        sh=((colour.srgb_encode(light.astype(np.float32)) - 0.5) / C0)[:, None, :].astype(np.float32),
    )
    relit = RelightSettings(mode="ratio", gloss=True)
    scene = prepare(
        replace(
            job,
            cameras=(camera,),
            proxy=Deferred.of(proxy),
            splats=Deferred.of(baked),
            captured=Lighting(lights=(old,)),
            lightings=(Lighting(name="new", lights=(new,), relight=relit),),
            relight=relit,
        )
    )
    frame = stages.frame(scene, camera, scene.job.lightings[0])
    inside = ndimage.binary_erosion((truth[..., 1] > 0) & (frame.rgba[..., 3] > 0.9), iterations=2)
    old_zone, new_zone = (inside & (x[..., 1] > 0.3 * x[..., 1].max()) for x in (before, after))
    level = [float(frame.rgba[zone][:, :3].mean() / truth[zone].mean()) for zone in (old_zone, new_zone)]
    assert float(captured[old_zone].mean()) > 1.5 * float(truth[old_zone].mean())
    assert 0.75 < level[0] < 1.1, level  # 20 % of the matt surface's own light may be taken for gloss
    assert level[1] == pytest.approx(1, abs=0.05)
    darkest = np.min(frame.rgba[..., 1][old_zone] / truth[..., 1][old_zone])
    assert darkest > 0.7
