"""What a proxy is judged by, cut down: judging takes most of what a toy costs."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from dataclasses import replace

import pytest

from mirelight.proxy.mesh_tuning import MESH

OF_TOYS = replace(MESH, judge_views=4, judge_waves=1)


@pytest.fixture(autouse=True, scope="module")
def _judged_by_few_views(request: pytest.FixtureRequest) -> Iterator[None]:
    """In all modules but that which tests the judge."""
    with pytest.MonkeyPatch.context() as patch:
        if not request.module.__name__.endswith("test_judge"):
            patch.setattr(importlib.import_module("mirelight.proxy.judge"), "MESH", OF_TOYS)
        yield
