"""What stands behind the splats on the mixer's page: pixels past them are the offline frame's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.apps.mixer.bundle import export
from mirelight.base.conventions import map_pixels
from mirelight.io import job as jobs
from mirelight.io import splats
from mirelight.io.gltf.write import write_glb
from mirelight.io.hdr import write_hdr
from mirelight.io.png import encode_display
from mirelight.model import F32, Job, Lighting
from mirelight.pipeline import stages
from mirelight.pipeline.scene import prepare

from . import mixer_page
from .mixer_scene import walls

SIZE = (160, 120)
JOB = """
splats = "splats.ply"
proxy = "proxy.glb"
resolution = [160, 120]

[captured]
environment = { radiance = [0.05, 0.2, 0.1] }

[render]
spp = 4

[[cameras]]
name = "front"
type = "perspective"
position = [0.5, 1.6, 4.2]
target = [0, 0.4, 0]
yfov = 40
near = 0.1
far = 50

[[lightings]]
name = "day"
environment = { sky = { elevation = 30, azimuth = 70 }, intensity = 5e-5 }

[[lightings]]
name = "dusk"
environment = { path = "dusk.hdr", rotation = 130, intensity = 0.4 }
[[lightings.lights]]
type = "sun"
name = "sun"
direction = [-2.2, -0.2, 6.2]
intensity = 0.004
angular_diameter = 4
color = [1, 0.6, 0.3]

[[lightings]]
name = "lamp"
[[lightings.lights]]
type = "point"
name = "lamp"
position = [-1, 0.8, 0.5]
intensity = 2
"""
STEPS = """
    await picture('day');
    page.choose(1);
    page.jump();
    await picture('dusk');
    set('environment: strength', Math.cbrt(2.5 / 8));
    document.getElementById('exposure').value = 0.5;
    document.getElementById('exposure').dispatchEvent(new Event('input'));
    await picture('edited');
    page.actions.captured();
    page.jump();
    await picture('captured');
    page.choose(2);
    page.jump();
    await picture('lamp');
"""
SENT = ("day", "dusk", "edited", "captured", "lamp")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job's scene, a panorama and a picture."""
    out = tmp_path_factory.mktemp("behind")
    cloud, proxy = walls(24)
    splats.write(cloud, out / "splats.ply")
    write_glb(out / "proxy.glb", proxy, (), ())
    way = map_pixels(256)
    write_hdr(
        out / "dusk.hdr", (0.6 + 0.5 * way @ np.array([[0.9, 0.1, 0], [0.2, 0.7, 0.9], [0, 0.8, 0.3]])).astype("f4")
    )
    across, down = np.meshgrid(np.linspace(0, 1, 300), np.linspace(0, 1, 200))
    write_hdr(out / "plate.hdr", np.stack([across, down, 0.3 + 0 * down], axis=-1).astype(np.float32))
    (out / "job.toml").write_text(JOB)
    return out


def driven(job: Job, out: Path, steps: str = STEPS) -> dict[str, NDArray[np.float64]]:
    """Pictures (H, W, 3) of the exported page, 0 to 255."""
    made = export(prepare(job), out, spp=4)
    assert made.warnings == ()
    sent = mixer_page.drive(made.folder, steps, SIZE, SENT, 600)
    return {name: (255 * mixer_page.picture(sent[name], SIZE)).astype(np.float64) for name in SENT if name in sent}


def offline(job: Job, lighting: Lighting | None) -> tuple[NDArray[np.float64], F32]:
    """The frame's PNG (H, W, 3) as `mirelight render` makes it, and its alpha (H, W)."""
    frame = stages.frame(prepare(job), job.cameras[0], lighting)
    assert frame.background is not None or lighting is not None
    shown = encode_display(frame.rgba, job.display, frame.profile, behind=frame.background)
    return shown.astype(np.float64), frame.rgba[..., 3]


@pytest.mark.parametrize(
    ("tone", "more"), [("none", ""), ("aces", ", ground = { center = [0, -0.5, 0], height = 1.6, radius = 30 }")]
)
def test_the_sky_past_the_splats_is_the_frames(folder: Path, tmp_path: Path, tone: str, more: str) -> None:
    behind = f'display.background={{ path = "environment", exposure = -0.3{more} }}'
    given = [behind, f'display.tone="{tone}"']
    edits = ["mix.dusk={ environment = 2.5 }", "display.exposure=0.5"]
    job, edited = (jobs.load(folder / "job.toml", x) for x in (given, [*given, *edits]))
    seen = driven(job, tmp_path)
    expected = {x.name: (job, x) for x in job.lightings} | {
        "edited": (edited, edited.lightings[1]),
        "captured": (edited, None),
    }
    for name, (of, lighting) in expected.items():
        shown, alpha = offline(of, lighting)
        past = alpha == 0
        assert past.mean() > 0.1
        if name == "lamp":
            assert not seen[name][past].any()
            continue
        off = np.abs(seen[name] - shown)[past]
        assert shown[past].max() > 40, name
        assert off.max() <= 2, name
        if name == "captured":  # half-covered pixels show both
            assert np.abs(seen[name] - shown)[(alpha > 0.2) & (alpha < 0.8)].mean() < 8
    lit = offline(job, job.lightings[1])[0]
    assert (lit.min(axis=2) > 200).any() == (seen["dusk"].min(axis=2) > 200).any()


def test_a_picture_behind_the_splats(folder: Path, tmp_path: Path) -> None:
    job = jobs.load(folder / "job.toml", ['display.background="plate.hdr"', 'display.tone="neutral"'])
    seen = driven(job, tmp_path, "page.actions.captured(); page.jump(); await picture('captured');")
    shown, alpha = offline(job, None)
    off = np.abs(seen["captured"] - shown)
    assert off[alpha == 0].max() <= 2
    assert off[(alpha > 0.2) & (alpha < 0.8)].mean() < 8
