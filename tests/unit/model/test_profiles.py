"""What the profiles decide has one home: no other module asks for a profile or a mode by its name."""

from __future__ import annotations

import re
from pathlib import Path

from mirelight import relighting
from mirelight.model import CompositorSettings
from mirelight.model.profiles import COLOURING, COMPARING

PACKAGE = Path(__file__).resolve().parents[3] / "mirelight"
ASKS = re.compile(r"""(?<!image\.)\b(?:mode|profile) (?:==|!=) ["']|\b(?:mode|profile) (?:not )?in \(["']""")


def test_modes_that_must_know_the_captured_light_are_those_that_say_so() -> None:
    assert {name for name, mode in relighting.MODES.items() if mode.needs_captured} == COMPARING
    assert {name for name, mode in relighting.MODES.items() if mode.uses_proxy_colours} >= COLOURING


def test_no_module_asks_for_a_profile_or_a_mode_by_name() -> None:
    asking = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if ASKS.search(path.read_text(encoding="utf-8"))
    }
    assert not asking


def test_what_only_the_engine_has_does_nothing_in_the_physical_profile() -> None:
    engine = CompositorSettings(profile="playcanvas", linear=True, eight_bit=True, tone="aces")
    assert (engine.blends_linear, engine.tones_splats, engine.rounds) == (True, False, True)
    assert CompositorSettings(profile="playcanvas", tone="aces").tones_splats
    physical = CompositorSettings(profile="physical", linear=True, eight_bit=True, tone="aces")
    assert (physical.blends_linear, physical.tones_splats, physical.rounds) == (False, False, False)
