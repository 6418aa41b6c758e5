"""IES files: measured luminaires (ANSI/IES LM-63, editions 1986 to 2019; photometry of Type C)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirelight.base.errors import InputError
from mirelight.io.safety import BRIGHTEST, read_bytes
from mirelight.model import F32, F64
from mirelight.model.ies import AROUND, DOWN

_MOST_BYTES = 8 << 20
_DAMAGED = "the file is damaged"
_EDITION = re.compile(r"IES(?:NA)?\s*:?\s*LM-63-(\d{4})", re.IGNORECASE)  # the first line's; before 1995 it has others


@dataclass(frozen=True, slots=True, eq=False)
class IesFile:
    """What a file says of its luminaire."""

    share: F32  # (AROUND, DOWN) as `IesProfile.share`
    peak: float  # candela of the brightest direction


def read_ies(path: str | Path) -> IesFile:
    """Read an .ies file. Where nothing was measured, it is dark; between angles, candela are linear.

    Raises:
        InputError: no such file, of Type A or B, damaged, or without any light.
    """
    path = Path(path)
    lines = read_bytes(path, _MOST_BYTES).decode("latin-1").splitlines()
    at = next((i for i, line in enumerate(lines) if line.strip().upper().startswith("TILT=")), None)
    if at is None:
        raise InputError(path, "no line TILT=", "give a photometric file of LM-63 (.ies)")
    tilt = lines[at].strip()[5:].strip().upper()
    if tilt not in ("NONE", "INCLUDE"):
        raise InputError(path, "its tilt stands in another file", "give a file with TILT=NONE or TILT=INCLUDE")
    numbers = _Numbers(path, " ".join(lines[at + 1 :]).replace(",", " ").split())
    if tilt == "INCLUDE":
        numbers.take(1)  # lamp to luminaire
        numbers.take(2 * numbers.count("tilt angles"))
    _, _, multiplier = numbers.take(3)
    down, around = numbers.count("vertical angles"), numbers.count("horizontal angles")
    kind = numbers.take(1)[0]
    if kind != 1:
        name = {2: "B", 3: "A"}.get(int(kind), f"number {kind:g}")
        raise InputError(path, f"photometry of type {name}", "only type C is read; export it as that")
    numbers.take(4)  # units and size of the opening
    ballast, factor, _ = numbers.take(3)
    if _edition(lines) >= 2019:  # the number tells how the file came about; before, it was a factor of lamp and ballast
        factor = 1.0
    vertical, horizontal = _angles(path, numbers.take(down), 180), _angles(path, numbers.take(around), 360)
    with np.errstate(over="ignore"):
        candela = numbers.take(down * around).reshape(around, down) * (multiplier * ballast * factor)
    peak = float(candela.max())
    if not (np.isfinite(candela).all() and candela.min() >= 0 and peak <= BRIGHTEST):
        raise InputError(path, "candela that are negative or too large", _DAMAGED)
    if peak == 0:
        raise InputError(path, "a luminaire without light", "give another file")
    return IesFile(np.asarray(_everywhere(path, vertical, horizontal, candela) / peak, dtype=np.float32), peak)


def _edition(lines: list[str]) -> int:
    """The year of the standard that a file says it follows; 0 where it says none."""
    found = _EDITION.match(lines[0].strip()) if lines else None
    return 0 if found is None else int(found[1])


class _Numbers:
    """The file's numbers, one after the other."""

    def __init__(self, path: Path, words: list[str]) -> None:
        self._path, self._words, self._at = path, words, 0

    def take(self, count: int) -> F64:
        """The next `count` numbers of the file (count,)."""
        words = self._words[self._at : self._at + count]
        if len(words) < count:
            raise InputError(self._path, f"{len(self._words)} numbers after TILT, and more are promised", _DAMAGED)
        self._at += count
        try:
            found = np.array([float(word) for word in words])
        except ValueError:
            raise InputError(self._path, "words where numbers are expected", _DAMAGED) from None
        if not np.isfinite(found).all():
            raise InputError(self._path, "numbers that are not finite", _DAMAGED)
        return found

    def count(self, what: str) -> int:
        """The next number, a count of what follows."""
        value = self.take(1)[0]
        if not (value == int(value) and 1 <= value <= len(self._words)):
            raise InputError(self._path, f"{value:g} {what}", _DAMAGED)
        return int(value)


def _angles(path: Path, angles: F64, most: int) -> F64:
    if not (np.all(np.diff(angles) > 0) and angles[0] >= 0 and angles[-1] <= most):
        raise InputError(path, f"angles that do not rise from 0 to {most}", "only type C is read; export it as that")
    return angles


def _everywhere(path: Path, vertical: F64, horizontal: F64, candela: F64) -> F64:
    """(AROUND, DOWN) candela; planes that are left out for symmetry are filled in (LM-63, "Horizontal angles")."""
    theta, phi = np.linspace(0, 180, DOWN), np.arange(AROUND) * (360 / AROUND)
    planes = np.stack([np.interp(theta, vertical, plane, left=0, right=0) for plane in candela])
    first, last = float(horizontal[0]), float(horizontal[-1])
    if len(horizontal) == 1:
        return np.repeat(planes, AROUND, axis=0)
    if first == 90 and last == 270:  # alike on both sides of the plane through 90 and 270
        phi = np.where(phi < 90, 180 - phi, np.where(phi > 270, 540 - phi, phi))
    elif first != 0:
        raise InputError(path, f"horizontal angles from {first:g} to {last:g}", _DAMAGED)
    elif last == 90:  # four quarters alike
        phi = 90 - np.abs(phi % 180 - 90)
    elif last == 180:  # two halves alike
        phi = 180 - np.abs(phi - 180)
    elif last > 180:  # all around
        if last < 360:
            horizontal, planes = np.append(horizontal, 360.0), np.concatenate([planes, planes[:1]])
    else:
        raise InputError(path, f"horizontal angles from {first:g} to {last:g}", _DAMAGED)
    at = np.clip(np.searchsorted(horizontal, phi, side="right") - 1, 0, len(horizontal) - 2)
    share = ((phi - horizontal[at]) / (horizontal[at + 1] - horizontal[at]))[:, None]
    return np.asarray(planes[at] * (1 - share) + planes[at + 1] * share)
