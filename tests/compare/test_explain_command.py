"""`mirelight explain`: with the real engine, without it, and its report in a browser.

Chromium and npm are part of the test environment, as for the tests of the real-time engine.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.apps.explain.types import CAUSES
from mirelight.cli import main

JOB = """
splats = "{assets}/synth_stack.ply"
proxy = "{assets}/stage.glb"
resolution = [160, 120]

[[lights]]
type = "spot"
name = "torch"
position = [2, 3, 2]
direction = [-0.4, -0.9, -0.2]
intensity = 40
inner_cone_angle = 15
outer_cone_angle = 30

[[cameras]]
name = "front"
position = [0.8, 0.7, 3.2]
target = [0, 0.2, 0]
yfov = 35

[render]
spp = 16

[relight]
texture_scale = 0.5
"""


@pytest.fixture(scope="module")
def job(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("explain") / "job.toml"
    path.write_text(JOB.format(assets=(data / "realtime" / "assets").as_posix()))
    return path


@pytest.fixture(scope="module")
def explained(job: Path) -> Path:
    """The folder of a ladder that starts from the real engine's frame."""
    folder = job.parent / "out"
    with contextlib.redirect_stdout(io.StringIO()) as said:
        assert main(["explain", str(job), "-o", str(folder), "--json"]) == 0
    assert json.loads(said.getvalue()) == {"folder": str(folder), **read(folder)}
    return folder


def read(folder: Path) -> dict[str, Any]:
    found = json.loads((folder / "explain.json").read_text())
    assert isinstance(found, dict)
    return found


def pixels(path: Path) -> Any:
    from PIL import Image

    return np.asarray(Image.open(path).convert("RGB"))


def test_the_ladder_starts_at_the_engines_own_frame(explained: Path) -> None:
    found = read(explained)
    assert found["really_rendered"]
    steps = {step["name"]: step for step in found["steps"]}
    assert set(steps) | set(found["absent"]) == set(CAUSES)
    assert {
        "float",
        "model",
        "corners",
        "order",
        "buffer",
        "shadows",
        "bias",
        "scale",
        "units",
        "size",
        "indirect",
        "tint",
    } <= set(steps)
    np.testing.assert_array_equal(pixels(explained / "00-engine.png"), pixels(explained / "engine" / "frame.png"))
    assert steps["model"]["psnr"] > 60  # what mirelight's model of the engine misses, shadow maps included
    assert steps["shadows"]["noise_psnr"] is None
    for name in ("size", "indirect", "coverage", "tint"):
        assert steps[name]["noise_psnr"] > 30
        assert steps[name]["within_noise"] == (steps[name]["rms"] ** 2 <= 1.5 * steps[name]["noise"] ** 2)
    assert sum(s["share"] for s in found["steps"]) == pytest.approx(1, abs=1e-9)
    assert sum(s["squared"] for s in found["steps"]) == pytest.approx(found["whole"]["squared"])
    pictures = sorted(p.name for p in explained.glob("*.png"))
    assert pictures == [f"{k:02d}-{name}.png" for k, name in enumerate(["engine", *steps])]


def test_the_report_shows_every_rung(page: Any, explained: Path) -> None:
    found = read(explained)
    names = [step["name"] for step in found["steps"]]
    for width, height, scheme in ((1280, 900, "light"), (390, 844, "dark")):
        page.open(explained / "explain.html", width, height, scheme)
        assert page.run("document.documentElement.scrollWidth") <= width
        assert page.complaints() == []
    assert page.run("[...document.querySelectorAll('[data-step]')].map(x => x.dataset.step)") == names
    shown = page.run("[...document.querySelectorAll('[data-step] [data-figure=share]')].map(x => x.innerText)")
    for text, step in zip(shown, found["steps"], strict=True):
        assert float(text.replace("−", "-").removesuffix(" %")) == pytest.approx(100 * step["share"], abs=0.051)
    noise = page.run("[...document.querySelectorAll('[data-step] [data-figure=noise]')].map(x => x.innerText)")
    for text, step in zip(noise, found["steps"], strict=True):
        assert (text == "–") == (step["noise"] is None)
        assert text.endswith("noise") == step["within_noise"]
    total = page.run("document.querySelector('tfoot [data-figure=share]').innerText")
    assert total == "+100.0 %"
    sizes = page.run("[...document.images].map(x => [x.naturalWidth, x.naturalHeight])")
    assert sizes == [[160, 120]] * (2 * len(names) + 4)  # a picture and a map for each rung, and the two compared

    # the viewer starts with both ends, and shows a step when asked
    same = "document.getElementById('picture-{}').src === document.getElementById('rung-{}').src"
    assert page.run(same.format("left", 0))
    assert page.run(same.format("right", len(names)))
    shadow = 1 + names.index("shadows")
    page.run(f"document.querySelector('button[data-rung=\"{shadow}\"]').click()")
    assert page.run(same.format("left", shadow - 1))
    assert page.run(same.format("right", shadow))
    assert page.run("document.getElementById('caption-right').innerText") == f"After {shadow}: Shadow maps"


def test_without_the_engine_it_says_so(
    job: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MIRELIGHT_BROWSER", str(tmp_path / "nowhere"))
    out = str(tmp_path / "out")
    quick = ["--set", "render.spp=4", "--set", "resolution_scale=0.5"]
    assert main(["explain", str(job), "-o", out, "--camera", "front", *quick]) == 0
    told = capsys.readouterr()
    assert "was not found" in told.err
    assert "prediction of the engine instead" in told.err
    assert "all together" in told.out
    found = read(tmp_path / "out")
    assert not found["really_rendered"]
    assert {"model", "shadows"} <= set(found["absent"])
    assert "the engine itself did not run" in (tmp_path / "out" / "explain.html").read_text()


def test_a_missing_package_is_said_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The job is not even opened: there is none."""
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    assert main(["explain", str(tmp_path / "gone.toml"), "-o", str(tmp_path / "out")]) != 0
    (told,) = capsys.readouterr().err.splitlines()
    assert "pip install 'mirelight[compare]'" in told
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (["--camera", "back"], "no camera named 'back'"),
        (["--set", "environment=no.hdr"], "no.hdr"),
        (["--set", "render.variant=scalar_rgb"], "render.variant: 'scalar_rgb'"),
    ],
)
def test_mistakes_are_one_line(
    job: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], change: list[str], expected: str
) -> None:
    assert main(["explain", str(job), "-o", str(tmp_path), "--no-engine", *change]) == 2
    told = capsys.readouterr().err
    assert expected in told
    assert "Traceback" not in told
