"""Depth order and other stable sorts by small keys."""

from __future__ import annotations

from mirelight.compositor.device import Array, Device

DIGIT = 14  # bits a counting pass sorts by; its histogram stays in the first-level cache


def counting_permutation(device: Device, values: Array, bits: int) -> Array:
    """Stable permutation that sorts uint32 `values` < 2^bits.

    `dr.detail.block_mkperm` is internal to Dr.Jit, whose version is pinned for it; a test compares it with
    `drjit.argsort`, which is two to three times slower.
    """
    return device.dr.detail.block_mkperm(values, len(values), 1 << bits)


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
    low = dr.opaque(UInt32, int(low[0]))
    passes = max(1, -(-span.bit_length() // DIGIT))
    bits = max(1, -(-span.bit_length() // passes))
    for i in range(passes):
        if i:
            keys = dr.gather(UInt32, key, order)
        digit = ((keys - low) >> dr.opaque(UInt32, i * bits)) & dr.opaque(UInt32, (1 << bits) - 1)
        dr.eval(digit)
        order = dr.gather(UInt32, order, counting_permutation(device, digit, bits))
        dr.eval(order)
    return order
