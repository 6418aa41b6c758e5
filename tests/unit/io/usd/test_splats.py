"""Splats of OpenUSD stages: every attribute and its half variant, axes and units, and back bit for bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io import splats
from tests.unit.io.splats import truth

pytest.importorskip("pxr")

HEAD = '#usda 1.0\n(\n    metersPerUnit = {unit}\n    upAxis = "{up}"\n)\n'
ONE = """def ParticleField3DGaussianSplat "dots"
{{
    uniform int radiance:sphericalHarmonicsDegree = 0
    point3{h}[] positions{s} = [(1, 2, 3), (4, 5, 6)]
    quat{h}[] orientations{s} = [(0.5, 0.5, 0.5, 0.5), (1, 0, 0, 0)]
    {t}3[] scales{s} = [(1, 2, 3), (0.5, 0.5, 0.25)]
    {t}[] opacities{s} = [0.5, 1]
    {t}3[] radiance:sphericalHarmonicsCoefficients{s} = [(0.25, 0.5, 0.75), (1, 2, -1)]
}}
"""


def stage(folder: Path, body: str, unit: float = 1, up: str = "Y") -> Path:
    path = folder / "stage.usda"
    path.write_text(HEAD.format(unit=unit, up=up) + body)
    return path


@pytest.mark.parametrize("suffix", [".usda", ".usdz"])
def test_ply_to_stage_to_ply_is_equal_in_every_bit(tmp_path: Path, suffix: str) -> None:
    names, rows = truth.inria_rows(truth.cloud(200))
    (tmp_path / "in.ply").write_bytes(truth.ply_bytes(names, rows))
    cloud = splats.read(tmp_path / "in.ply")
    splats.write(cloud, tmp_path / "direct.ply")
    splats.write(cloud, tmp_path / f"on{suffix}")
    splats.write(splats.read(tmp_path / f"on{suffix}"), tmp_path / "back.ply")
    assert (tmp_path / "back.ply").read_bytes() == (tmp_path / "direct.ply").read_bytes()


@pytest.mark.parametrize(("half", "suffix", "kind"), [("f", "", "float"), ("h", "h", "half")])
def test_every_attribute_in_float_and_in_half(tmp_path: Path, half: str, suffix: str, kind: str) -> None:
    cloud = splats.read(stage(tmp_path, ONE.format(h=half, s=suffix, t=kind)))
    np.testing.assert_array_equal(cloud.means, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(cloud.quats, [[0.5, 0.5, 0.5, 0.5], [1, 0, 0, 0]])
    np.testing.assert_array_equal(cloud.scales, [[1, 2, 3], [0.5, 0.5, 0.25]])
    np.testing.assert_array_equal(cloud.opacities, [0.5, 1])
    np.testing.assert_array_equal(cloud.sh[:, 0], [[0.25, 0.5, 0.75], [1, 2, -1]])


def test_units_and_axes_become_metres_and_y_up(tmp_path: Path) -> None:
    cloud = splats.read(stage(tmp_path, ONE.format(h="f", s="", t="float"), unit=0.01, up="Z"))
    np.testing.assert_allclose(cloud.means[0], [0.01, 0.03, -0.02], rtol=1e-6)
    np.testing.assert_allclose(cloud.scales[1], [0.005, 0.005, 0.0025], rtol=1e-6)


def test_what_is_not_given_has_the_schemas_defaults(tmp_path: Path) -> None:
    body = 'def ParticleField3DGaussianSplat "p" {\npoint3f[] positions = [(0, 0, 0)]\nfloat[] opacities = []\n}'
    cloud = splats.read(stage(tmp_path, body))
    np.testing.assert_array_equal(cloud.scales, [[1, 1, 1]])
    np.testing.assert_array_equal(cloud.opacities, [1])
    np.testing.assert_array_equal(cloud.sh, np.zeros((1, 16, 3)))


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ('def Xform "a" {}', "no splats in it"),
        ("nonsense", "USD"),
        ('def "a" (references = @/etc/hostname@) {}', "outside of its folder and of no kind"),
        ('def "a" (references = @../none.usda@) {}', "there is no file '../none.usda'"),
        ('def ParticleField3DGaussianSplat "p" {\npoint3f[] positions = [(nan, 0, 0)]\n}', "all 1 splats"),
        (
            'def ParticleField3DGaussianSplat "p" {\nuniform int radiance:sphericalHarmonicsDegree = 9\n'
            "point3f[] positions = [(0, 0, 0)]\n}",
            "/p: spherical harmonics of degree 9",
        ),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(tmp_path: Path, body: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        splats.read(stage(tmp_path, body))


def test_a_stage_says_the_colour_space_and_the_order(tmp_path: Path) -> None:
    linear = replace(truth.cloud(20), color_space="lin_rec709_display")
    splats.write(linear, tmp_path / "light.usda")
    info = splats.summary(tmp_path / "light.usda")
    assert (info.color_space, info.sort) == ("lin_rec709_display", "depth")
    found = splats.read(tmp_path / "light.usda")
    assert found.color_space == "lin_rec709_display"
    np.testing.assert_array_equal(found.sh, linear.sh)
    text = (tmp_path / "light.usda").read_text()
    (tmp_path / "far.usda").write_text(text.replace('"zDepth"', '"cameraDistance"'))
    assert splats.summary(tmp_path / "far.usda").sort == "radial"
