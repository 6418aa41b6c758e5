"""Views of OpenColorIO, against the library itself."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import PyOpenColorIO
import pytest
from PIL import Image

from mirelight.base import colour
from mirelight.base.errors import InputError
from mirelight.io import image, job, records, views
from mirelight.io.display import read_display
from mirelight.io.png import encode_display
from mirelight.model import F32, Camera, DisplaySettings, Frame, OutputSettings, Provenance
from mirelight.pipeline.keys import Keys
from mirelight.pipeline.provenance import pixel_settings

SPLATS = Path(__file__).resolve().parents[2] / "data" / "splats" / "small.glb"
STUDIO = "ocio://studio-config-latest"
CONFIG = PyOpenColorIO.Config.CreateFromBuiltinConfig("studio-config-latest")
SDR = [(d, v) for d in CONFIG.getDisplays() for v in CONFIG.getViews(d) if "HDR" not in v]
ACES = "ACES 2.0 - SDR 100 nits (Rec.709)"
JOB = """
[splats]
path = "a.glb"
[[cameras]]
name = "front"
position = [0, 0, 3]
target = [0, 0, 0]
width = 8
height = 4
[display]
"""


def theirs(light: F32, display: str, view: str) -> F32:
    """By the library alone, pixel by pixel."""
    transform = PyOpenColorIO.DisplayViewTransform(src="Linear Rec.709 (sRGB)", display=display, view=view)
    cpu = CONFIG.getProcessor(transform).getDefaultCPUProcessor()
    pixels = [cpu.applyRGB(pixel) for pixel in light.reshape(-1, 3).tolist()]
    return np.clip(np.asarray(pixels, np.float32).reshape(light.shape), 0, 1)


def ramp() -> F32:
    """Gray and the six pure hues over twenty stops."""
    levels = 2.0 ** np.linspace(-12, 8, 401)
    hues = np.array([[1, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1], [1, 0, 1]])
    return np.asarray(hues[:, None] * levels[:, None], np.float32)


@pytest.mark.parametrize(("display", "view"), SDR)
def test_built_in_sdr_views_are_the_librarys_own(display: str, view: str) -> None:
    settings = DisplaySettings(view=views.resolve("a.toml", view, config=STUDIO, display=display))
    rng = np.random.default_rng(3)
    frame = np.asarray(rng.lognormal(-1, 2, (64, 48, 3)), np.float32)
    for light in (ramp(), frame):
        whole = np.ones(light.shape[:-1], np.float32)
        found = colour.shown(light, whole, "srgb", view=views.curve_of(settings))
        if view == "Raw":  # shows numbers, whatever the space: there the two ways differ by definition
            assert np.array_equal(found, np.clip(light, 0, 1))
            continue
        assert np.abs(found - theirs(light, display, view)).max() <= 1 / 1023


def frame_of(alpha: float = 1.0) -> Frame:
    rgba = np.random.default_rng(1).uniform(0, 3, (4, 8, 4)).astype(np.float32)
    rgba[..., 3] = alpha
    camera = Camera.look_at((0, 0, 3), (0, 0, 0), 8, 4, name="front")
    return Frame(camera=camera, rgba=rgba, unlit=None, factor=None, lighting=None, splats=None)


def test_pictures_lie_over_the_background_in_display_space(tmp_path: Path) -> None:
    view = views.resolve("a.toml", ACES, config=None, display=None)
    settings = DisplaySettings(view=view, exposure=1.0, background=(0.2, 0.4, 0.6))
    frame = frame_of(0.5)
    shown = theirs(frame.rgba[..., :3] / np.float32(0.5) * 2, "sRGB - Display", ACES)
    expected = 255 * (0.5 * shown + 0.5 * np.array([0.2, 0.4, 0.6]))
    assert np.abs(encode_display(frame.rgba, settings) - expected).max() < 0.5 + 255 / 1023
    image.write(frame, tmp_path / "a.png", settings)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "a.png")), encode_display(frame.rgba, settings))


def test_a_frames_exr_is_shown_by_the_view_of_its_job(tmp_path: Path) -> None:
    settings = DisplaySettings(view=views.resolve("a.toml", ACES, config=None, display=None))
    made_by = Provenance(
        mirelight="1",
        versions={},
        job="a",
        inputs={},
        settings={"display": asdict(settings)},
        lighting="",
        fingerprint="1",
    )
    frame = replace(frame_of(), made_by=made_by)
    image.write(frame, tmp_path / "a.exr", output=OutputSettings(color_space="ACEScg"))
    off = read_display(tmp_path / "a.exr").astype(int) - encode_display(frame.rgba, settings)
    assert np.abs(off).max() <= 1  # the way to ACEScg and back


def job_of(tmp_path: Path, display: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("OCIO", raising=False)
    (tmp_path / "a.glb").write_bytes(SPLATS.read_bytes())
    (tmp_path / "a.toml").write_text(JOB + display)
    return tmp_path / "a.toml"


@pytest.mark.parametrize(
    ("display", "said"),
    [
        ('view = "ACES 2.0 - SDR 100 nits (Rec709)"', f"display.view: no view .* there is '{ACES[:20]}"),
        ('view = "ACES 2.0 - SDR 100 nits (P3 D65)"', "set display.display to 'Display P3 - Display'"),
        ('view = "Raw"\ndisplay = "sRGB"', "display.display: no display 'sRGB' .* there is 'sRGB - Display'"),
        ('view = "Raw"\nconfig = "none.ocio"', "display.config: no OpenColorIO config 'none.ocio'"),
        ('view = "Raw"\nconfig = "a.toml"', "display.config: OpenColorIO refuses it"),
        ('view = "Raw"\nconfig = "ocio://none"', "display.config: OpenColorIO refuses it"),
        ('view = "Raw"\ntone = "aces"', "display.tone: a tone curve beside a view"),
        ('config = "ocio://default"', "display.config: no view to go with it"),
    ],
)
def test_what_a_config_does_not_have(tmp_path: Path, display: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=said) as error:
        job.load(job_of(tmp_path, display, monkeypatch))
    assert "\n" not in str(error.value)


def test_a_view_of_a_file_and_of_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    CONFIG.serialize(str(tmp_path / "studio.ocio"))
    named = job.load(job_of(tmp_path, f'view = "{ACES}"\nconfig = "studio.ocio"', monkeypatch))
    assert "studio.ocio" in named.inputs
    built_in = job.load(job_of(tmp_path, f'view = "{ACES}"\nconfig = "{STUDIO}"', monkeypatch))
    path = job_of(tmp_path, f'view = "{ACES}"', monkeypatch)
    monkeypatch.setenv("OCIO", str(tmp_path / "studio.ocio"))
    by_environment = job.load(path)
    assert named.display == by_environment.display != built_in.display  # another place, but the same transform
    keys = [Keys(x).file("frame", x.cameras[0], None, ".png") for x in (named, by_environment, built_in)]
    assert keys[0] == keys[1] == keys[2]
    assert named.display.view is not None
    other = replace(named, display=replace(named.display, view=replace(named.display.view, identity="other")))
    assert Keys(other).file("frame", other.cameras[0], None, ".png") != keys[0]

    # Files hold the config's name, and are shown by it wherever it lies now.
    shown = pixel_settings(named)["display"]
    assert shown["view"]["config"] == "studio.ocio"
    held = records.made(DisplaySettings, shown).view
    assert held is not None and views.located(held, tmp_path / "out" / "a.exr") == named.display.view
    with pytest.raises(InputError, match=r"a view of 'studio.ocio', which is not found as it was"):
        views.located(replace(held, identity="other"), tmp_path / "a.exr")
