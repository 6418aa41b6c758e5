"""Films of frames: one after the other, at a steady rate."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mirelight.apps.show.encoders import Write
from mirelight.apps.show.shots import Shot
from mirelight.base.errors import InputError
from mirelight.base.progress import CountProgress
from mirelight.io.atomic import atomic_path

Order = Literal["cameras", "lightings"]  # what runs first

_FASTEST = 1000
_RATE = re.compile(r"[0-9]{1,9}(?:[./][0-9]{1,9})?")


@dataclass(frozen=True, slots=True)
class Film:
    """The film that was written."""

    count: int  # pictures
    size: tuple[int, int]  # width and height of the frames, pixels
    seconds: float


def rate_of(text: str) -> Fraction:
    """Pictures a second from text: 24, 23.976 or 24000/1001.

    Raises:
        InputError: no such number.
    """
    rate = Fraction(0)
    if _RATE.fullmatch(text.strip()):
        with suppress(ZeroDivisionError):
            rate = Fraction(text.strip()).limit_denominator(1001)
    if not 0 < rate <= _FASTEST:
        raise InputError("--fps", text, "give pictures a second: 24, 23.976 or 24000/1001")
    return rate


def ordered(shots: Sequence[Shot], order: Order) -> list[Shot]:
    """Frames in the order of a film: all cameras under a lighting, then the next lighting; or the other way."""
    other = "lighting" if order == "cameras" else "camera"
    groups = {name: i for i, name in enumerate(dict.fromkeys(getattr(x, other) for x in shots))}
    return sorted(shots, key=lambda x: groups[getattr(x, other)])


def write_film(
    shots: Sequence[Shot],
    path: Path,
    rate: Fraction,
    write: Write,
    report: CountProgress | None = None,
) -> Film:
    """Write frames as a film. One is held at a time, but for GIF.

    Args:
        shots: in order, all of one size.
        path: of the film; appears whole or not at all.
        rate: pictures a second.
        write: from `mirelight.apps.show.encoders`.
        report: called with (pictures done, pictures in all).

    Raises:
        InputError: no frames, or of different sizes. OutputError: the film cannot be written.
    """
    if not shots:
        raise InputError("film", "no frames to show", "name a folder or picture files")
    frames = _Frames(shots, report)
    with atomic_path(path) as temporary:
        write(frames, temporary, rate)
    return Film(len(shots), frames.size, float(len(shots) / rate))


class _Frames:
    """The pictures of shots, which must be of one size."""

    def __init__(self, shots: Sequence[Shot], report: CountProgress | None) -> None:
        self._shots, self._report = shots, report
        height, width = shots[0].pixels().shape[:2]
        self.size = width, height

    def __len__(self) -> int:
        return len(self._shots)

    def __getitem__(self, i: int) -> NDArray[np.uint8]:
        shot = self._shots[i]
        pixels = shot.pixels()
        height, width = pixels.shape[:2]
        if (width, height) != self.size:
            first, own = f"{self.size[0]} x {self.size[1]}", f"{width} x {height}"
            found = f"{own} pixels, and {self._shots[0].name} has {first}"
            raise InputError(shot.name, found, "a film has one size; choose with --camera")
        if self._report is not None:
            self._report(i + 1, len(self._shots))
        return pixels
