"""Finished frames as files: multi-layer OpenEXR (linear, everything) and PNG (display); EXR files read back as frames.

`mirelight.model.planes` is the table of layers for both ways; docs/reference/outputs.md has it and the metadata.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base import primaries
from mirelight.base.errors import InputError, OutputError
from mirelight.base.primaries import INTEROP_IDS, PRIMARIES, REC709, Chromaticities
from mirelight.io import cryptomatte, exr_bytes
from mirelight.io.exr import (
    CHROMATICITIES,
    INTEROP_ID,
    ExrImage,
    chromaticities_of,
    read_exr,
    read_header,
    write_exr,
)
from mirelight.io.frame_texts import (
    FINGERPRINT,
    LIGHTS,
    SAMPLING,
    attributes_of,
    camera_of,
    layer_names,
    profile_of,
    provenance_of,
    read_text,
    texts_of,
)
from mirelight.io.png import encode_display, encode_straight, png_is_intact, read_png_text, write_png
from mirelight.model import (
    F32,
    Camera,
    DisplaySettings,
    Frame,
    LightingBuffer,
    LightLayer,
    OutputSettings,
    Profile,
    SplatLayer,
)
from mirelight.model.planes import PLANES, Plane, planes_of

_NOISY = "_noisy"  # behind the names of layers as traced, where others are denoised


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
        display: PNG only: exposure, tone curve, and the background of a frame that brings none.
        output: EXR only: which layers, in which colour space, whether colours are 16-bit, and how it is compressed.

    Raises:
        OutputError: another suffix, or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".exr":
        space = PRIMARIES[output.color_space]
        images: dict[str, NDArray[Any]] = {"": _colors(frame.rgba, REC709, space)}  # no name: simple readers show it
        half, noise = {""}, output.wants("noise", "variance")
        for name, plane, values in _wanted(frame, output):
            if plane.half:
                half.add(name)
            images |= _channels(name, plane, _colors(values, REC709, space) if plane.color else values)
        texts = {
            **attributes_of(frame, noise=noise),
            CHROMATICITIES: space,
            INTEROP_ID: INTEROP_IDS[output.color_space],
        }
        for matte in (x for x in frame.mattes if output.wants(x.name)):
            images |= cryptomatte.layers(matte)
            texts |= cryptomatte.attributes(matte)
        write_exr(path, images, texts, half if output.half else (), output.compression)
    elif suffix == ".png":
        whole = frame.splats is not None and frame.splats.linear
        if display.transparent:
            pixels = encode_straight(frame.rgba, display, frame.profile)
        else:
            pixels = encode_display(frame.rgba, display, frame.profile, whole=whole, behind=frame.background)
        write_png(path, pixels, texts_of(frame, noise=False))
    else:
        raise OutputError(f"{path}: a frame is written as .exr or .png, not {path.suffix or 'without a suffix'}")


def read(path: str | Path) -> Frame:
    """A frame back from the EXR file that :func:`write` made of it.

    Every value is what was written: to the bit for 32-bit files ("zip" or "none") in lin_rec709; from another colour
    space colours come back as near as single precision has them. What the file leaves out:

    - `unlit`, `factor`, `noise`, variances, samples, sun visibility and ambient occlusion are None;
    - `splats` is None unless all four planes of a SplatLayer are there;
    - `lighting` is None where the file has no layer `lighting`, as that holds the coverage;
    - `lighting.layers` are one, "beauty", with all light in `direct`, where the file has no layers of lights;
    - `mattes` are none;
    - depth, position, normals and albedo of `lighting` are 0, as where the proxy covers nothing; mode `ratio`, which
      divides by the albedo, refuses such light.

    So `read(path).lighting.reweighted({"key": 0.5})` works wherever `output.layers` was set.

    Raises:
        InputError: not an EXR file that `write` made, or a damaged one.
    """
    path = Path(path)
    if path.suffix.lower() == ".png":
        raise InputError(path, "a PNG, which holds the displayed picture alone", "give the frame's EXR file")
    return frame_of(path, read_exr(path))


def frame_of(path: Path, image: ExrImage) -> Frame:
    """The frame that a file's channels hold, see :func:`read`.

    Raises:
        InputError: they hold none.
    """
    texts = image.metadata
    camera = camera_of(path, texts)
    image = _in_rec709(path, image)
    try:
        profile, linear = profile_of(path, texts)
        pictures: dict[str, Any] = _fields(image, "frame")
        lights = read_text(path, texts, LIGHTS) or {}
        lighting = _lighting(image, camera, lights, read_text(path, texts, SAMPLING) or {})
        return Frame(
            camera=camera,
            rgba=image.layer(),
            lighting=lighting,
            splats=_splats(image, camera, profile, linear),
            made_by=provenance_of(path, texts),
            profile=profile,
            **pictures,
        )
    except (KeyError, TypeError, ValueError) as e:
        found = f"layers that do not make a frame ({' '.join(str(e).split())})"
        raise InputError(path, found, "the file is damaged, or another program has saved it") from None


def read_fingerprint(path: str | Path) -> str | None:
    """The fingerprint that a written .exr or .png carries; None where there is none, no file, or a broken one.

    Reads headers alone, so a run can ask it of thousands of frames: files that are cut off or have holes in their
    structure count as broken, changed bits inside pixel data do not; :func:`is_intact` finds those.
    """
    path = Path(path)
    try:
        if not path.is_file():  # a pipe would be waited for
            return None
        if path.suffix.lower() == ".exr":
            found = read_header(path)[0].get(FINGERPRINT) if exr_bytes.is_whole(path) else None
        else:
            found = read_png_text(path).get(FINGERPRINT)
    except (InputError, OSError):
        return None
    return found if isinstance(found, str) and found else None


def read_size(path: str | Path) -> tuple[int, int] | None:
    """Width and height of a frame by its header; None where the file is no frame of mirelight's, or none is there."""
    path = Path(path)
    if read_fingerprint(path) is None:
        return None
    try:
        texts = read_header(path)[0] if path.suffix.lower() == ".exr" else read_png_text(path)
        camera = camera_of(path, texts)
    except (InputError, OSError):
        return None
    return camera.width, camera.height


