"""How messages about a job word keys and values, and what a wrong word was meant to be."""

from __future__ import annotations

import difflib
import re
from typing import Any

from mirelight.io.job.positions import Path

_MOST = 40  # characters of a value that a message shows
_MOST_OF_A_PATH = 200
_MOST_OF_A_NAME = 100  # characters that are compared
_MOST_COMPARED = 1000  # names

# Names for the same thing in glTF, PlayCanvas, Blender and Mitsuba, where spelling alone does not lead to ours.
_ELSEWHERE = {
    "fov": "yfov",
    "angle": "angular_diameter",
    "omni": "point",
    "rectangle": "area",
    "sphere": "area",
    "file": "path",
    "filename": "path",
    "equirect": "path",
    "rotation": "rotation_euler",
    "euler_angles": "rotation_euler",
    "quaternion": "rotation_quaternion",
    "samples": "spp",
    "sample_count": "spp",
    "bounces": "max_depth",
    "strength": "intensity",
    "power": "intensity",
    "energy": "intensity",
    "colour": "color",
    "ortho_height": "ymag",
    "lights_punctual": "lights",
    "env": "environment",
    "skybox": "environment",
    "tone_mapping": "tone",
    "perspective_camera": "perspective",
}


def label(path: Path) -> str:
    """The path as a person writes it: ``lights[2].range``."""
    out = ""
    for part in path:
        if isinstance(part, int):
            out += f"[{part}]"
        else:
            name = _cut(part if re.fullmatch(r"[\w-]+", part) else repr(part), _MOST)
            out += f".{name}" if out else name
    return out


def shown(value: Any) -> str:
    """A value as a message shows it."""
    match value:
        case bool():
            return str(value).lower()
        case int():
            return _cut(str(value), _MOST) if value.bit_length() < 1000 else f"a number of {value.bit_length()} bits"
        case float():
            return f"{value:g}"
        case str():
            return _cut(repr(value), _MOST)
        case list():
            return f"a list of {len(value)}"
        case dict():
            return "a table"
        case _:
            return f"a {type(value).__name__}"


def shown_path(value: str) -> str:
    """A file name as a message shows it: in full, unless it is absurd."""
    return _cut(repr(value), _MOST_OF_A_PATH)


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else text[:most] + "…"


def closest(name: str, known: list[str]) -> str | None:
    """The known name that was most likely meant; None where nothing is close."""
    snake = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower().replace("-", "_")
    if snake in known:
        return snake
    if _ELSEWHERE.get(snake) in known:
        return _ELSEWHERE[snake]
    near = difflib.get_close_matches(snake[:_MOST_OF_A_NAME], known[:_MOST_COMPARED], n=1, cutoff=0.6)
    return near[0] if near else None


def meant(name: str, known: list[str], otherwise: str) -> str:
    """What to do about an unknown name: take the one that was most likely meant, or else what is said."""
    near = closest(name, known)
    return f'did you mean "{near}"?' if near else otherwise
