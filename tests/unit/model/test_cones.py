"""Cone laws of spots against their formulas written out, and lumens against sums over the sphere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.model import cones

ANGLES = [(0.0, math.pi / 4), (0.2, 0.6), (0.3, math.pi / 2), (0.5, 0.5005), (0.01, 0.02)]
COSINES = np.linspace(-1, 1, 20_001)


def smoothstep(low: float, high: float, x: NDArray[np.float64]) -> NDArray[np.float64]:
    t = np.clip((x - low) / (high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


@pytest.mark.parametrize(("inner", "outer"), ANGLES)
def test_the_engines_law_is_a_smoothstep_between_the_cosines(inner: float, outer: float) -> None:
    truth = smoothstep(math.cos(outer), math.cos(inner), COSINES)
    np.testing.assert_allclose(cones.share("playcanvas", inner, outer, COSINES), truth, atol=1e-9)


@pytest.mark.parametrize(("inner", "outer"), ANGLES)
def test_the_law_of_khr_is_squared(inner: float, outer: float) -> None:
    scale = 1 / max(0.001, math.cos(inner) - math.cos(outer))
    truth = np.clip((COSINES - math.cos(outer)) * scale, 0, 1) ** 2
    np.testing.assert_allclose(cones.share("khr", inner, outer, COSINES), truth, atol=1e-9)


@pytest.mark.parametrize("size", [5.0, 45.0, 120.0, 180.0])
@pytest.mark.parametrize("blend", [0.01, 0.15, 0.5, 1.0])
def test_a_spot_of_blender(size: float, blend: float) -> None:
    """Cycles: smoothstep((cos - c) / (blend (1 - c))), c the cosine of half the spot's size."""
    outer = math.radians(size) / 2
    c = math.cos(outer)
    t = np.clip((COSINES - c) / (blend * (1 - c)), 0, 1)
    inner = cones.of_blender(outer, blend)
    np.testing.assert_allclose(cones.share("playcanvas", inner, outer, COSINES), t * t * (3 - 2 * t), atol=2e-7)


def test_a_spot_of_blender_without_a_blend_has_a_hard_edge() -> None:
    outer = math.radians(30)
    inner = cones.of_blender(outer, 0.0)
    found = cones.share("playcanvas", inner, outer, np.cos([outer - 1e-4, outer + 1e-9]))
    assert found.tolist() == [1.0, 0.0]


def test_blenders_exporter_and_back() -> None:
    """It writes outer = size / 2 and inner = (1 - blend) size / 2."""
    outer = math.radians(37.5)
    assert cones.blend_of_export((1 - 0.35) * outer, outer) == pytest.approx(0.35)


@pytest.mark.parametrize("law", ["khr", "playcanvas"])
@pytest.mark.parametrize(("inner", "outer"), [*ANGLES, (0.0, 0.004), (1.57, math.pi / 2)])
def test_lumens_of_a_candela_are_the_sum_over_all_directions(law: cones.ConeLaw, inner: float, outer: float) -> None:
    """Also of cones too thin for their law to reach its full strength on the axis."""
    edges = np.linspace(math.cos(outer), 1, 400_001)
    middles = (edges[1:] + edges[:-1]) / 2
    truth = 2 * math.pi * float(cones.share(law, inner, outer, middles).sum() * (edges[1] - edges[0]))
    assert cones.solid_angle(law, inner, outer) == pytest.approx(truth, rel=1e-5)


def test_the_engines_own_formula_for_lumens() -> None:
    """PlayCanvas with physicalUnits divides a spot's luminance by 2 pi ((1 - cos i) + (cos i - cos o) / 2)."""
    i, o = math.radians(20), math.radians(35)
    theirs = 2 * math.pi * ((1 - math.cos(i)) + (math.cos(i) - math.cos(o)) / 2)
    assert cones.solid_angle("playcanvas", i, o) == pytest.approx(theirs, rel=1e-12)
