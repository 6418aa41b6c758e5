"""What lobes reflect, added to a frame: the formula on buffers made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight import relighting
from mirelight.model import F32

from .test_relight import RATIO, lit, splat_layer

FRAME = relighting.apply(splat_layer(), lit(0.4), RATIO, captured=lit(0.2), captured_level=0.1)
MATT = np.zeros_like(lit(0.0).albedo)


@pytest.mark.parametrize("blend", [1.0, 0.25])
def test_a_lobe_is_added_and_the_captured_one_taken_out(blend: float) -> None:
    new, old = replace(lit(0.3, coverage=0.5), albedo=MATT), replace(lit(0.02, coverage=0.5), albedo=MATT)
    settings = replace(RATIO, blend=blend)
    a = FRAME.rgba[..., 3:]
    assert FRAME.unlit is not None and FRAME.noise is not None
    plain = relighting.with_lobes(FRAME, new, settings)
    np.testing.assert_allclose(plain.rgba[..., :3], FRAME.rgba[..., :3] + blend * a * 0.3, rtol=1e-5)
    np.testing.assert_array_equal(plain.rgba[..., 3], FRAME.rgba[..., 3])
    assert plain.noise is not None
    np.testing.assert_allclose(plain.noise, np.hypot(FRAME.noise, blend * a * 0.4), rtol=1e-5)  # 0.2 over half a pixel
    made = relighting.with_lobes(FRAME, new, settings, old).rgba[..., :3]
    capture: F32 = FRAME.unlit[..., :3]
    rest = np.where(capture > 0, np.maximum(1 - a * 0.02 / np.where(capture > 0, capture, 1), 0), 1)
    expected = FRAME.rgba[..., :3] * (1 - blend * (1 - rest)) + blend * a * 0.3
    np.testing.assert_allclose(made, expected, rtol=1e-4, atol=1e-7)


def test_a_metal_has_no_colour_but_its_lobe_and_matt_parts_stay_as_they_are() -> None:
    metal = replace(lit(0.3), albedo=np.ones_like(MATT))
    made = relighting.with_lobes(FRAME, metal, RATIO)
    np.testing.assert_allclose(made.rgba[..., :3], 0.3 * FRAME.rgba[..., 3:] * np.ones(3), rtol=1e-5)
    dark = replace(lit(0.0), albedo=MATT)
    np.testing.assert_array_equal(relighting.with_lobes(FRAME, dark, RATIO, dark).rgba, FRAME.rgba)
    elsewhere = replace(lit(0.3, coverage=0.0), albedo=MATT)
    np.testing.assert_array_equal(relighting.with_lobes(FRAME, elsewhere, RATIO).rgba, FRAME.rgba)
