"""glTF accessors as NumPy arrays: any component type, stride, normalisation, sparse substitution (glTF §3.6.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.gltf.document import Document
from mirelight.io.gltf.fields import Bytes, Fields

_TYPES: dict[int, type[np.generic]] = {
    5120: np.int8,
    5121: np.uint8,
    5122: np.int16,
    5123: np.uint16,
    5125: np.uint32,
    5126: np.float32,
}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_MAX_IMPLICIT = 1 << 26  # bytes of all accessors of a file that no bytes stand behind


def accessor_width(document: Document, index: int, user: Fields | None = None) -> int:
    """Components per element of ``accessors[index]``, e.g. 3 for VEC3."""
    entry = document.entry("accessors", index, user)
    kind = entry.text("type")
    if kind not in _WIDTHS:
        raise entry.fail("type", f"{kind[:20]!r}", "expected one of " + ", ".join(_WIDTHS))
    return _WIDTHS[kind]


def accessor_count(document: Document, index: int, user: Fields | None = None) -> int:
    """Elements of ``accessors[index]``, without reading them."""
    return document.entry("accessors", index, user).integer("count", low=1)


def read_accessor(document: Document, index: int, user: Fields | None = None) -> NDArray[Any]:
    """``accessors[index]`` as an array (count, components), a view of the file where it can be.

    Normalised integers come as float32 in 0..1 or -1..1; all others in their own type, so that integer positions of
    KHR_mesh_quantization only need `astype`. MAT2 and MAT3 lose their padding; matrices stay column-major.

    Args:
        document: the open file.
        index: which accessor.
        user: the object that refers to it, named where the index is bad.

    Raises:
        InputError: it reaches outside its buffer view, or a field is missing or of the wrong kind.
    """
    entry = document.entry("accessors", index, user)
    dtype, width = _component_type(entry), accessor_width(document, index, user)
    count = entry.integer("count", low=1)
    view = entry.integer("bufferView", None)
    if view is not None:
        values = _elements(document, entry, view, count, dtype, entry.text("type"), width)
    elif document.takes_implicit(count * width * dtype.itemsize, _MAX_IMPLICIT):
        values = np.zeros((count, width), dtype=dtype)
    else:
        remedy = f"at most {_MAX_IMPLICIT >> 20} MiB of such zeros are read"
        raise entry.fail("count", f"{count} elements without a bufferView", remedy)
    if "sparse" in entry:
        values = _substitute(document, entry.child("sparse"), values, dtype, entry.text("type"))
    return denormalised(values) if entry.flag("normalized") else values


def _component_type(entry: Fields) -> np.dtype[Any]:
    code = entry.integer("componentType")
    if code not in _TYPES:
        raise entry.fail("componentType", f"{code}", "expected one of " + ", ".join(str(x) for x in _TYPES))
    return np.dtype(_TYPES[code]).newbyteorder("<")


def _elements(
    document: Document, entry: Fields, view: int, count: int, dtype: np.dtype[Any], kind: str, width: int
) -> NDArray[Any]:
    """(count, width) strided view of a buffer view's bytes, bounds checked."""
    data = document.view(view, entry)
    offset = entry.integer("byteOffset", 0)
    element, stored = _layout(dtype, kind, width)
    stride = document.entry("bufferViews", view).integer("byteStride", 0, high=252) or element
    end = offset + (count - 1) * stride + element
    if stride < element:
        raise entry.fail("bufferView", f"byteStride {stride} is smaller than an element of {element} bytes")
    if end > len(data):
        found = f"{count} elements need {end} bytes, the buffer view has {len(data)}"
        raise entry.fail("count", found, "the file is damaged")
    return _strided(data, offset, count, stride, dtype, stored)


def _layout(dtype: np.dtype[Any], kind: str, width: int) -> tuple[int, NDArray[np.intp]]:
    """Bytes of an element and the byte offsets of its components: matrix columns start on 4 bytes (glTF §3.6.2.4)."""
    rows = {"MAT2": 2, "MAT3": 3, "MAT4": 4}.get(kind, width)
    column = rows * dtype.itemsize
    pitch = -(-column // 4) * 4 if kind.startswith("MAT") else column
    i = np.arange(width)
    offsets = (i // rows) * pitch + (i % rows) * dtype.itemsize
    return pitch * (width // rows), offsets


def _strided(
    data: Bytes, offset: int, count: int, stride: int, dtype: np.dtype[Any], offsets: NDArray[np.intp]
) -> NDArray[Any]:
    size, width = dtype.itemsize, len(offsets)
    aligned = (data.__array_interface__["data"][0] + offset) % size == 0 and stride % size == 0
    dense = bool(np.array_equal(offsets, np.arange(width) * size))
    if aligned and dense:
        return np.ndarray((count, width), dtype, buffer=data, offset=offset, strides=(stride, size))
    # Unaligned or padded: gather the bytes component by component.
    rows = np.ndarray((count, int(offsets[-1]) + size), np.uint8, buffer=data, offset=offset, strides=(stride, 1))
    out = np.empty((count, width), dtype)
    for i, at in enumerate(offsets):
        out[:, i] = np.ascontiguousarray(rows[:, at : at + size]).view(dtype)[:, 0]
    return out


def _substitute(
    document: Document, sparse: Fields, values: NDArray[Any], dtype: np.dtype[Any], kind: str
) -> NDArray[Any]:
    """A copy of `values` with the sparse rows put in (glTF §3.6.2.3)."""
    count = sparse.integer("count", low=1, high=len(values))
    where, what = sparse.child("indices"), sparse.child("values")
    index_type = _component_type(where)
    if index_type.kind != "u":
        raise where.fail("componentType", f"{where.integer('componentType')}", "expected an unsigned integer type")
    rows = _elements(document, where, where.integer("bufferView"), count, index_type, "SCALAR", 1)[:, 0]
    if int(rows.max()) >= len(values):
        raise where.fail("bufferView", f"index {int(rows.max())} of {len(values)} elements", "the file is damaged")
    out = values.copy()
    out[rows] = _elements(document, what, what.integer("bufferView"), count, dtype, kind, values.shape[1])
    return out


def denormalised(values: NDArray[Any]) -> NDArray[Any]:
    """glTF §3.6.2.2: c / max for unsigned, max(c / max, -1) for signed integers; float32."""
    if values.dtype.kind == "f":
        return values
    scaled = values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max)
    return np.maximum(scaled, np.float32(-1)) if values.dtype.kind == "i" else scaled
