"""A stage of OpenUSD as a job, and the stage that is written of what it rendered: the same bits from both."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirelight.cli import main
from mirelight.io.exr import read_exr
from tests.unit.io.usd.checking import faults

pytest.importorskip("pxr")
from tests.fuzzing.stages import HEAD, MESH, SPLATS

_LIT = """def SphereLight "lamp"
{
    float inputs:intensity = 500
    float inputs:radius = 0.2
    double3 xformOp:translate = (1, 1.5, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def DomeLight "sky"
{
    color3f inputs:color = (0.3, 0.4, 0.6)
}
def Camera "view"
{
    float focalLength = 31.7
    float fStop = 22
    float focusDistance = 5.3
    float2 clippingRange = (0.1, 100)
    double3 xformOp:translate = (0, 0.7, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


def test_a_stage_renders_as_it_is_and_its_export_renders_the_same_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pxr import Usd, UsdRender

    monkeypatch.chdir(tmp_path)
    flat = SPLATS.replace("(0, 0, 0), (1, 0, 0), (0, 0, 1)", "(0, -1, 0), (1, -1, 0), (0, -1, 1)")
    Path("stage.usda").write_text(HEAD + flat.replace("(1, 1, 1)", "(0.9, 0.6, 0.9)") + MESH + _LIT)
    few = ("--set=resolution=[24, 16]", "--spp=1", "--set=render.lens_samples=4", "--no-denoise", "-q")
    assert main(["render", "stage.usda", *few, "-o", "out"]) == 0
    assert main(["export", "out", "--layout", "usd", "-o", "out/again.usda", "-q"]) == 0
    assert main(["render", "out/again.usda", *few, "-o", "second"]) == 0
    first, second = (read_exr(Path(folder) / "view.stage.exr").channels for folder in ("out", "second"))
    assert first["A"].max() > 0.2 and first["R"].max() > 0 and first.keys() == second.keys()
    for name, values in first.items():
        np.testing.assert_array_equal(second[name], values, err_msg=name)

    assert faults(Path("out/again.usda")) == []
    stage = Usd.Stage.Open("out/again.usda")
    (product,) = [UsdRender.Product(x) for x in stage.Traverse() if x.IsA(UsdRender.Product)]
    assert (tmp_path / "out" / product.GetProductNameAttr().Get()).is_file()
    assert product.GetCameraRel().GetTargets() == ["/World/cameras/view"]
