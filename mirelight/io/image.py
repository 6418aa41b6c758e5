"""Finished frames as files: multi-layer OpenEXR (linear, everything) and PNG (display).

docs/outputs.md lists the layers and the metadata.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.errors import InputError, OutputError
from mirelight.io.exr import Metadata, is_whole, read_header, write_exr
from mirelight.io.png import encode_display, read_png_text, write_png
from mirelight.model import (
    Camera,
    DisplaySettings,
    Frame,
    LightingBuffer,
    LightLayer,
    OutputSettings,
    Provenance,
    SplatLayer,
)

FINGERPRINT = "mirelight/fingerprint"
PROVENANCE = "mirelight/provenance"
CAMERA = "mirelight/camera"
LIGHTS = "mirelight/lights"
SAMPLING = "mirelight/sampling"

_MAX_LAYER_NAME = 38  # Blender cuts channel names at 63 characters


def write(
    frame: Frame,
    path: str | Path,
    display: DisplaySettings = DisplaySettings(),  # noqa: B008 - frozen
    output: OutputSettings = OutputSettings(),  # noqa: B008 - frozen
) -> None:
    """Write a frame as OpenEXR or PNG, told apart by the suffix.

    Args:
        frame: what to write.
        path: a name ending in .exr or .png in an existing folder; appears whole or not at all.
        display: PNG only: exposure, tone curve and background.
        output: EXR only: which layers, and whether colours are 16-bit.

    Raises:
        OutputError: another suffix, or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".exr":
        images = _images(frame, output)
        write_exr(path, images, _metadata(frame), half=_colours(images) if output.half else ())
    elif suffix == ".png":
        write_png(path, encode_display(frame.rgba, display, frame.profile), _texts(frame))
    else:
        raise OutputError(f"{path}: a frame is written as .exr or .png, not {path.suffix or 'without a suffix'}")


def read_fingerprint(path: str | Path) -> str | None:
    """The fingerprint that a written .exr or .png carries; None where there is none, no file, or a broken one.

    Reads the header alone, so a run can ask it of thousands of frames.
    """
    path = Path(path)
    try:
        if path.suffix.lower() == ".exr":
            found = read_header(path)[0].get(FINGERPRINT) if is_whole(path) else None
        else:
            found = read_png_text(path).get(FINGERPRINT)
    except (InputError, OSError):
        return None
    return found if isinstance(found, str) and found else None


def layer_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """EXR layer names of lights: letters, digits and underscores (what Nuke keeps), unique, ``light_`` before."""
    out: list[str] = []
    for name in names:
        plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in name)[:_MAX_LAYER_NAME]
        base, number = f"light_{plain or 'unnamed'}", 2
        candidate = base
        while candidate in out:
            candidate, number = f"{base}_{number}", number + 1
        out.append(candidate)
    return tuple(out)


# --- OpenEXR ---------------------------------------------------------------------------------------------------------


def _images(frame: Frame, output: OutputSettings) -> dict[str, NDArray[Any]]:
    """Every layer or channel by its name. The relit picture has no layer name, so that simple readers show it."""
    out: dict[str, NDArray[Any]] = {"": frame.rgba}
    if frame.unlit is not None:
        out["unlit"] = frame.unlit
    if frame.factor is not None:
        out["factor"] = frame.factor
    if frame.noise is not None and output.aovs:
        out["noise"] = frame.noise
    if frame.splats is not None and output.aovs:
        out |= _splat_images(frame.splats)
    if frame.lighting is not None:
        out |= _lighting_images(frame.lighting, output)
    return out


def _colours(images: Mapping[str, NDArray[Any]]) -> frozenset[str]:
    """Names of colours; noise and its square can be too small for 16 bits."""
    squares = ("noise", "variance")
    return frozenset(name for name, x in images.items() if x.ndim == 3 and not name.endswith(squares))


def _splat_images(splats: SplatLayer) -> dict[str, NDArray[Any]]:
    return {
        "transmittance.Y": splats.transmittance,
        "splat_depth.Z": splats.depth,
        "splat_median_depth.Z": splats.median_depth,
    }


