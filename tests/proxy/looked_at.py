"""Many meshes are judged against the same splats: what these show from a side is found once."""

from __future__ import annotations

import importlib
from functools import cache

import pytest

from mirelight.model import Camera
from mirelight.model.digests import digest
from mirelight.proxy.depth import DepthMap, DepthMaps


def once(patch: pytest.MonkeyPatch) -> None:
    """While patched, judging keeps what it finds of splats, by identity, and of their views."""
    judging = importlib.import_module("mirelight.proxy.judge")
    look, views = DepthMaps.of, dict[tuple[int, str], DepthMap]()

    def of(maps: DepthMaps, camera: Camera) -> DepthMap:
        key = id(maps), digest(camera)  # maps are kept, as below
        if key not in views:
            views[key] = look(maps, camera)
        return views[key]

    for name in ("look_at_capture", "DepthMaps", "slanted"):
        patch.setattr(judging, name, cache(getattr(judging, name)))
    patch.setattr(DepthMaps, "of", of)
