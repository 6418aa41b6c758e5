"""The layout of the Hugging Face hub: WebDataset shards, which `datasets` and `webdataset` read.

`shards/train-000000.tar` and so on for each part. A sample is a frame: `png` (8-bit sRGB, straight alpha), `hdr.npy`
(linear, straight alpha, 16-bit floats), `depth.npy` (along the view axis), `normal.npy` (world), `albedo.png`,
`mask.png`,
`shadow.npy` (where asked for: light beside inserted objects over that without them) and `json`: camera (world from
camera, OpenGL's axes, Z up), lens, lights. Keys have no dot, for WebDataset
ends them there, and a sample's files stand side by side. The same frames give the same bytes.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.dataset.layouts.files import Files, write_pixels
from mirelight.dataset.layouts.pictures import PARTS, Part, Picture, Shared
from mirelight.dataset.layouts.shared import ENVIRONMENTS, write_environments
from mirelight.dataset.layouts.tensoir import albedo_rgba
from mirelight.io.cameras.transforms import lens_entry, matrix_entry
from mirelight.model import digest

SHARDS = "shards"
SPLIT_OF: Mapping[Part, str] = {part: "train" if part == "seen" else part for part in PARTS}
_MOST_BYTES = 512 * 2**20  # of a shard, by a guess at a pixel's bytes
_PIXEL_BYTES = 26


def write_hub(files: Files, pictures: Iterable[Picture], shared: Shared) -> None:
    """Write pictures, part by part. Raises OutputError: a file cannot be written."""
    by_part: dict[Part, list[Picture]] = {part: [] for part in PARTS}
    for picture in pictures:
        by_part[picture.part].append(picture)
    for part, chosen in by_part.items():
        for number, shard in enumerate(_shards(chosen)):
            _write_shard(files, f"{SHARDS}/{SPLIT_OF[part]}-{number:06d}.tar", shard, shared)
        chosen.clear()
    write_environments(files, shared, ".exr")


def configs(parts: Mapping[Part, int]) -> list[str]:
    """Lines for the head of the page: which files are which split."""
    out = ["configs:", "- config_name: default", "  data_files:"]
    for part, count in parts.items():
        if count:
            out += [f"  - split: {SPLIT_OF[part]}", f"    path: {SHARDS}/{SPLIT_OF[part]}-*.tar"]
    return out


def _shards(pictures: Sequence[Picture]) -> Iterator[list[Picture]]:
    """So many pictures a file that it is not too large, and known before any is made."""
    shard: list[Picture] = []
    size = 0
    for picture in pictures:
        own = picture.camera.width * picture.camera.height * _PIXEL_BYTES
        if shard and size + own > _MOST_BYTES:
            yield shard
            shard, size = [], 0
        shard.append(picture)
        size += own
    if shard:
        yield shard


def _write_shard(files: Files, name: str, shard: list[Picture], shared: Shared) -> None:
    key = digest("shard 1", shared.hdr, [(p.key, _text(p, shared)) for p in shard])
    if files.has(name, key):
        for picture in shard:
            files.frame(picture, name, sample=sample_key(picture), made=False)

    def heard(picture: Picture) -> None:
        files.frame(picture, name, sample=sample_key(picture), made=True)

    files.put(name, key, lambda path: _write_tar(path, shard, shared, heard))


def sample_key(picture: Picture) -> str:
    """A frame's name in a shard."""
    return f"{picture.lighting}__{picture.view}"


def _write_tar(path: Path, shard: list[Picture], shared: Shared, heard: Callable[[Picture], None]) -> None:
    # PAX gives a name of more than 100 characters a header of its own, and is USTAR for others
    with tarfile.open(path, "w", format=tarfile.PAX_FORMAT) as tar:
        for picture in shard:
            for suffix, data in _sample(picture, shared):
                entry = tarfile.TarInfo(f"{sample_key(picture)}.{suffix}")
                entry.size, entry.mode = len(data), 0o644
                tar.addfile(entry, io.BytesIO(data))
            picture.pixels.forget()
            heard(picture)


def _sample(picture: Picture, shared: Shared) -> Iterator[tuple[str, bytes]]:
    pixels = picture.pixels
    if pixels.has_geometry:
        yield "albedo.png", _png(albedo_rgba(pixels))
        yield "depth.npy", _npy(shared.depth(pixels))
    if shared.hdr:
        most = np.float32(np.finfo(np.float16).max)
        yield "hdr.npy", _npy(np.minimum(pixels.straight, most).astype(np.float16))
    yield "json", _text(picture, shared).encode()
    yield "mask.png", _png(pixels.mask)
    if pixels.has_geometry:
        yield "normal.npy", _npy(shared.normal(pixels).astype(np.float16))
    yield "png", _png(pixels.rgba)
    shadow = pixels.shadow
    if shadow is not None:
        yield "shadow.npy", _npy(np.minimum(shadow, np.float32(np.finfo(np.float16).max)).astype(np.float16))


def _text(picture: Picture, shared: Shared) -> str:
    """What is said of a frame. Values of one key have one type in all frames, for tables are made of them."""
    lens = {key: value for key, value in lens_entry(picture.camera).items() if key != "camera_model"}
    lamp = shared.lamps.get(picture.lighting)
    about: dict[str, Any] = {
        "camera": picture.view,
        "lighting": picture.lighting,
        "part": picture.part,
        "transform_matrix": matrix_entry(picture.camera, shared.world),
        **{key: float(value) for key, value in lens.items()},
        "exposure_stops": shared.exposure,
        "environment": f"{ENVIRONMENTS}/{picture.lighting}.exr" if picture.lighting in shared.surroundings else "",
        "point_light_position": [] if lamp is None else lamp.position.tolist(),
        "point_light_candela": [] if lamp is None else lamp.candela.tolist(),
    }
    return json.dumps(about, allow_nan=False)


def _png(pixels: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    write_pixels(stream, pixels)
    return stream.getvalue()


def _npy(values: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.ascontiguousarray(values), allow_pickle=False)
    return stream.getvalue()
