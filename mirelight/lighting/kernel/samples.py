"""Sample points: Owen-scrambled Sobol' pairs, padded by hashing, without any state.

Every pair is a function of (pixel, sample index, dimension, seed), so an image does not depend on how its samples are
cut into passes and threads. Scrambling follows Burley, "Practical Hash-based Owen Scrambling" (JCGT 9-4, 2020).
"""

from __future__ import annotations

from typing import NamedTuple

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


class Tiles(NamedTuple):
    """Which pixels share a sequence."""

    log2_side: UInt32  # of a tile, pixels, 8 at most; 0: each pixel has a sequence of its own
    log2_samples: UInt32  # of a pixel, at least as many as it gets


def of_pixel(x: UInt32, y: UInt32, tiles: Tiles) -> tuple[UInt32, UInt32]:
    """(index of the first sample of the pixel at column x and row y, number of its tile), in Z order within a tile.

    Pixels of an aligned block then have an aligned piece of the sequence, so what is averaged over neighbours, as eyes
    and denoisers do, errs less than over pixels that know nothing of each other (Ahmed and Wonka, "Screen-space
    blue-noise diffusion of Monte Carlo sampling error via hierarchical ordering of pixels", SIGGRAPH Asia 2020).
    """
    inside = (mi.UInt32(1) << tiles.log2_side) - 1
    first = (_apart(x & inside) | (_apart(y & inside) << 1)) << tiles.log2_samples
    return first, ((y >> tiles.log2_side) << 16) | (x >> tiles.log2_side)


def _apart(x: UInt32) -> UInt32:
    """A byte's bits, on every second place of two bytes."""
    for shift, mask in ((4, 0x0F0F), (2, 0x3333), (1, 0x5555)):
        x = (x | (x << shift)) & mi.UInt32(mask)
    return x


def number(index: UInt32, seed: UInt32) -> Float:
    """An independent uniform number in [0, 1)."""
    return _unit_float(mix(mix(index, 3), seed))
