"""A lighting of a sun, lamps and a map as the table `[captured]` of a job file."""

from __future__ import annotations

import json
from collections.abc import Iterable

from mirelight.model import Lighting, PointLight, SunLight


def captured_text(lighting: Lighting, picture: str, notes: Iterable[str]) -> str:
    """TOML that a person can paste and edit.

    Args:
        lighting: suns, point lights and an environment; those without intensity are left out.
        picture: the file of the environment's map, as the job is to name it.
        notes: lines of comment that stand first.
    """
    lines = [f"# {note}" for note in notes]
    lines += ["", "[captured]", f"environment = {{ path = {json.dumps(picture, ensure_ascii=False)} }}"]
    for light in lighting.lights:
        if not isinstance(light, SunLight | PointLight) or not light.intensity > 0:
            continue
        if isinstance(light, PointLight):
            lines += [
                "",
                "[[captured.lights]]",
                'type = "point"',
                f"name = {json.dumps(light.name)}",
                f"position = [{_numbers(light.position)}]",
                f"color = [{_numbers(light.color)}]",
                f"intensity = {light.intensity:.6g}  # candela",
            ]
            continue
        lines += [
            "",
            "[[captured.lights]]",
            'type = "sun"',
            f"name = {json.dumps(light.name)}",
            f"direction = [{_numbers(light.direction)}]  # the way its light travels",
            f"color = [{_numbers(light.color)}]",
            f"intensity = {light.intensity:.6g}  # lux",
            f"angular_diameter = {light.angular_diameter:.4g}  # degrees",
        ]
    return "\n".join(lines) + "\n"


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(f"{float(x):.6g}" for x in values)
