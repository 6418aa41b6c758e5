"""Every field's bounds, both ends: the last value that is taken and the first that is refused."""

from __future__ import annotations

import math
from typing import Any

import pytest

from mirelight.io.job.tables import json_schema

from .conftest import Complaints

SCENE = 'splats = "splats.ply"\nproxy = "proxy.glb"\n'
E9 = 1e9
ANY = (-E9, E9)  # coordinates
POSITIVE = (None, E9)  # 0 itself is refused
NOT_NEGATIVE = (0, E9)

# A table that is right, with one key still to be given: `{}` stands for it.
IN = {
    "top": SCENE + "{}\n",
    "splats": 'splats = {{ path = "splats.ply", {} }}\n',
    "splats.transform": 'splats = {{ path = "splats.ply", transform = {{ {} }} }}\n',
    "proxy": 'proxy = {{ path = "proxy.glb", {} }}\n',
    "environment": SCENE + "environment = {{ radiance = 1, {} }}\n",
    "radiance": SCENE + "environment = {{ {} }}\n",
    "sky": SCENE + "environment = {{ sky = {{ elevation = 30, {} }} }}\n",
    "sky at": SCENE + "environment = {{ sky = {{ {} }} }}\n",
    "lights_from": SCENE + 'lights_from = {{ path = "proxy", {} }}\n',
    "cameras_from": SCENE + 'cameras_from = {{ path = "proxy", {} }}\n',
    "directional": SCENE + '[[lights]]\ntype = "directional"\ndirection = [0, -1, 0]\n{}\n',
    "sun": SCENE + '[[lights]]\ntype = "sun"\ndirection = [0, -1, 0]\n{}\n',
    "point": SCENE + '[[lights]]\ntype = "point"\nposition = [0, 1, 0]\n{}\n',
    "point at": SCENE + '[[lights]]\ntype = "point"\n{}\n',
    "spot": SCENE + '[[lights]]\ntype = "spot"\nposition = [0, 1, 0]\ntarget = [0, 0, 0]\n{}\n',
    "spot wide": SCENE
    + '[[lights]]\ntype = "spot"\nposition = [0, 1, 0]\ntarget = [0, 0, 0]\nouter_cone_angle = 90\n{}\n',
    "area": SCENE + '[[lights]]\ntype = "area"\nposition = [0, 1, 0]\ntarget = [0, 0, 0]\n{}\n',
    "camera": SCENE + "[[cameras]]\nposition = [1, 2, 3]\ntarget = [0, 0, 0]\n{}\n",
    "camera far": SCENE + "[[cameras]]\nposition = [1, 2, 3]\ntarget = [0, 0, 0]\nnear = 1e-9\n{}\n",
    "camera fx": SCENE + "[[cameras]]\nposition = [1, 2, 3]\ntarget = [0, 0, 0]\nfx = 100\n{}\n",
    "orthographic": SCENE + '[[cameras]]\ntype = "orthographic"\nposition = [1, 2, 3]\ntarget = [0, 0, 0]\n{}\n',
    "turntable": SCENE + '[[cameras]]\ntype = "turntable"\n{}\n',
    "render": SCENE + "[render]\n{}\n",
    "compositor": SCENE + "[compositor]\n{}\n",
    "relight": SCENE + "[relight]\n{}\n",
    "display": SCENE + "[display]\n{}\n",
}