def is_intact(path: str | Path) -> bool:
    """Whether a written .exr or .png is whole and unchanged, to the last bit.

    Reads the file, and decodes nothing: an EXR is held against the SHA-256 in its own header, a PNG's chunks against
    their CRC-32.
    """
    path = Path(path)
    return exr_bytes.is_intact(path) if path.suffix.lower() == ".exr" else png_is_intact(path)


# --- written ---------------------------------------------------------------------------------------------------------


def _wanted(frame: Frame, output: OutputSettings) -> Iterator[tuple[str, Plane, F32]]:
    """Name, row of the table and values of everything that is there and asked for, besides the picture."""
    lit = frame.lighting
    owners = {"frame": frame, "splats": frame.splats, "lighting": lit, "objects": None if lit is None else lit.objects}
    for plane in PLANES:
        owner = owners[plane.owner]
        values = getattr(owner, plane.field) if owner is not None and output.wants(plane.name) else None
        if values is not None:
            yield plane.name, plane, values
    if frame.lighting is None or not output.layers:
        return
    for layers, suffix in ((frame.lighting.layers, ""), (frame.lighting.noisy, _NOISY)):
        for name, layer in zip(layer_names(tuple(x.name for x in layers)), layers, strict=True):
            for plane in planes_of("layer"):
                values = getattr(layer, plane.field)
                if values is not None and (plane.field != "variance" or output.wants("variance")):
                    yield f"{name}_{plane.field}{suffix}", plane, values


def _channels(name: str, plane: Plane, values: F32) -> dict[str, F32]:
    """As `write_exr` takes them: colours by layer, everything else by channel."""
    if plane.channels in ("RGB", "RGBA"):
        return {name: values}
    separate = values.reshape(*values.shape[:2], -1)
    return {f"{name}.{channel}": separate[..., k] for k, channel in enumerate(plane.channels)}


def _colors(values: F32, source: Chromaticities, target: Chromaticities) -> F32:
    """(..., 3) or (..., 4) in another colour space; alpha stays."""
    if source == target:
        return values
    rgb = primaries.converted(values[..., :3], source, target)
    return rgb if values.shape[-1] == 3 else np.concatenate([rgb, values[..., 3:]], axis=-1)


