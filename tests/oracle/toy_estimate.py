"""What decides an estimate, cut down for toys: few rays and candidates tell as much of a plain scene."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mirelight.estimate import descent, fit, lamps, solve, sun, transport, which_sun
from mirelight.estimate.tuning import TUNING

TOY = replace(TUNING, place_rays=96, sun_directions=2500, sun_tried=300, lamp_candidates=700, lamp_tried=200)
ROUGH = replace(TOY, fit_steps=15, searched=200)  # of estimates that need not be right


def of_toys(patch: pytest.MonkeyPatch, *, rough: bool = False) -> None:
    """Estimates are made so, until the patch is undone; rough ones, where it counts that they are the same."""
    for module in (descent, fit, lamps, solve, sun, transport, which_sun):
        patch.setattr(module, "TUNING", ROUGH if rough else TOY)
