"""scenes/plinth, a capture as people have it: its cameras are its splats' own, and its frames come close to the truth.

Its proxy takes minutes to make; here the true surface stands for it.
"""

from __future__ import annotations

import importlib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mirelight.base import colour
from mirelight.compositor import Compositor
from mirelight.io import cameras, job
from mirelight.lighting import Tracer
from mirelight.model import Job, Lighting, LightingBuffer, ProxyMesh, RelightSettings, RenderSettings, SunLight
from mirelight.relighting import apply, unlit_rgba

SCENE = Path(__file__).parents[2] / "scenes" / "plinth"
BLOCKS = 80, 45  # averaged in linear light before comparing, against the noise of both sides
FURTHER = 3.0  # dB by which frames must be closer to the truth than tint and capture
WRONG_SUN = 3.0  # degrees

Pixels = NDArray[np.float32]


@cache
def scene() -> Job:
    return job.load(SCENE / "job.toml")


@cache
def recipe() -> Any:
    return importlib.import_module("trained_scene").recipe()


@cache
def tracer() -> Tracer:
    corners = np.concatenate([s.positions for s in recipe().looks().soups]).reshape(-1, 3)
    faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    return Tracer(ProxyMesh(vertices=corners.astype(np.float32), faces=faces), RenderSettings(spp=16, seed=1))


@cache
def traced(name: str) -> LightingBuffer:
    return tracer().trace(light(name), scene().cameras[0].resized(160, 90))


def light(name: str) -> Lighting:
    loaded = scene()
    assert loaded.captured is not None
    return loaded.captured if name == "captured" else next(x for x in loaded.lightings if x.name == name)


def shown(linear: Pixels) -> Pixels:
    """(45, 80, 3) display values of averages over blocks of linear light (H, W, 3 or more)."""
    columns, rows = BLOCKS
    height, width, _ = linear.shape
    small = linear[..., :3].reshape(rows, height // rows, columns, width // columns, 3).mean(axis=(1, 3))
    return np.asarray(colour.srgb_encode(np.clip(small, 0, 1)), np.float32)


def truth(name: str) -> Pixels:
    with Image.open(SCENE / "truth" / f"front.{name}.png") as image:
        return shown(np.asarray(colour.srgb_decode(np.asarray(image.convert("RGB"), np.float32) / 255)))


def psnr(a: Pixels, b: Pixels) -> float:
    return float(-10 * np.log10(np.mean((a - b) ** 2)))


def test_cameras_are_those_of_the_splats() -> None:
    """They are the recipe's, and one of them shows what is truly there."""
    loaded, made_of = scene(), recipe()
    assert loaded.splats is not None
    placed = cameras.open_file(SCENE / "transforms.json").read()
    assert len(placed) == len(made_of.orbit)
    for read, known in zip(placed, made_of.orbit, strict=True):
        np.testing.assert_allclose(read.world_from_camera, known.world_from_camera, atol=1e-6)
    one = made_of.orbit[7]
    small = one.resized(120, 80)  # of the capture as it is: splats come out too wide where pictures are smaller
    seen = unlit_rgba(Compositor(loaded.splats.value).composite(one)).reshape(80, 4, 120, 4, 4).mean(axis=(1, 3))
    true = importlib.import_module("scenegen.truth").Truth(made_of.looks(), made_of.captured).picture(small, spp=16)
    there = true[..., 3] > 0.99
    sides = (np.asarray(colour.srgb_encode(np.clip(x[there][:, :3], 0, 1))) for x in (seen, true))
    assert psnr(*sides) > 20


def test_the_sun_that_was_found_stands_where_it_stood() -> None:
    found, true = (
        next(x for x in one.lights if isinstance(x, SunLight)) for one in (light("captured"), recipe().captured)
    )
    assert found.direction @ true.direction > np.cos(np.radians(WRONG_SUN))


@pytest.mark.parametrize("name", ["evening", "clouds", "lamp"])
def test_frames_are_far_closer_to_the_truth_than_tint_and_capture(name: str) -> None:
    loaded = scene()
    assert loaded.splats is not None
    splats, true = Compositor(loaded.splats.value).composite(loaded.cameras[0]), truth(name)
    there = shown(np.repeat(traced(name).coverage[..., None], 3, axis=2)).min(axis=2) > 0.999  # no sky
    relit, tint = (
        apply(
            splats, traced(name), RelightSettings(mode=mode), captured=traced("captured") if mode == "ratio" else None
        )
        for mode in ("ratio", "tint")
    )
    scores = [psnr(shown(x)[there], true[there]) for x in (relit.rgba, tint.rgba, unlit_rgba(splats))]
    assert scores[0] > max(scores[1:]) + FURTHER, scores


def test_it_stays_small() -> None:
    assert sum(x.stat().st_size for x in SCENE.rglob("*") if x.is_file()) < 4_000_000
