"""glTF with KHR_gaussian_splatting: activated values as vertex attributes of point primitives.

Read in glTF's own world, node transforms applied, so that splats, meshes, lights and cameras of one file stand right to
each other. PLY files have other axes: splat-transform turns PLY by 180 degrees about Z when it writes a GLB.
Specification: Khronos, KHR_gaussian_splatting (ratified 2026), ellipse kernel.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError, OutputError
from mirelight.base.sh import COEFFICIENTS
from mirelight.io.atomic import write_file
from mirelight.io.gltf.accessors import accessor_count, read_accessor
from mirelight.io.gltf.document import HANDLED_EXTENSIONS, Document, read_document
from mirelight.io.gltf.fields import Fields
from mirelight.io.gltf.nodes import Matrix, instance_worlds, place_nodes
from mirelight.io.gltf.write import ARRAY_BUFFER, GlbBuilder
from mirelight.io.safety import require_memory
from mirelight.io.splats import values
from mirelight.io.splats.builder import ROWS, CloudBuilder
from mirelight.io.splats.edit import merge, transform
from mirelight.io.splats.info import SplatFileInfo
from mirelight.model import SplatCloud, SplatColorSpace

_NAME = "KHR_gaussian_splatting"
_MOST_INSTANCES = 1000  # of one primitive; each becomes splats of its own
_ENCODED: SplatColorSpace = "srgb_rec709_display"
_SPACES: Mapping[str, SplatColorSpace] = {x: x for x in get_args(SplatColorSpace)}
_CUTOFF = 3.0  # standard deviations: where the ellipse kernel ends
# What the base extension knows, its default first; others come with extensions of it, which are not read.
_KNOWN: Mapping[str, tuple[str, ...]] = {
    "kernel": ("ellipse",),
    "projection": ("perspective",),
    "sortingMethod": ("cameraDistance",),
    "colorSpace": tuple(_SPACES),
}


def summary(path: Path) -> SplatFileInfo:
    """The head of a glTF file with splats. Raises InputError."""
    document = _open(path)
    count, degree, space = 0, 0, _ENCODED
    for k, (primitive, worlds, _) in enumerate(_primitives(document)):
        attributes = _checked(primitive)
        count += len(worlds) * accessor_count(document, attributes["POSITION"], primitive)
        degree = max(degree, _degree(primitive, attributes))
        own = _space(primitive)
        if k and own != space:
            raise primitive.fail("", f"splats in {own} beside others in {space}", "give each a file of its own")
        space = own
    return SplatFileInfo(
        path=path,
        format=f"glTF {_NAME}",
        count=count,
        sh_degree=degree,
        color_space=space,
        sort="radial",
        cutoff=_CUTOFF,
        notes=("in glTF axes (Y up), not turned as PLY captures are",),
    )


def read(path: Path) -> SplatCloud:
    """Every splat of the default scene, in glTF's world. Raises InputError."""
    info = summary(path)
    require_memory(path, 2 * info.memory, f"{info.count:,} splats")  # once for each node, once all together
    document = _open(path)
    clouds = []
    for primitive, worlds, node in _primitives(document):
        if len(worlds) > _MOST_INSTANCES:
            raise node.fail("", f"{len(worlds)} instances of splats", f"at most {_MOST_INSTANCES} are read")
        local = _read_primitive(document, primitive)
        for world in worlds:
            try:
                clouds.append(transform(local, world))
            except ValueError as e:
                raise node.fail("", str(e)) from None
    return merge(clouds)


def write(cloud: SplatCloud, path: Path) -> None:
    """Write a GLB file: one node with one primitive of points, every value a float.

    Values go as they are, so the cloud has to stand in glTF's world: Y up. Viewers that do not know the extension see
    coloured points.

    Raises:
        OutputError: it cannot be written.
        ValueError: no splats, which glTF cannot hold.
    """
    if not len(cloud):
        raise ValueError("no splats; a glTF file holds at least one")
    if cloud.color_space not in _SPACES:
        raise OutputError(f"{path}: glTF has no word for splats in {cloud.color_space}; nothing was written")
    builder = GlbBuilder(path)
    builder.used.add(_NAME)
    shown = cloud.light(np.clip(values.rgb_from_dc(cloud.sh[:, 0]), 0, 1))  # COLOR_0 is linear
    points = np.concatenate([shown, np.clip(cloud.opacities, 0, 1)[:, None]], axis=1)
    columns: dict[str, NDArray[Any]] = {
        "COLOR_0": np.round(points * 255).astype(np.uint8),
        f"{_NAME}:ROTATION": np.roll(cloud.quats, -1, axis=1),  # stored xyzw
        f"{_NAME}:SCALE": cloud.scales,
        f"{_NAME}:OPACITY": cloud.opacities,
    }
    names = [name for band in range(cloud.sh_degree + 1) for name in _coefficient_names(band)]
    columns |= {f"{_NAME}:{name}": cloud.sh[:, k] for k, name in enumerate(names)}
    attributes = {"POSITION": builder.add_accessor(cloud.means, ARRAY_BUFFER, bounds=True)}
    attributes |= {name: builder.add_accessor(column, ARRAY_BUFFER) for name, column in columns.items()}
    about = {name: known[0] for name, known in _KNOWN.items()} | {"colorSpace": cloud.color_space}
    primitive = {"attributes": attributes, "mode": 0, "extensions": {_NAME: about}}
    builder.add("nodes", {"name": "splats", "mesh": builder.add("meshes", {"primitives": [primitive]})})
    if len(builder.binary) >= 2**32 - 2**20:
        raise OutputError(f"{path}: {len(cloud):,} splats are more than the 4 GB of a GLB file; nothing was written")
    write_file(path, builder.glb())


