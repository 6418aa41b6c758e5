"""Sample points: Owen-scrambled Sobol' pairs, padded by hashing, without any state.

Every pair is a function of (pixel, sample index, dimension, seed), so an image does not depend on how its samples are
cut into passes and threads. Scrambling follows Burley, "Practical Hash-based Owen Scrambling" (JCGT 9-4, 2020).
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from mirelight.lighting.kernel.types import Float, Point2f, UInt32


def mix(value: UInt32, salt: UInt32 | int) -> UInt32:
    """A 32-bit hash of two UInt32 (Wellons' lowbias32 finaliser over their combination)."""
    x = value + salt * mi.UInt32(0x9E3779B9)
    x = (x ^ (x >> 16)) * mi.UInt32(0x7FEB352D)
    x = (x ^ (x >> 15)) * mi.UInt32(0x846CA68B)
    return x ^ (x >> 16)


def _scramble_reversed(x: UInt32, seed: UInt32) -> UInt32:
    """Owen scrambling of a number whose digits are in reverse order (the Laine-Karras hash with Burley's constants)."""
    x = x + seed
    for factor in (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6):
        x = x ^ (x * mi.UInt32(factor))
    return x


def _second_sobol_reversed(index: UInt32) -> UInt32:
    """Sobol's second dimension, digits reversed: Pascal's triangle modulo 2 applied to the index's bits."""
    x = index
    for shift, mask in ((16, 0xFFFF0000), (8, 0xFF00FF00), (4, 0xF0F0F0F0), (2, 0xCCCCCCCC), (1, 0xAAAAAAAA)):
        x = x ^ ((x & mi.UInt32(mask)) >> shift)
    return x


def _unit_float(bits: UInt32) -> Float:
    """[0, 1) from the upper 24 bits."""
    return mi.Float(bits >> 8) * mi.Float(2.0**-24)


def pair(index: UInt32, seed: UInt32) -> Point2f:
    """The `index`-th point of a scrambled, shuffled (0, 2)-sequence chosen by `seed`; Point2f in [0, 1)²."""
    shuffled = dr.brev(_scramble_reversed(dr.brev(index), seed))
    x = dr.brev(_scramble_reversed(shuffled, mix(seed, 1)))
    y = dr.brev(_scramble_reversed(_second_sobol_reversed(shuffled), mix(seed, 2)))
    return mi.Point2f(_unit_float(x), _unit_float(y))


def stratified(index: UInt32, seed: UInt32) -> Float:
    """The first coordinate of `pair` alone."""
    shuffled = dr.brev(_scramble_reversed(dr.brev(index), seed))
    return _unit_float(dr.brev(_scramble_reversed(shuffled, mix(seed, 1))))


def number(index: UInt32, seed: UInt32) -> Float:
    """An independent uniform number in [0, 1)."""
    return _unit_float(mix(mix(index, 3), seed))
