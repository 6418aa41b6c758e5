"""What a frame's files say beside pixels: camera, lights, sampling, provenance as JSON texts, written and read back.

docs/reference/outputs.md lists them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.base.names import FreeNames
from mirelight.io.exr import Metadata
from mirelight.io.records import made, packed
from mirelight.io.safety import json_object
from mirelight.model import PROFILES, Camera, Frame, LightingBuffer, Profile, Provenance

FINGERPRINT = "mirelight/fingerprint"
PROVENANCE = "mirelight/provenance"
CAMERA = "mirelight/camera"
LIGHTS = "mirelight/lights"
SAMPLING = "mirelight/sampling"
PROFILE = "mirelight/profile"

_MAX_LAYER_NAME = 38  # Blender cuts channel names at 63 characters
_UNSEEN = ("time", "frame", "share")  # fields of a camera that are no part of what it sees


def layer_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """EXR layer names of lights: letters, digits and underscores (what Nuke keeps), unique, ``light_`` before."""
    plain = ("".join(c if c.isascii() and c.isalnum() else "_" for c in name)[:_MAX_LAYER_NAME] for name in names)
    free = FreeNames(separator="_")
    return tuple(free.take(f"light_{name or 'unnamed'}") for name in plain)


# --- written ---------------------------------------------------------------------------------------------------------


def texts_of(frame: Frame, *, noise: bool) -> dict[str, str]:
    """What both formats carry: camera, lights behind the layer names, provenance and fingerprint.

    Args:
        frame: of the file.
        noise: whether to say the error that the lighting reached, which costs as much as encoding the picture.
    """
    linear = frame.splats is not None and frame.splats.linear
    found = {
        CAMERA: _json({k: x for k, x in packed(frame.camera).items() if k not in _UNSEEN}),
        PROFILE: _json({"name": frame.profile, "linear": linear}),
    }
    if frame.lighting is not None:
        names = tuple(layer.name for layer in frame.lighting.layers)
        found[SAMPLING] = _json(_sampling_values(frame.lighting, noise))
        found[LIGHTS] = _json(dict(zip(layer_names(names), names, strict=True)), sort=False)
    if frame.made_by is not None:
        found[PROVENANCE] = _json(frame.made_by)
        if frame.made_by.fingerprint:
            found[FINGERPRINT] = frame.made_by.fingerprint
    return found


def attributes_of(frame: Frame, *, noise: bool) -> Metadata:
    """The texts, and OpenEXR's standard attributes of the camera."""
    camera = frame.camera
    found: dict[str, str | int | float | tuple[float, ...] | NDArray[np.float32]] = {
        **texts_of(frame, noise=noise),
        "worldToCamera": world_to_camera(camera),
        "worldToNDC": world_to_ndc(camera),
        "pixelAspectRatio": float(camera.fy / camera.fx),
        "screenWindowWidth": float(camera.width / camera.fx),
        "screenWindowCenter": (
            float((camera.width / 2 - camera.cx) / camera.fx),
            float((camera.cy - camera.height / 2) / camera.fy),
        ),
    }
    if frame.made_by is not None:
        found["software"] = f"mirelight {frame.made_by.mirelight}"
    return found


def world_to_camera(camera: Camera) -> NDArray[np.float32]:
    """OpenEXR's standard attribute `worldToCamera` (4, 4): left-handed, +Z into the scene, for row vectors."""
    flip = np.diag((1.0, 1.0, -1.0, 1.0))
    return np.ascontiguousarray((flip @ camera.camera_from_world).T, dtype=np.float32)


def world_to_ndc(camera: Camera) -> NDArray[np.float32]:
    """OpenEXR's `worldToNDC` (4, 4): (0, 0) the image's upper left corner, (1, 1) its lower right, for row vectors.

    Divide by the fourth coordinate; the third is the depth along the view axis.
    """
    u, v = camera.cx / camera.width, camera.cy / camera.height
    sx, sy = camera.fx / camera.width, camera.fy / camera.height
    if camera.projection == "perspective":
        project = np.array([[sx, 0, -u, 0], [0, -sy, -v, 0], [0, 0, -1, 0], [0, 0, -1, 0]])
    else:
        project = np.array([[sx, 0, 0, u], [0, -sy, 0, v], [0, 0, -1, 0], [0, 0, 0, 1]])
    return np.ascontiguousarray((project @ camera.camera_from_world).T, dtype=np.float32)


def _sampling_values(lighting: LightingBuffer, noise: bool) -> dict[str, Any]:
    """The error that the lighting reached, and how many samples its pixels got."""
    samples = lighting.samples
    of_pixels = None if samples is None else {k: float(getattr(samples, k)()) for k in ("min", "mean", "max")}
    return {
        "relative_noise": lighting.relative_noise if noise else None,
        "denoised": bool(lighting.noisy),
        "samples": of_pixels,
        "spp": lighting.spp,
        "cell_rays": lighting.cell_rays,
    }


def _json(values: Any, *, sort: bool = True) -> str:
    """ASCII JSON: the same input gives the same bytes. Numbers that JSON does not have (NaN, infinite) are null."""
    return json.dumps(packed(values), sort_keys=sort, default=str, allow_nan=False)


# --- read back -------------------------------------------------------------------------------------------------------


def read_text(path: Path, texts: Mapping[str, Any], name: str) -> dict[str, Any] | None:
    """The JSON object in one of a file's texts; None where it is absent.

    Raises:
        InputError: it is not a JSON object.
    """
    text = texts.get(name)
    if text is None:
        return None
    found = json_object(text)
    if found is None:
        raise InputError(path, "metadata that is not a JSON object", "the file is damaged", field=name)
    return found


def camera_of(path: Path, texts: Mapping[str, Any]) -> Camera:
    """The camera that a file was seen by.

    Raises:
        InputError: a file without one, so not written by mirelight; a camera that is none.
    """
    values = read_text(path, texts, CAMERA)
    if values is None:
        raise InputError(path, "not a frame that mirelight wrote", "give the EXR file of a frame")
    try:
        return made(Camera, values)
    except (KeyError, TypeError, ValueError) as e:
        found = f"a camera that cannot be used ({type(e).__name__})"
        raise InputError(path, found, "the file is damaged", field=CAMERA) from None


def profile_of(path: Path, texts: Mapping[str, Any]) -> tuple[Profile, bool]:
    """By whose curve a frame is shown, and whether its splats blend in linear light.

    Raises:
        InputError: no such profile.
    """
    values = read_text(path, texts, PROFILE)
    if values is None:
        return "physical", False
    name, linear = values.get("name"), values.get("linear")
    if name not in PROFILES or not isinstance(linear, bool):
        raise InputError(path, "a profile that is not known", "the file is damaged", field=PROFILE)
    return cast(Profile, name), linear


def provenance_of(path: Path, texts: Mapping[str, Any]) -> Provenance | None:
    """What made a file; None where it does not say. Tuples come back as lists.

    Raises:
        InputError: its text has other keys.
    """
    values = read_text(path, texts, PROVENANCE)
    if values is None:
        return None
    try:
        return Provenance(**values)
    except TypeError:
        raise InputError(path, "keys that are not known", "the file is damaged", field=PROVENANCE) from None
