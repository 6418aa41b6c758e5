"""Colour spaces by their primaries, against OpenColorIO."""

from __future__ import annotations

import numpy as np
import PyOpenColorIO
import pytest

from mirelight.base.primaries import (
    PRIMARIES,
    REC709,
    ColorSpace,
    acescct_decoded,
    acescct_encoded,
    are_usable,
    conversion,
    name_of,
)

NAMES: dict[ColorSpace, str] = {
    "lin_rec709": "Linear Rec.709 (sRGB)",
    "ACEScg": "ACEScg",
    "ACES2065-1": "ACES2065-1",
    "lin_p3d65": "Linear P3-D65",
}


@pytest.mark.parametrize("space", PRIMARIES)
def test_matrices_are_those_of_opencolorio(space: ColorSpace) -> None:
    config = PyOpenColorIO.Config.CreateFromBuiltinConfig("studio-config-latest")
    processor = config.getProcessor(NAMES[space], NAMES["lin_rec709"]).getDefaultCPUProcessor()
    theirs = np.array([processor.applyRGB(unit) for unit in np.eye(3).tolist()]).T
    assert np.allclose(conversion(PRIMARIES[space], REC709), theirs, rtol=0, atol=2e-7)
    assert np.allclose(conversion(PRIMARIES[space], REC709) @ np.ones(3), 1, rtol=0, atol=1e-12)
    assert name_of(np.asarray(PRIMARIES[space], np.float32).tolist()) == space


def test_the_log_encoding_is_that_of_opencolorio() -> None:
    config = PyOpenColorIO.Config.CreateFromBuiltinConfig("studio-config-latest")
    processor = config.getProcessor("ACEScct", NAMES["lin_rec709"]).getDefaultCPUProcessor()
    values = np.random.default_rng(0).uniform(0, 1, (200, 3)).astype(np.float32)
    theirs = np.array([processor.applyRGB(x) for x in values.tolist()])
    assert np.allclose(
        acescct_decoded(values), theirs, rtol=2e-4, atol=1e-4 * np.abs(theirs).max(axis=1, keepdims=True)
    )
    assert np.allclose(acescct_encoded(acescct_decoded(values)), values, rtol=0, atol=1e-4)


def test_what_cannot_be_primaries() -> None:
    assert are_usable(REC709)
    assert name_of((0.7, 0.3, *REC709[2:])).startswith("R 0.7 0.3, G 0.3 0.6")
    for bad in ((), (0.3,) * 8, (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.7, 0.3), (*REC709[:7], 0.0)):
        assert not are_usable(bad)
