"""Watts and cones of Blender against what Cycles rendered (`tests/blender/measure_lights.py` made the data)."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mirelight
from mirelight.model import AreaLight, DirectionalLight, Light, PointLight, SpotLight, cones

DATA = Path(__file__).parents[3] / "data"
MESH = DATA / "realtime" / "assets" / "stage.glb"
MEASURED = json.loads((DATA / "blender" / "lights.json").read_text())
PARTS = 8  # of a pixel along each axis
X, Y, HEIGHT = np.array(MEASURED["x"]), MEASURED["y"], MEASURED["height"]
ALONG = "direction = [0, -1, 0]"
HUNG = f"position = [0, {HEIGHT}, 0]"


def light_of(folder: Path, case: dict[str, Any]) -> Light:
    """The light as a job writes it with Blender's own numbers."""
    watt = f'unit = "watt"\nintensity = {case.get("watt", case.get("strength"))}'
    cone = f'cone = "blender"\nouter_cone_angle = {case.get("size", 0) / 2}\nblend = {case.get("blend")}'
    tables = {
        "POINT": ['type = "point"', HUNG],
        "SUN": ['type = "directional"', ALONG],
        "SPOT": ['type = "spot"', HUNG, ALONG, cone],
        "AREA": ['type = "area"', HUNG, ALONG, f"size = {case.get('side')}", "up = [0, 0, 1]"],
    }
    head = [f"proxy = '{MESH}'", "cameras = [{ position = [0, 0, 5], target = [0, 0, 0] }]", "[[lights]]"]
    (folder / "job.toml").write_text("\n".join([*head, *tables[case["type"]], watt]))
    return mirelight.load(folder / "job.toml").lightings[0].lights[0]


def irradiance(light: Light) -> np.ndarray:
    """On the floor under it, by docs/explanation/lighting.md; means over the pixels, as Cycles' are."""
    inside = ((np.arange(PARTS) + 0.5) / PARTS - 0.5) * (X[1] - X[0])
    x, y = X[:, None, None] + inside[:, None], Y + inside
    return np.asarray(np.broadcast_to(at(light, x, y), (len(X), PARTS, PARTS)).mean(axis=(1, 2)))


def at(light: Light, x: np.ndarray, y: np.ndarray) -> Any:
    """The same at points of the floor."""
    if isinstance(light, DirectionalLight):
        return light.intensity
    if isinstance(light, AreaLight):
        side, steps = light.size[0], 32
        place = ((np.arange(steps) + 0.5) / steps - 0.5) * side
        apart = sum(1 / ((x - p) ** 2 + (y - q) ** 2 + HEIGHT**2) ** 2 for p in place for q in place)
        return light.intensity * (side / steps) ** 2 * HEIGHT**2 * apart
    assert isinstance(light, PointLight | SpotLight)
    distance = np.sqrt(x**2 + y**2 + HEIGHT**2)
    cosine = HEIGHT / distance
    share: Any = 1.0
    if isinstance(light, SpotLight):
        share = cones.share(light.cone, light.inner_cone_angle, light.outer_cone_angle, cosine)
    return light.intensity * share * cosine / distance**2


def named(case: dict[str, Any]) -> str:
    return "-".join(str(case[key]) for key in ("type", "size", "blend") if key in case)


@pytest.mark.parametrize("case", MEASURED["cases"], ids=named)
def test_lamps_of_blender_light_as_cycles_renders_them(tmp_path: Path, case: dict[str, Any]) -> None:
    ours = irradiance(light_of(tmp_path, case)) * MEASURED["albedo"] / math.pi
    theirs = np.array(case["radiance"])
    error = np.abs(ours - theirs) / theirs.max()
    if case.get("blend") == 0:  # of a pixel that a hard edge cuts, eight parts an axis do not tell enough
        edge = HEIGHT * math.tan(math.radians(case["size"] / 2))
        error = error[np.abs(np.hypot(X, Y) - edge) > X[1] - X[0]]
    assert error.max() < 2e-3
    assert ours.max() == pytest.approx(theirs.max(), rel=2e-3)
