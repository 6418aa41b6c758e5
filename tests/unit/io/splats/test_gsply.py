"""The same files through gsply, an independent reader. The only test module that imports it (it is slow to load).

gsply gives log scales and logits (clipped at ±10) where ours are activated, and leaves SPZ in right-up-back axes.
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mirelight.io import splats
from mirelight.io.splats.values import axis_flips
from mirelight.model import SplatCloud

from . import truth
from .sog_v1 import pack_sog_v1

gsply = pytest.importorskip("gsply", reason="gsply comes with the test extra")


def activated(data: Any, *, spz: bool = False) -> SplatCloud:
    rest = (
        np.asarray(data.shN).reshape(len(data.means), -1, 3)
        if data.shN is not None
        else np.zeros((len(data.means), 0, 3))
    )
    sh = np.concatenate([np.asarray(data.sh0)[:, None], rest], axis=1).astype(np.float32)
    quats = np.array(data.quats, dtype=np.float32)
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    means = np.array(data.means, dtype=np.float32)
    if spz:
        flips = axis_flips((1, -1, -1), round(sh.shape[1] ** 0.5) - 1)
        means, quats, sh = means * flips.means, quats * flips.quats, sh * flips.sh
    opacities = (1 / (1 + np.exp(-np.asarray(data.opacities, dtype=np.float64).reshape(-1)))).astype(np.float32)
    return SplatCloud(means=means, quats=quats, scales=np.exp(data.scales), opacities=opacities, sh=sh)


def assert_same(found: SplatCloud, wanted: SplatCloud) -> None:
    np.testing.assert_allclose(found.means, wanted.means, atol=1e-5)
    np.testing.assert_allclose(found.scales, wanted.scales, rtol=1e-5)
    np.testing.assert_allclose(found.opacities, wanted.opacities, atol=5e-5)  # sigmoid(10)
    np.testing.assert_allclose(found.sh, wanted.sh, atol=1e-5)
    assert truth.rotation_angle(found.quats, wanted.quats).max() < 2e-3


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_ply(tmp_path: Path, degree: int) -> None:
    path = tmp_path / "a.ply"
    splats.write(truth.cloud(50, degree), path)
    assert_same(splats.read(path), activated(gsply.plyread(path)))


def test_compressed_ply() -> None:
    path = truth.DATA / "cloud.compressed.ply"
    assert_same(splats.read(path), activated(gsply.plyread(path)))


def test_our_compressed_ply(tmp_path: Path) -> None:
    path = tmp_path / "a.compressed.ply"
    splats.write(truth.cloud(300, 2), path)
    assert_same(splats.read(path), activated(gsply.plyread(path)))


@pytest.mark.parametrize("name", ["cloud_v2.spz", "cloud_v3.spz", "cloud_v4.spz"])
def test_spz(name: str) -> None:
    path = truth.DATA / name
    assert_same(splats.read(path), activated(gsply.read_spz(path), spz=True))


def test_our_spz(tmp_path: Path) -> None:
    path = tmp_path / "a.spz"
    splats.write(truth.cloud(100, 2), path)
    assert_same(splats.read(path), activated(gsply.read_spz(path), spz=True))


@pytest.mark.parametrize("version", [1, 2])
def test_sog(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, version: int) -> None:
    from gsply import sog_reader

    monkeypatch.setattr(sog_reader, "_load_webp_image", load_webp)
    path = pack_sog_v1(truth.cloud(60, 2), tmp_path) if version == 1 else truth.DATA / "small.sog"
    assert_same(splats.read(path), activated(sog_reader.sogread(path)))


def load_webp(data: bytes) -> tuple[NDArray[np.uint8], int, int]:
    """In place of imagecodecs, which gsply would need: the oracle is its arithmetic, not its images."""
    with Image.open(BytesIO(data)) as image:
        pixels = np.asarray(image.convert("RGBA"))
    return pixels.reshape(-1), pixels.shape[1], pixels.shape[0]


def test_the_guitar_capture(shared: Path) -> None:
    path = shared / "realtime" / "assets" / "guitar.compressed.ply"
    found = splats.read(path)
    assert (len(found), found.sh_degree, found.dropped) == (90854, 0, 0)
    assert_same(found, activated(gsply.plyread(path)))


@pytest.mark.parametrize("name", ["synth_sh0.ply", "synth_sh3.ply", "synth_stack.ply"])
def test_the_engines_synthetic_splats(shared: Path, name: str) -> None:
    path = shared / "realtime" / "assets" / name
    assert_same(splats.read(path), activated(gsply.plyread(path)))
