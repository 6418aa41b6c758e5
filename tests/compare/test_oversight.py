"""Pictures that suffered something on their way into a file: said in words, and not where they merely differ."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mirelight.base import colour
from mirelight.compare import CompareSettings, Pair, compare, evaluate, summary
from mirelight.compare.types import Pairing
from mirelight.io.exr import write_exr
from mirelight.model import F32

H, W = 150, 210  # no multiple of the thumbnails' blocks


def scene(seed: int = 1) -> F32:
    """(H, W, 3) display values of warm boxes with hard edges, brighter above than below."""
    rng = np.random.default_rng(seed)
    picture = np.full((H, W, 3), 0.3, np.float32)
    for _ in range(60):
        top, left = rng.integers(0, H - 20), rng.integers(0, W - 20)
        height, width = rng.integers(8, 50, 2)
        picture[top : top + height, left : left + width] = rng.uniform(0.05, 0.8) * rng.uniform((0.8, 0.6, 0.2), 1)
    return np.asarray(picture * np.linspace(1.2, 0.8, H)[:, None, None], np.float32)


def clear() -> F32:
    """(H, W, 1) an alpha that falls from left to right."""
    return np.asarray(np.broadcast_to(np.linspace(1, 0.1, W)[None, :, None], (H, W, 1)), np.float32)


def other_light(picture: F32) -> F32:
    """The scene lit from the left, warmer."""
    return np.asarray(picture * np.linspace(1.3, 0.3, W)[None, :, None] * (1.0, 0.8, 0.6), np.float32)


@pytest.fixture
def save(tmp_path: Path) -> Callable[[F32, str], Path]:
    """save(picture, name): an 8-bit PNG."""

    def to_file(picture: F32, name: str) -> Path:
        path = tmp_path / f"{name}.png"
        Image.fromarray(np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)).save(path)
        return path

    return to_file


def remark(reference: Path, test: Path, **settings: Any) -> str:
    return evaluate(Pair(name="pair", reference=reference, test=test), CompareSettings(**settings))[0].remark


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda x: x[::-1], "upside down"),
        (lambda x: x[:, ::-1], "mirrored"),
        (lambda x: x[::-1, ::-1], "180 degrees"),
        (lambda x: x[..., ::-1], "red and blue"),
        (lambda x: other_light(x)[::-1], "upside down"),
        (lambda x: other_light(x)[:, ::-1], "mirrored"),
        (lambda x: colour.srgb_encode(x), "twice"),
        (lambda x: x ** (1 / 2.2), "twice"),
        (lambda x: colour.srgb_decode(x), "linear light"),
        (lambda x: colour.srgb_encode(colour.srgb_decode(x) / 4), "0.25 times its light (--fit-gain"),
        (lambda x: x, ""),
        (other_light, ""),
        (lambda x: np.clip(x + np.random.default_rng(0).normal(0, 0.1, x.shape), 0, 1), ""),
        (lambda _: scene(2), ""),
        (lambda x: 0 * x, ""),
    ],
)
def test_what_a_picture_suffered(save: Any, made: Callable[[F32], F32], said: str) -> None:
    picture = scene()
    found = remark(save(picture, "a"), save(made(picture), "b"))
    assert said in found and bool(said) == bool(found)


def test_alpha_that_was_multiplied_already(save: Any) -> None:
    picture, alpha = scene(), clear()
    straight = save(np.concatenate([picture, alpha], -1), "straight")
    over = save(np.concatenate([picture * alpha, alpha], -1), "over")
    black = save(picture * alpha, "reference")
    assert "--premultiplied says so" in remark(black, over)
    assert "without --premultiplied" in remark(black, straight, premultiplied=True)
    assert not remark(black, straight) and not remark(black, over, premultiplied=True)


def test_an_exr_of_display_values(save: Any, tmp_path: Path) -> None:
    picture = scene()
    write_exr(tmp_path / "b.exr", {name: np.ascontiguousarray(picture[..., k]) for k, name in enumerate("RGB")}, {})
    assert "an EXR holds linear light" in remark(save(picture, "a"), tmp_path / "b.exr")


def test_it_stands_below_the_table_in_the_report_and_in_the_json(save: Any, tmp_path: Path) -> None:
    picture = scene()
    pair = Pair(name="front", reference=save(picture, "a"), test=save(picture[::-1], "b"))
    outcome = compare(Pairing(pairs=(pair,)), html=tmp_path / "r.html", json=tmp_path / "r.json")
    assert "front: the test looks upside down" in summary(outcome)
    assert "the test looks upside down" in (tmp_path / "r.html").read_text()
    assert '"remark": "the test looks upside down' in (tmp_path / "r.json").read_text()


@pytest.mark.parametrize("size", [(1, 1), (1, 300), (300, 2), (65, 64)])
def test_pictures_of_any_size(save: Any, size: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    one = rng.random((*size, 3), dtype=np.float32)
    assert isinstance(remark(save(one, "a"), save(1 - one, "b")), str)
