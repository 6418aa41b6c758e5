"""A lighting of suns, lamps and a map as the table `[captured]` of a job file."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace

from mirelight.io.job.write import light_table
from mirelight.model import Lighting

_UNITS = {
    "direction": "the way its light travels",
    "angular_diameter": "degrees",
}


def captured_text(lighting: Lighting, picture: str, notes: Iterable[str]) -> str:
    """TOML that a person can paste and edit.

    Args:
        lighting: lights and an environment; those without intensity are left out.
        picture: the file of the environment's map, as the job is to name it.
        notes: lines of comment that stand first.
    """
    lines = [f"# {note}" for note in notes]
    lines += ["", "[captured]", f"environment = {{ path = {json.dumps(picture, ensure_ascii=False)} }}"]
    for light in lighting.lights:
        if not light.intensity > 0:
            continue
        lines += ["", "[[captured.lights]]"]
        units = {**_UNITS, "intensity": light.KIND.unit.name}
        for key, value in light_table(replace(light, group=None)).items():
            unit = units.get(key)
            lines.append(f"{key} = {_value(value)}{f'  # {unit}' if unit else ''}")
    return "\n".join(lines) + "\n"


def _value(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_value(x) for x in value)}]"
    return f"{value:.6g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
