"""What is said about frames: right ones nothing, wrong ones the right thing. On the shipped stage, small."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight.model import Camera, DisplaySettings, Frame
from mirelight.pipeline import frame_diagnostics
from mirelight.pipeline.scene import Scene

SCENES = Path(__file__).resolve().parents[2] / "scenes"
STAGE = SCENES / "stage" / "job.toml"
FAST = [
    "resolution=[160,90]",
    "render.spp=4",
    'proxy={path="proxy.glb"}',
    """cameras_from={path="proxy",transform="none"}""",
]
PROXY = 'proxy={path="proxy.glb",transform=%s}'


def frame_of(*overrides: str, path: Path = STAGE, lighting: int = 2, camera: int = 0) -> tuple[Scene, Frame]:
    job = mirelight.load(path, [*FAST, *overrides])
    scene = mirelight.prepare(job)
    view = job.cameras[camera]
    lit = mirelight.light(scene, view, job.lightings[lighting])
    return scene, mirelight.relight(scene, mirelight.composite(scene, view), lit)


def kinds(scene: Scene, frame: Frame) -> list[str]:
    return [x.kind for x in frame_diagnostics.of_frame(frame, scene.job.display)]


@pytest.fixture(scope="module")
def right() -> tuple[Scene, Frame]:
    return frame_of()


def test_right_frames_are_silent(right: tuple[Scene, Frame]) -> None:
    assert kinds(*right) == []
    scene = right[0]
    splats = mirelight.composite(scene, scene.job.cameras[1])
    for lighting in scene.job.lightings:
        lit = mirelight.light(scene, scene.job.cameras[1], lighting)
        assert kinds(scene, mirelight.relight(scene, splats, lit)) == [], lighting.name


@pytest.mark.parametrize(
    "transform",
    [
        "{rotation_euler=[180,0,0]}",
        "{rotation_euler=[0,0,90]}",
        "{translation=[3,0,0]}",
        "{scale=0.01}",
        "{scale=0.5}",
    ],
)
def test_a_proxy_that_is_turned_moved_or_scaled_is_said(transform: str) -> None:
    found = kinds(*frame_of(PROXY % transform))
    assert found[:1] in (["uncovered"], ["gap"]), found


def test_a_sky_of_splats_far_behind_needs_no_proxy(right: tuple[Scene, Frame]) -> None:
    scene, frame = right
    assert frame.splats is not None and frame.lighting is not None
    above = np.arange(90)[:, None] < 40
    lit = replace(frame.lighting, coverage=np.where(above, np.float32(0), frame.lighting.coverage))
    near = replace(frame, lighting=lit)
    depth = np.where(above, 10 * frame.splats.median_depth, frame.splats.median_depth)
    far = replace(near, splats=replace(frame.splats, median_depth=depth))
    assert kinds(scene, near)[:1] == ["uncovered"]
    assert "uncovered" not in kinds(scene, far)


def test_a_sky_of_splats_nearby_needs_no_proxy_that_was_made_from_them(right: tuple[Scene, Frame]) -> None:
    """As a camera sees it whose horizon is the picture's middle row."""
    scene, frame = right
    assert frame.splats is not None and frame.lighting is not None
    level = Camera.look_at((0, 1, 5), (0, 1, 0), 160, 90, yfov=50)
    row = np.arange(90)[:, None]
    said = {}
    for part, without in (("above", row < 43), ("below", row > 47)):
        lit = replace(frame.lighting, coverage=np.where(without, np.float32(0), frame.lighting.coverage))
        seen = replace(frame, lighting=lit, splats=replace(frame.splats, camera=level))
        for own in (True, False):
            found = frame_diagnostics.of_frame(seen, scene.job.display, own=own)
            said[part, own] = "uncovered" in [x.kind for x in found]
    assert said == {("above", True): False, ("above", False): True, ("below", True): True, ("below", False): True}


SMALL = "resolution=[64,36]"


@pytest.mark.parametrize("camera", [0, 1])
@pytest.mark.parametrize("scene", ["stage", "courtyard"])
def test_small_frames_of_right_proxies_are_silent(scene: str, camera: int) -> None:
    """A pixel of theirs spans a good part of the floor's depth."""
    found = kinds(*frame_of(SMALL, path=SCENES / scene / "job.toml", lighting=0, camera=camera))
    assert "gap" not in found and "uncovered" not in found