# --- read ------------------------------------------------------------------------------------------------------------


def _in_rec709(path: Path, image: ExrImage) -> ExrImage:
    """The file with its colours in Rec.709; what is data stays."""
    space = chromaticities_of(path, image.metadata)
    if space is None or space == REC709:
        return image
    planes = {"": "RGB", **{x.name: x.channels[:3] for x in PLANES if x.color}}
    lights = [x for x in image.layers if x.startswith("light_") and not x.removesuffix(_NOISY).endswith("_variance")]
    planes |= dict.fromkeys(lights, "RGB")
    channels = dict(image.channels)
    for layer, letters in planes.items():
        names = [f"{layer}.{x}" if layer else x for x in letters]
        if all(name in channels for name in names):
            own = np.stack([np.asarray(channels[name], np.float32) for name in names], axis=-1)
            rgb = primaries.converted(own, space, REC709)
            channels |= {name: np.ascontiguousarray(rgb[..., k]) for k, name in enumerate(names)}
    return ExrImage(channels, image.metadata)


def _values(image: ExrImage, name: str, plane: Plane) -> F32 | None:
    """A row's (H, W, channels) or (H, W); None where the file has no channel of it. KeyError where it has some."""
    channels = [image.channels.get(f"{name}.{channel}") for channel in plane.channels]
    if all(x is None for x in channels):
        return None
    if any(x is None for x in channels):
        raise KeyError(f"{name} without all of its channels {plane.channels}")
    found = np.stack([np.asarray(x, np.float32) for x in channels], axis=-1)
    return found[..., 0] if plane.width == 1 else found


def _fields(image: ExrImage, owner: Any) -> dict[str, F32 | None]:
    return {plane.field: _values(image, plane.name, plane) for plane in planes_of(owner)}


def _splats(image: ExrImage, camera: Camera, profile: Profile, linear: bool) -> SplatLayer | None:
    found: dict[str, Any] = _fields(image, "splats")
    if any(values is None for values in found.values()):
        return None
    return SplatLayer(camera=camera, profile=profile, linear=linear, **found)


def _lighting(
    image: ExrImage, camera: Camera, lights: dict[str, Any], sampling: dict[str, Any]
) -> LightingBuffer | None:
    found: dict[str, Any] = _fields(image, "lighting")
    rgba, noisy = found.pop("rgba"), found.pop("noisy_beauty")
    if rgba is None:
        return None
    size = rgba.shape[:2]
    required = {x.name for x in fields(LightingBuffer) if x.default is MISSING}
    for plane in planes_of("lighting"):
        if plane.field in required and found[plane.field] is None:
            found[plane.field] = np.zeros((*size, plane.width)[: 2 if plane.width == 1 else 3], np.float32)
    return LightingBuffer(
        camera=camera,
        coverage=rgba[..., 3],
        layers=_layers(image, lights, "", rgba[..., :3]),
        noisy=() if noisy is None and not sampling.get("denoised") else _layers(image, lights, _NOISY, noisy),
        spp=int(sampling.get("spp", 0)),
        cell_rays=int(sampling.get("cell_rays", 0)),
        **found,
    )


def _layers(image: ExrImage, lights: dict[str, Any], suffix: str, beauty: F32 | None) -> tuple[LightLayer, ...]:
    """The layers of lights in the order of the trace; a single one where the file has their sum alone."""
    out: list[LightLayer] = []
    if not all(isinstance(name, str) for name in lights.values()):
        raise ValueError("names of lights that are no text")
    for file_name, name in lights.items():
        rows = {x.field: _values(image, f"{file_name}_{x.field}{suffix}", x) for x in planes_of("layer")}
        direct, indirect = rows["direct"], rows["indirect"]
        if direct is not None and indirect is not None:
            out.append(LightLayer(name=name, direct=direct, indirect=indirect, variance=rows["variance"]))
    if len(out) == len(lights):
        return tuple(out)
    if out:
        raise KeyError(f"layers of {len(out)} lights, expected {len(lights)}")
    if beauty is None:
        return ()
    return (LightLayer(name="beauty", direct=beauty, indirect=np.zeros_like(beauty)),)