def _lighting_images(lighting: LightingBuffer, output: OutputSettings) -> dict[str, NDArray[Any]]:
    out: dict[str, NDArray[Any]] = {"lighting": np.dstack([lighting.beauty, lighting.coverage])}
    if lighting.noisy:
        out["lighting_noisy"] = sum((x.total for x in lighting.noisy), np.zeros_like(lighting.beauty))
    if output.layers:
        out |= _layer_images(lighting.layers, "", variance=output.aovs)
        out |= _layer_images(lighting.noisy, "_noisy", variance=output.aovs)
    if output.aovs:
        out |= {"depth.Z": lighting.depth, "albedo": lighting.albedo}
        out |= _xyz("position", lighting.position)
        out |= _xyz("normal", lighting.normal)
        out |= _xyz("geometric_normal", lighting.geometric_normal)
        optional = {
            "sun_visibility.Y": lighting.sun_visibility,
            "ambient_occlusion.Y": lighting.ambient_occlusion,
            "samples.Y": lighting.samples,
            "variance": lighting.variance,
        }
        out |= {name: image for name, image in optional.items() if image is not None}
    return out


def _layer_images(layers: tuple[LightLayer, ...], suffix: str, *, variance: bool) -> dict[str, NDArray[Any]]:
    out: dict[str, NDArray[Any]] = {}
    for name, layer in zip(layer_names(tuple(layer.name for layer in layers)), layers, strict=True):
        out |= {f"{name}_direct{suffix}": layer.direct, f"{name}_indirect{suffix}": layer.indirect}
        if variance and layer.variance is not None:
            out[f"{name}_variance"] = layer.variance
    return out


def _xyz(layer: str, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
    return {f"{layer}.{name}": values[..., i] for i, name in enumerate("XYZ")}


def _metadata(frame: Frame) -> Metadata:
    camera = frame.camera
    found: dict[str, str | int | float | tuple[float, float] | NDArray[np.float32]] = {
        **_texts(frame),
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


# --- metadata as text ------------------------------------------------------------------------------------------------


def _texts(frame: Frame) -> dict[str, str]:
    """What both formats carry: camera, lights behind the layer names, provenance and fingerprint."""
    found = {CAMERA: _json(_camera_values(frame.camera))}
    if frame.lighting is not None:
        names = tuple(layer.name for layer in frame.lighting.layers)
        found[SAMPLING] = _json(_sampling_values(frame.lighting))
        found[LIGHTS] = _json(dict(zip(layer_names(names), names, strict=True)))
    if frame.made_by is not None:
        found[PROVENANCE] = _json(_provenance_values(frame.made_by))
        if frame.made_by.fingerprint:
            found[FINGERPRINT] = frame.made_by.fingerprint
    return found


def _sampling_values(lighting: LightingBuffer) -> dict[str, Any]:
    """The error that the lighting reached, and how many samples its pixels got."""
    samples = lighting.samples
    of_pixels = None if samples is None else {k: float(getattr(samples, k)()) for k in ("min", "mean", "max")}
    return {"relative_noise": lighting.relative_noise, "denoised": bool(lighting.noisy), "samples": of_pixels}


def _camera_values(camera: Camera) -> dict[str, Any]:
    values = {name: getattr(camera, name) for name in ("name", "projection", "width", "height", "fx", "fy", "cx", "cy")}
    values |= {"near": camera.near, "far": camera.far if np.isfinite(camera.far) else None}
    return values | {"world_from_camera": camera.world_from_camera.tolist()}


def _provenance_values(made_by: Provenance) -> dict[str, Any]:
    values = {entry.name: getattr(made_by, entry.name) for entry in fields(made_by)}
    return {name: dict(value) if isinstance(value, Mapping) else value for name, value in values.items()}


def _json(values: Any) -> str:
    """ASCII JSON with sorted keys: the same input gives the same bytes."""
    return json.dumps(values, sort_keys=True, default=str)
