"""The garbage collector waits while a kernel is recorded, and a scene leaves nothing for it to find."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path

import pytest

from mirelight.base.machine import collector_held
from mirelight.io import job
from mirelight.pipeline.scene import prepare

ROOT = Path(__file__).resolve().parents[3]


def test_the_collector_waits_and_comes_back() -> None:
    assert gc.isenabled()
    with pytest.raises(ValueError, match="inside"), collector_held():
        assert not gc.isenabled()
        with collector_held():
            pass
        assert not gc.isenabled()
        raise ValueError("inside")
    assert gc.isenabled()


def test_a_scene_ends_when_nobody_holds_it() -> None:
    """Without waiting for the collector, which may come while a kernel is recorded."""
    work = job.load(ROOT / "scenes" / "stage" / "job.toml")
    with collector_held():
        scene = prepare(work)
        view = scene.view_light(work.cameras[0])
        ended = weakref.ref(scene)
        assert scene.view_light(work.cameras[0]) is view
        del scene
        assert ended() is None
