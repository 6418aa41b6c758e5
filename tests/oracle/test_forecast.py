"""The seconds that a dry run says, against a clock of the test's own that goes on by a law in every stage."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import mirelight
from mirelight import store
from mirelight.batch import forecast as forecasting
from mirelight.model.exposure import Exposure
from mirelight.pipeline import stages
from mirelight.pipeline.plan import plan
from tests.oracle.test_dataset_view import JOB, make_scene

LENS = Exposure(aperture_radius=0.1, focus_distance=4.0)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stages that take no time but what a law says; the first of each, which compiles, takes long."""
    now = 0.0
    first = dict.fromkeys(("composite", "light", "relight", "write"), 1000.0)

    def after(name: str, seconds: Any, own: Any) -> Any:
        def stage(*given: Any, **named: Any) -> Any:
            nonlocal now
            found = own(*given, **named)
            now += seconds(*given, found) + first.pop(name, 0)
            return found

        return stage

    def pixels(camera: Any) -> int:
        return int(camera.width * camera.height)

    def traced(scene: Any, camera: Any, _lighting: Any, _found: Any) -> float:
        return 0.25 + pixels(camera) * (2e-5 + 3e-5 * int(scene.job.render.spp))

    laws = {
        "composite": lambda _scene, camera, _found: 0.5 + 1e-6 * pixels(camera),
        "light": traced,
        "relight": lambda _scene, _splats, _lit, found: 0.01 + 4e-6 * pixels(found.camera),
    }
    for name, law in laws.items():
        monkeypatch.setattr(stages, name, after(name, law, getattr(stages, name)))
    written = after("write", lambda frame, *_: 5e-6 * pixels(frame.camera), store.write)
    monkeypatch.setattr(forecasting, "write", written)
    monkeypatch.setattr(forecasting, "time", SimpleNamespace(perf_counter=lambda: now))


@pytest.mark.parametrize(("lens", "spp", "size"), [*itertools.product((False, True), (2, 64), ((480, 320), (64, 48)))])
def test_seconds_follow_what_grows_with_pixels_and_what_does_not(
    lens: bool, spp: int, size: tuple[int, int], tmp_path: Path, clock: None
) -> None:
    make_scene(tmp_path)
    text = JOB.replace("[24, 16]", str(list(size))).replace('captured = "day"\n', "") + '[relight]\nmode = "tint"\n'
    (tmp_path / "job.toml").write_text(text)
    job = mirelight.load(tmp_path / "job.toml")
    camera = replace(job.cameras[0], exposure=LENS if lens else None)
    render = replace(job.render, spp=spp, lens_samples=4)
    job = replace(job, cameras=(camera,), lightings=job.lightings[:1], render=render)
    pixels = size[0] * size[1]
    of_pinholes = 4 + 1 if lens else 1
    samples = spp * (1 + 1 / 4 if lens else 1)  # four shares, and a quarter for the middle
    composite, relight = 0.5 + 1e-6 * pixels, 0.01 + 4e-6 * pixels
    light = of_pinholes * (0.25 + 2e-5 * pixels) + 3e-5 * pixels * samples
    expected = of_pinholes * (composite + relight) + light + 2 * 5e-6 * pixels  # an EXR and a PNG
    assert forecasting.forecast(plan(job)).seconds == pytest.approx(expected)


def test_nothing_takes_less_than_no_time() -> None:
    """However badly it is measured."""
    for short, long, each in itertools.product((0.0, 1.0, 5.0), (0.0, 1.0, 30.0), (0.0, 0.001, 1.0)):
        made = forecasting._Seconds.between(100, 400, short, long, 4, each)
        assert min(made.fixed, made.pixel, made.sample) >= 0
        assert made.of(100, 4) == pytest.approx(short)
