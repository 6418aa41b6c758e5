"""The table of layers and AOVs holds every picture that the result types have, once."""

from __future__ import annotations

from dataclasses import fields
from typing import get_args, get_type_hints

import numpy as np
import pytest

from mirelight.model import F32, Frame, LightingBuffer, LightLayer, SplatLayer
from mirelight.model.planes import AOVS, LIGHT_PLANES, PLANES, SURFACE, Owner, planes_of

TYPES: dict[Owner, type] = {"frame": Frame, "splats": SplatLayer, "lighting": LightingBuffer, "layer": LightLayer}
IN_OTHER_ROWS = {("frame", "rgba"), ("lighting", "coverage")}  # the picture itself, and the alpha of `lighting`


@pytest.mark.parametrize("owner", get_args(Owner))
def test_every_picture_of_the_result_types_has_a_row(owner: Owner) -> None:
    hints = get_type_hints(TYPES[owner])
    pictures = {f.name for f in fields(TYPES[owner]) if hints[f.name] in (F32, F32 | None)}
    rows = [plane.field for plane in planes_of(owner)]
    assert len(rows) == len(set(rows))
    assert pictures == (set(rows) - {"rgba"}) | {name for kind, name in IN_OTHER_ROWS if kind == owner}


def test_names_are_unique_and_plain() -> None:
    assert len(set(AOVS)) == len(AOVS) == len(PLANES)
    assert all(name.replace("_", "").isalnum() and name.isascii() for name in AOVS)
    assert not any(name.startswith("light_") for name in AOVS)
    assert all(plane.name.startswith("light_NAME_") for plane in LIGHT_PLANES)


def test_the_films_surface_is_that_of_the_kernel() -> None:
    """`Film.add_surface` and `add_openness` write the floats in this order."""
    order = ["depth", "position", "normal", "geometric_normal", "albedo", "sun_visibility", "ambient_occlusion"]
    assert [plane.name for plane in SURFACE] == order
    from mirelight.lighting.develop import SURFACE as FLOATS

    assert FLOATS == 16 == 1 + int(np.sum([plane.width for plane in SURFACE]))
