"""What a page asks for, checked: tables of numbers, and a view as a camera."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mirelight.base.errors import InputError
from mirelight.io.job.fields import LARGEST
from mirelight.io.safety import json_object
from mirelight.model import Camera

MOST_PIXELS = 1920 * 1080


def camera_of(asked: Mapping[str, Any]) -> Camera:
    """A view by its size in pixels, pose (16 numbers, row by row), fov in degrees and near. Raises InputError."""
    width, height = (whole(asked, key, 1, 16384) for key in ("width", "height"))
    if width * height > MOST_PIXELS:
        part = math.sqrt(MOST_PIXELS / (width * height))
        width, height = max(int(width * part), 1), max(int(height * part), 1)
    pose = np.array(numbers(asked, "pose", 16, LARGEST)).reshape(4, 4)  # row by row
    fov, near = (numbers({key: [asked.get(key)]}, key, 1, LARGEST)[0] for key in ("fov", "near"))
    sound = np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-3) and np.linalg.det(pose[:3, :3]) > 0
    if not (sound and np.allclose(pose[3], [0, 0, 0, 1]) and 0.01 <= fov < 179 and near > 0):
        raise InputError("the page", "a camera that sees nothing")
    u, _, v = np.linalg.svd(pose[:3, :3])
    pose[:3, :3] = u @ v  # the page's numbers are rounded
    return Camera.perspective(pose, width, height, yfov=fov, near=near, name="still")


def table(body: bytes) -> Mapping[str, Any]:
    """A JSON object. Raises InputError."""
    found = json_object(body)
    if found is None:
        raise InputError("the page", "no table")
    return found


def whole(table: Mapping[str, Any], key: str, least: int, most: int) -> int:
    """A whole number of a table. Raises InputError."""
    value = table.get(key)
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        raise InputError("the page", f"{key} is no whole number of {least} to {most}")
    return value


def numbers(table: Mapping[str, Any], key: str, count: int, most: float) -> list[float]:
    """So many numbers of a table, of a size up to `most`. Raises InputError."""
    values = table.get(key)
    sound = isinstance(values, list) and len(values) == count
    if not sound or not all(isinstance(x, int | float) and not isinstance(x, bool) for x in values or ()):
        raise InputError("the page", f"{key} is not {count} numbers")
    if any(not abs(x) <= most for x in values or ()):
        raise InputError("the page", f"{key} is not within {most:g}")
    return [float(x) for x in values or ()]
