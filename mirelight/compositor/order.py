"""Depth order and other stable sorts by small keys."""

from __future__ import annotations

from mirelight.compositor.device import Array, Device

DIGIT = 14  # bits of a depth that a counting pass sorts by; its histogram stays in the first-level cache


def counting_permutation(device: Device, values: Array, bits: int, most: int = 32) -> Array:
    """Stable permutation that sorts uint32 `values` < 2^bits, in passes of at most `most` bits and the device's digit.

    `dr.detail.block_mkperm` is internal to Dr.Jit, whose version is pinned for it; a test compares it with
    `drjit.argsort`, which is two to three times slower.
    """
    dr, UInt32 = device.dr, device.types.UInt32
    passes = max(1, -(-bits // min(most, device.digit)))
    width = max(1, -(-bits // passes))
    order = dr.detail.block_mkperm(_digit(device, values, 0, width, bits), len(values), 1 << width)
    for i in range(1, passes):
        digit = _digit(device, dr.gather(UInt32, values, order), i * width, width, bits)
        order = dr.gather(UInt32, order, dr.detail.block_mkperm(digit, len(values), 1 << width))
        dr.eval(order)
    return order


def _digit(device: Device, values: Array, low: int, width: int, bits: int) -> Array:
    """The `width` bits from `low` on, of values of that many `bits` in all."""
    dr, UInt32 = device.dr, device.types.UInt32
    if width < bits:
        values = (values >> dr.opaque(UInt32, low)) & dr.opaque(UInt32, (1 << width) - 1)
    dr.eval(values)
    return values


def depth_order(device: Device, key: Array, visible: Array) -> Array:
    """Indices of the visible splats, by ascending key; equal keys keep the cloud's order."""
    dr, UInt32 = device.dr, device.types.UInt32
    order = dr.compress(visible)
    if len(order) == 0:
        return order
    keys = dr.gather(UInt32, key, order)
    dr.eval(keys)
    low, high = dr.min(keys), dr.max(keys)
    dr.eval(low, high)
    span = int((high - low)[0])
    keys = keys - dr.opaque(UInt32, int(low[0]))
    order = dr.gather(UInt32, order, counting_permutation(device, keys, span.bit_length(), DIGIT))
    dr.eval(order)
    return order
