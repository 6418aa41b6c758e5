"""How much of the light a sun brings where it falls: by that weak suns, which clouds have none of, are told."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mirelight.estimate.descent import NO_LAMPS, Found
from mirelight.estimate.fit import Fitted
from mirelight.estimate.sky import PATCHES
from mirelight.estimate.sun import Sun
from mirelight.estimate.transport import Places
from mirelight.estimate.which_sun import sun_share
from mirelight.model import F64
from tests.oracle.test_estimate_groups import floor

UP = np.array([0.0, 1.0, 0.0])


def _mostly_in_shadow() -> Places:
    """A floor under an open sky, of which a tenth sees the sun."""

    def blocked(origins: F64, _: F64) -> Any:
        return origins[:, 0] > 0.1

    no_lamps = np.zeros(0)
    sight: Any = SimpleNamespace(sight=SimpleNamespace(blocked=blocked, first_hits=lambda *_: (no_lamps, no_lamps)))
    return replace(floor(np.ones(1200), np.zeros((1200, 3)), 2), close=sight)


@pytest.mark.parametrize("strength", [0.05, 0.25, 4.0])
def test_a_sun_is_weighed_where_it_falls_however_little_that_is(strength: float) -> None:
    sun = Sun(UP, 0.27, np.zeros(0), 0.0, (0.35, 0.45))
    light = Fitted(np.ones((PATCHES, 3)), np.full((1, 3), strength), 0.0)
    share = sun_share(_mostly_in_shadow(), Found(sun, NO_LAMPS, light))
    assert share == pytest.approx(strength / (1 + strength), rel=0.02)


def test_without_a_sun_it_brings_nothing() -> None:
    light = Fitted(np.ones((PATCHES, 3)), np.zeros((0, 3)), 0.0)
    assert sun_share(_mostly_in_shadow(), Found(None, NO_LAMPS, light)) == 0