@pytest.mark.parametrize("transform", ["{rotation_euler=[180,0,0]}", "{scale=0.01}", "{scale=1.2}"])
def test_small_frames_of_wrong_proxies_are_not(transform: str) -> None:
    found = kinds(*frame_of(SMALL, PROXY % transform))
    assert found[:1] in (["uncovered"], ["gap"]), found


def test_a_proxy_that_swallows_the_camera_is_said() -> None:
    scene, frame = frame_of(PROXY % "{scale=100}")
    found = frame_diagnostics.of_frame(frame, scene.job.display)
    assert found and found[0].kind in ("uncovered", "gap")


def test_too_bright_and_too_dark(right: tuple[Scene, Frame]) -> None:
    scene, frame = right
    for stops, kind in ((6.0, "white"), (-7.5, "black")):
        (found,) = frame_diagnostics.of_frame(frame, replace(scene.job.display, exposure=stops))
        assert found.kind == kind
        by = float(found.remedy.split("about ")[1].split(",")[0])
        # the remedy, followed, silences it
        mended = replace(scene.job.display, exposure=stops + float(np.log2(by)))
        assert frame_diagnostics.of_frame(frame, mended) == ()


def test_no_light_at_all() -> None:
    scene, frame = frame_of("lightings=[]", 'lights=[{type="point",position=[0,2,4],intensity=0}]', lighting=0)
    (found,) = frame_diagnostics.of_frame(frame, scene.job.display)
    assert found.kind == "black" and "no light reaches them" in found.remedy


def test_a_light_inside_a_thing_or_switched_off() -> None:
    lights = (
        'lights=[{type="point",name="lost",position=[0,-50,0],intensity=9},'
        '{type="sun",direction=[0,-1,-0.5],intensity=3}]'
    )
    scene, frame = frame_of("lightings=[]", lights, "environment={radiance=0.3}", "render.max_depth=1", lighting=0)
    found = frame_diagnostics.of_frame(frame, scene.job.display)
    assert [x.kind for x in found] == ["light"] and "'lost'" in found[0].text
    assert frame_diagnostics.of_frame(frame, scene.job.display, off=["lost"]) == ()


def test_a_camera_that_sees_nothing() -> None:
    away = "cameras=[{position=[0,1,9],target=[0,1,20]}]"
    scene, frame = frame_of(away, "cameras_from=[]")
    (found,) = frame_diagnostics.of_frame(frame, scene.job.display)
    assert found.kind == "nothing" and "the camera sees nothing" in found.text


def test_bright_captures_are_not_taken_for_too_much_light(right: tuple[Scene, Frame]) -> None:
    _, frame = right
    assert frame.unlit is not None
    white = np.concatenate([frame.unlit[..., 3:].repeat(3, axis=-1), frame.unlit[..., 3:]], axis=-1)
    shown = replace(frame, rgba=white, unlit=white)
    assert frame_diagnostics.of_frame(shown, DisplaySettings()) == ()


def test_a_capture_that_is_black(right: tuple[Scene, Frame]) -> None:
    scene, frame = right
    assert frame.unlit is not None
    unlit = frame.unlit * np.array([0, 0, 0, 1], np.float32)
    (found,) = frame_diagnostics.of_frame(replace(frame, rgba=unlit, unlit=unlit), scene.job.display)
    assert found.kind == "black" and "the capture itself is black" in found.text and "colours" in found.remedy
    # one that has a lamp in the dark is a night
    lamp = unlit.copy()
    lamp[20:30, 60:90, :3] = frame.unlit[20:30, 60:90, :3]
    assert frame_diagnostics.of_frame(replace(frame, rgba=lamp, unlit=lamp), scene.job.display) == ()


def test_a_made_proxys_colours_are_not_blamed_on_transforms() -> None:
    """It lies where the splats are; ground to the horizon is of it on which hardly any lie."""
    found = frame_diagnostics.of_colors(0.064, lit=True)
    assert found is not None and "transforms" in found.remedy
    assert frame_diagnostics.of_colors(0.064, lit=True, own=True) is None
    assert frame_diagnostics.of_colors(0.5, lit=False, own=True) is not None
