"""EXT_meshopt_compression, by the optional package `meshopt` (a binding of meshoptimizer's decoder)."""

from __future__ import annotations

import numpy as np

from mirelight.base import extras
from mirelight.io.gltf.fields import Bytes, Fields

_MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
_FILTERS = ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR")
_MOST_EXPANSION = 2048  # bytes out per byte in; the format's own limit is about half of it


def decompress(packed: Fields, data: Bytes, length: int) -> Bytes:
    """The bytes that a compressed buffer view stands for.

    Args:
        packed: the buffer view's extension object.
        data: the compressed bytes.
        length: bytes that the plain buffer view has.

    Raises:
        InputError: the decoder is not installed, or the data is damaged.
    """
    stride, count = packed.integer("byteStride", low=1, high=256), packed.integer("count", low=1)
    mode, how = packed.text("mode"), packed.text("filter", "NONE")
    if mode not in _MODES or how not in _FILTERS:
        raise packed.fail("mode", f"mode {mode[:20]!r}, filter {how[:20]!r}", "the file is damaged")
    if stride * count > length or stride * count > _MOST_EXPANSION * len(data):
        raise packed.fail("count", f"{count} elements of {stride} bytes do not fit", "the file is damaged")
    try:
        import meshopt
    except ImportError:
        raise packed.fail("", "meshopt compression", extras.remedy("formats")) from None
    try:
        plain = meshopt.decode_gltf_buffer(bytes(data), count, stride, mode, None if how == "NONE" else how)
    except (ValueError, RuntimeError, TypeError):
        raise packed.fail("", "meshopt data that cannot be decoded", "the file is damaged") from None
    out = np.zeros(length, dtype=np.uint8)
    out[: stride * count] = np.ascontiguousarray(plain).view(np.uint8).reshape(-1)
    return out