# (table, key, how the value is written, lowest and highest value taken; None: 0 is the first value refused below)
BOUNDS: list[tuple[str, str, str, tuple[float | None, float | None]]] = [
    ("top", "resolution", "[{}, 4]", (1, 65536)),
    ("top", "resolution_scale", "{}", (None, 16.0)),
    ("splats", "lod", "{}", (0, 63)),
    ("splats.transform", "translation", "[0, {}, 0]", ANY),
    ("splats.transform", "rotation_euler", "[0, {}, 0]", (-3600, 3600)),
    ("splats.transform", "rotation_quaternion", "[1, 0, {}, 0]", ANY),
    ("splats.transform", "scale", "{}", POSITIVE),
    ("splats.transform", "matrix", "[[1,0,0,{}],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", ANY),
    ("proxy", "albedo", "{}", (0, 1)),
    ("proxy", "albedo", "[0.5, {}, 0.5]", (0, 1)),
    ("environment", "intensity", "{}", NOT_NEGATIVE),
    ("environment", "rotation", "{}", (-3600, 3600)),
    ("radiance", "radiance", "{}", NOT_NEGATIVE),
    ("radiance", "radiance", "[0, {}, 0]", NOT_NEGATIVE),
    ("sky at", "elevation", "{}", (None, 90)),
    ("sky", "azimuth", "{}", (-3600, 3600)),
    ("sky", "turbidity", "{}", (1, 10)),
    ("sky", "albedo", "{}", (0, 1)),
    ("lights_from", "intensity", "{}", NOT_NEGATIVE),
    ("cameras_from", "fps", "{}", POSITIVE),
    ("cameras_from", "frames", "{}", (1, 100_000)),
    ("directional", "intensity", "{}", NOT_NEGATIVE),
    ("directional", "color", "[1, {}, 1]", NOT_NEGATIVE),
    ("sun", "intensity", "{}", NOT_NEGATIVE),
    ("sun", "kelvin", "{}", (1000, 40_000)),
    ("sun", "angular_diameter", "{}", (None, 90)),
    ("point at", "position", "[{}, 0, 0]", ANY),
    ("point", "intensity", "{}", NOT_NEGATIVE),
    ("point", "range", "{}", POSITIVE),
    ("point", "radius", "{}", NOT_NEGATIVE),
    ("spot", "intensity", "{}", NOT_NEGATIVE),
    ("spot", "range", "{}", POSITIVE),
    ("spot", "radius", "{}", NOT_NEGATIVE),
    ("spot", "outer_cone_angle", "{}", (None, 90)),
    ("spot wide", "inner_cone_angle", "{}", (0, None)),
    ("spot", "spot", "{{ outerConeAngle = {} }}", (None, math.pi / 2)),
    ("spot", "spot", "{{ innerConeAngle = {} }}", (0, None)),
    ("area", "intensity", "{}", NOT_NEGATIVE),
    ("area", "size", "{}", POSITIVE),
    ("area", "size", "[1, {}]", POSITIVE),
    ("area", "up", "[1, {}, 0]", ANY),
    ("camera", "width", "{}", (1, 65536)),
    ("camera", "height", "{}", (1, 65536)),
    ("camera", "near", "{}", POSITIVE),
    ("camera far", "far", "{}", (None, E9)),
    ("camera", "yfov", "{}", (0.01, 179)),
    ("camera", "fx", "{}", POSITIVE),
    ("camera fx", "fy", "{}", POSITIVE),
    ("camera fx", "cx", "{}", ANY),
    ("camera fx", "cy", "{}", ANY),
    ("camera", "up", "[1, {}, 0]", ANY),
    ("orthographic", "ymag", "{}", POSITIVE),
    ("turntable", "target", "[0, {}, 0]", ANY),
    ("turntable", "radius", "{}", POSITIVE),
    ("turntable", "elevation", "{}", ANY),
    ("turntable", "frames", "{}", (1, 100_000)),
    ("turntable", "start", "{}", (-3600, 3600)),
    ("turntable", "yfov", "{}", (0.01, 179)),
    ("render", "spp", "{}", (1, 1_000_000)),
    ("render", "lens_samples", "{}", (1, 4096)),
    ("render", "noise", "{}", (None, 1)),
    ("render", "max_depth", "{}", (1, 1000)),
    ("render", "seed", "{}", (0, 2**31 - 1)),
    ("render", "threads", "{}", (1, 4096)),
    ("render", "max_memory", "{}", (2**20, 2**50)),
    ("render", "ao_distance", "{}", POSITIVE),
    ("compositor", "min_pixel_size", "{}", NOT_NEGATIVE),
    ("compositor", "alpha_clip", "{}", (0, 1)),
    ("compositor", "exposure", "{}", NOT_NEGATIVE),
    ("compositor", "supersampling", "{}", (1, 8)),
    ("compositor", "max_memory", "{}", (2**20, 2**50)),
    ("relight", "blend", "{}", (0, 1)),
    ("relight", "brightness", "{}", NOT_NEGATIVE),
    ("relight", "background", "{}", NOT_NEGATIVE),
    ("relight", "texture_scale", "{}", (0.01, 2)),
    ("relight", "delta", "{}", (None, 1)),
    ("relight", "max_ratio", "{}", POSITIVE),
    ("display", "exposure", "{}", (-64, 64)),
    ("display", "background", "[0, {}, 0]", (0, 1)),
]  # fmt: skip

WITHOUT_BOUNDS = {
    "view",
    "display",
    "config",
    "indirect",
    "per",
    "repair",
    "mask",
    "gloss",
    "sh",
    "variant",
    "denoise",
    "sort",
    "work_buffer",
    "tone",
    "linear",
    "eight_bit",
    "mode",
    "space",
}


def written(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.17g}" if "." in f"{value:.17g}" else f"{value:.1f}"


def beyond(value: float, down: bool) -> float:
    step = 1 if isinstance(value, int) else max(abs(value) * 1e-6, 1e-6)
    return value - step if down else value + step


@pytest.mark.parametrize("case", BOUNDS, ids=lambda c: f"{c[0]}.{c[1]} {c[2]}")
def test_bounds(complaints: Complaints, case: tuple[str, str, str, tuple[float | None, float | None]]) -> None:
    table, key, form, (low, high) = case

    def job(value: float) -> str:
        return IN[table].format(f"{key} = {form.format(written(value))}")

    for value in (low, high):
        if value is not None:
            assert complaints(job(value)) == []
    refused = [0 if low is None else beyond(low, down=True)]
    if high is not None:
        refused.append(beyond(high, down=False))
    for value in refused:
        found = complaints(job(value))
        assert len(found) == 1
        assert key in found[0].split(": ")[1]


def test_an_inner_cone_of_90_degrees_is_refused(complaints: Complaints) -> None:
    (found,) = complaints(IN["spot wide"].format("inner_cone_angle = 90"))
    assert "lights[0].inner_cone_angle: 90; give a number below 90" in found
    assert complaints(IN["spot wide"].format("inner_cone_angle = 89.9")) == []


@pytest.mark.parametrize("section", ["render", "compositor", "relight", "display"])
def test_no_number_of_the_settings_is_left_out_above(section: str) -> None:
    schema: dict[str, Any] = json_schema()
    table = schema["$defs"][schema["properties"][section]["$ref"].rsplit("/", 1)[-1]]
    tested = {key for name, key, _, _ in BOUNDS if name == section}
    assert set(table["properties"]) - WITHOUT_BOUNDS == tested
