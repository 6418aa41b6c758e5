"""Colours in 32 bits: three mantissas of 9 bits and one exponent of 5 (the format RGB9_E5 of OpenGL ES 3.0, section
3.8.3.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, F64

_BIAS, _BITS = 15, 9
LARGEST = 511 / 512 * 2.0**16
_TOP = 256.0  # the largest value of a layer as it is packed: 2^-23 of it is still told from 0


def encode(color: F32) -> NDArray[np.uint32]:
    """(..., 3) not negative, clipped at 65408 -> (...) packed, each channel within 1/512 of the largest one."""
    clipped = np.clip(np.nan_to_num(color.astype(np.float64)), 0, LARGEST)
    top = clipped.max(axis=-1)
    _, exponent = np.frexp(np.maximum(top, 2.0**-_BIAS / 2))  # top < 2^exponent
    shared = np.clip(exponent + _BIAS, 0, 31)
    rounded = np.floor(top / np.exp2(shared - _BIAS - _BITS) + 0.5)
    shared = np.where(rounded >= 2**_BITS, shared + 1, shared)
    mantissas = np.floor(clipped / np.exp2(shared - _BIAS - _BITS)[..., None] + 0.5).astype(np.uint32)
    r, g, b = (mantissas[..., k] for k in range(3))
    return np.asarray(r | g << 9 | b << 18 | shared.astype(np.uint32) << 27, dtype=np.uint32)


def decode(packed: NDArray[np.uint32]) -> F32:
    """The reverse, exact: (...) -> (..., 3)."""
    mantissas = np.stack([packed >> np.uint32(9 * k) & np.uint32(511) for k in range(3)], axis=-1)
    scale = np.exp2((packed >> np.uint32(27)).astype(np.float64) - _BIAS - _BITS)
    return np.asarray(mantissas * scale[..., None], dtype=np.float32)


def packed_layer(values: F32) -> tuple[float, bytes]:
    """One layer (N, 3) as a page takes it: its scale, and (N,) RGB9E5 over that, little-endian."""
    packed, scales = pack(values[None])
    return float(scales[0]), packed[0].astype("<u4").tobytes()


def pack(values: F32) -> tuple[NDArray[np.uint32], F64]:
    """(L, N, 3) layers -> (L, N) RGB9E5 of each over its scale, a power of two; (L,) the scales."""
    top = values.max(axis=(1, 2), initial=0.0).astype(np.float64)
    scales = np.exp2(np.ceil(np.log2(np.where(top > 0, top, _TOP) / _TOP)))
    return np.stack([encode(v / np.float32(s)) for v, s in zip(values, scales, strict=True)]), scales
