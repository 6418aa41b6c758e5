"""Against an independent port of the 3DGS CUDA rasteriser: tiles of 16, squares of 3 sigma, float32."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from mirelight.compositor import composite
from mirelight.model import Camera

from .compositor_clouds import cloud, psnr

SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture(scope="module")
def port() -> ModuleType:
    """The benchmark's Numba kernel."""
    pytest.importorskip("numba", reason="the port of the CUDA kernel needs numba")
    return importlib.import_module("bench.numba_tiles")


def test_the_picture_of_the_cuda_kernel(port: ModuleType) -> None:
    camera = Camera.look_at((2.8, 0.6, 2.9), (-1, -0.3, -0.6), 320, 200, yfov=60, near=0.2)
    splats = cloud(3000, degree=2, size=0.1)
    # An opacity below 255⁻¹ e^4.5 = 0.35 has no alpha above the clip beyond 3 sigma, where the port's squares end
    faint = replace(splats, opacities=splats.opacities * np.float32(0.35))
    image, blended = port.rasterise(port.prepare(faint), camera)
    layer = composite(faint, camera)
    assert blended > 100_000
    assert psnr(image[..., :3], layer.color) > 90
    assert psnr(image[..., 3], layer.transmittance) > 90
    # with opaque splats the squares show, a little
    image, _ = port.rasterise(port.prepare(splats), camera)
    assert 45 < psnr(image[..., :3], composite(splats, camera).color) < 90


def test_the_benchmark_runs(port: ModuleType, tmp_path: Path) -> None:
    file = tmp_path / "out.json"
    command = [sys.executable, str(SCRIPTS / "bench"), "compositor", "--quick", "--json", str(file)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert run.returncode == 0, run.stderr
    assert "| room | 100,000 |" in run.stdout
    (section,) = json.loads(file.read_text())["sections"]
    assert section["command"] == "python scripts/bench compositor --quick"
    (found,) = section["blocks"]
    (row,) = (dict(zip(found["columns"], row, strict=True)) for row in found["rows"])
    assert float(row["fragments"].split()[0]) > 1 and float(row["ns / fragment"]) > 0 and float(row["whole frame"]) > 0