def _open(path: Path) -> Document:
    return read_document(path, HANDLED_EXTENSIONS | {_NAME})


def _primitives(document: Document) -> Iterator[tuple[Fields, Matrix, Fields]]:
    """Splat primitives with the world matrices they stand at and the node that places them."""
    found = False
    for node in place_nodes(document).values():
        mesh = node.fields.integer("mesh", None)
        if mesh is None:
            continue
        for primitive in document.entry("meshes", mesh, node.fields, "mesh").children("primitives"):
            if primitive.extension(_NAME) is not None:
                found = True
                yield primitive, instance_worlds(document, node), node.fields
    if not found:
        raise InputError(document.path, f"no {_NAME} primitive in the scene", "a mesh belongs under the proxy")


def _checked(primitive: Fields) -> dict[str, int]:
    """The attributes of a splat primitive that can be read, without the extension's prefix."""
    extension = primitive.extension(_NAME)
    assert extension is not None  # _primitives yields no others
    for field, known in _KNOWN.items():
        named = extension.text(field, known[0])
        if named not in known:
            raise extension.fail(field, f"{named[:40]!r}", f"read is {' or '.join(map(repr, known))}")
    if primitive.integer("mode", 4) != 0:
        raise primitive.fail("mode", f"{primitive.integer('mode', 4)}", "splats are points, mode 0")
    prefix = _NAME + ":"
    attributes = {name.removeprefix(prefix): index for name, index in primitive.indices("attributes").items()}
    for name in ("POSITION", "ROTATION", "SCALE", "OPACITY", "SH_DEGREE_0_COEF_0"):
        if name not in attributes:
            remedy = "compressed splat extensions are not read; convert the file with splat-transform"
            raise primitive.fail("attributes", f"no {name}", remedy)
    return attributes


def _space(primitive: Fields) -> SplatColorSpace:
    extension = primitive.extension(_NAME)
    assert extension is not None
    return _SPACES[extension.text("colorSpace", _ENCODED)]


def _degree(primitive: Fields, attributes: dict[str, int]) -> int:
    """The highest SH degree. Each has all of its coefficients, and so have those below."""
    there = [[name in attributes for name in _coefficient_names(degree)] for degree in range(1, 4)]
    degree = max((k + 1 for k, found in enumerate(there) if any(found)), default=0)
    if not all(all(found) for found in there[:degree]):
        raise primitive.fail("attributes", f"SH of degree {degree} with coefficients missing", "give all or none")
    return degree


def _coefficient_names(degree: int) -> list[str]:
    return [f"SH_DEGREE_{degree}_COEF_{i}" for i in range(2 * degree + 1)]


def _read_primitive(document: Document, primitive: Fields) -> SplatCloud:
    attributes = _checked(primitive)
    degree = _degree(primitive, attributes)
    count = accessor_count(document, attributes["POSITION"], primitive)

    def column(name: str, width: int) -> NDArray[np.generic]:
        array = read_accessor(document, attributes[name], primitive)
        if array.shape != (count, width):
            raise primitive.fail("attributes", f"{name} of shape {array.shape}, expected {(count, width)}")
        return array

    means, quats, scales = column("POSITION", 3), column("ROTATION", 4), column("SCALE", 3)
    opacities = column("OPACITY", 1)
    sh = [column(name, 3) for band in range(degree + 1) for name in _coefficient_names(band)]
    builder = CloudBuilder(document.path, count, COEFFICIENTS[degree])
    for first in range(0, count, ROWS):
        rows = slice(first, min(first + ROWS, count))
        slot = builder.slot(rows.stop - first)
        slot.means[:] = means[rows]
        slot.quats[:, 1:] = quats[rows, :3]  # stored xyzw
        slot.quats[:, 0] = quats[rows, 3]
        slot.scales[:] = scales[rows]
        slot.opacities[:] = opacities[rows, 0]
        for k, coefficient in enumerate(sh):
            slot.sh[:, k] = coefficient[rows]
        builder.commit(slot)
    return replace(builder.cloud(), color_space=_space(primitive))
