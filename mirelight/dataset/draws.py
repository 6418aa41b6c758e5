"""Frames under lightings that nobody listed, drawn by a seed; and which frames are held out."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np

from mirelight.base.errors import InputError
from mirelight.dataset.view import DataSet, Sample
from mirelight.model import F32, HeldOut


@dataclass(frozen=True, slots=True)
class Draws:
    """`count` frames of a data set under random strengths of its lights: `draws[i]` depends on seed and `i` alone, so
    that any worker may make any of them. It has a length and can be iterated.

    A frame has a random camera, and objects stand in one of the job's ways. Each unit light is on with probability
    `lit` (one at least is), as strong as the
    brightest lighting of the job has it, times 2 to a power that is uniform in ±`stops`.

    Raises:
        InputError: every lighting of the job is off, which leaves nothing to draw.
        ValueError: `count` or `stops` below 0, or `lit` outside 0 to 1.
    """

    data: DataSet
    count: int
    seed: int = 0
    lit: float = 0.5  # 0 to 1
    stops: float = 2.0

    def __post_init__(self) -> None:
        if not (self.count >= 0 and 0 <= self.lit <= 1 and self.stops >= 0):
            found = f"count {self.count}, lit {self.lit:g}, stops {self.stops:g}"
            raise ValueError(f"{found}; give a count and stops of at least 0, and a share lit of 0 to 1")
        if not self.data.strongest.any():
            raise InputError(self.data.folder, "no lighting with any light", "give one an intensity above 0")

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[Sample]:
        return (self[i] for i in range(self.count))

    def part(self, index: int, of: int) -> Iterator[Sample]:
        """Every `of`-th frame from number `index` on: the part of one of `of` workers, so that none is made twice."""
        return (self[i] for i in range(index, self.count, of))

    def __getitem__(self, i: int) -> Sample:
        if not 0 <= i < self.count:
            raise IndexError(f"draw {i} of {self.count}")
        stream = np.random.Generator(np.random.PCG64([self.seed, i]))
        camera = int(stream.integers(len(self.data.cameras)))
        strengths, ways = self.data.strongest, len(self.data.index.arrangements)
        arrangement = int(stream.integers(ways)) if ways > 1 else 0
        able = self.data.lights_in(arrangement)
        able = able[strengths[able].any(axis=1)]
        on = stream.random(len(able)) < self.lit
        on[stream.integers(len(able))] = True
        factors = np.zeros((len(strengths), 1), dtype=np.float32)
        factors[able, 0] = on * np.exp2(stream.uniform(-self.stops, self.stops, len(able)))
        weights: F32 = strengths * factors
        return Sample(self.data.frame(camera, weights), weights, camera, -1)


@dataclass(frozen=True, slots=True)
class Split:
    """Indices of a data set's frames in four parts; with `by` "camera" or "lighting", two of them are empty."""

    seen: tuple[int, ...]  # to train on
    novel_view: tuple[int, ...]  # a camera that was held out, a lighting that was not
    novel_light: tuple[int, ...]
    novel_both: tuple[int, ...]


def split(data: DataSet, by: HeldOut, held_out: float = 0.2, seed: int = 0) -> Split:
    """Hold out cameras, lightings or both, by a hash of their names and the seed: what is added later moves none.

    Args:
        data: a data set.
        by: what is held out.
        held_out: the share of names, 0 to 1, in the mean of many.
        seed: another seed, another choice.

    Raises:
        ValueError: another `by`, or a share outside 0 to 1.
    """
    if by not in get_args(HeldOut) or not 0 <= held_out <= 1:
        raise ValueError(f"{by!r}, {held_out:g}; give one of {', '.join(get_args(HeldOut))}, and a share of 0 to 1")
    cameras = _held([x.name for x in data.cameras], "camera", held_out if by != "lighting" else 0, seed)
    lightings = _held(data.lightings, "lighting", held_out if by != "camera" else 0, seed)
    parts: dict[tuple[bool, bool], list[int]] = {(a, b): [] for a in (False, True) for b in (False, True)}
    for i in range(len(data)):
        camera, lighting = divmod(i, len(lightings))
        parts[cameras[camera], lightings[lighting]].append(i)
    seen, light = tuple(parts[False, False]), tuple(parts[False, True])
    return Split(seen, tuple(parts[True, False]), light, tuple(parts[True, True]))


def _held(names: Sequence[str], kind: str, share: float, seed: int) -> list[bool]:
    digests = [hashlib.sha256(f"{seed} {kind} {name}".encode()).digest() for name in names]
    return [int.from_bytes(d[:6], "big") / 2**48 < share for d in digests]
