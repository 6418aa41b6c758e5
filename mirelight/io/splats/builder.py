"""A cloud that is filled slice by slice: the result is allocated once, and nothing else of its size is."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.io.safety import require_memory
from mirelight.model import F32, SplatCloud

FARTHEST = 1e9  # world units: no position or size of a splat is larger, as none in a job is
BRIGHTEST = 1e4  # no coefficient of a display-encoded colour is larger: as light it is 4e9 there
FAINTEST = 1e-4  # opacity: thousands of such splats one behind the other would not be seen

_UNIT = 4e-7  # of the square of a length: three steps of single precision
ROWS = 1 << 13  # splats converted at a time; their values stay in the processor's cache


class Slot(NamedTuple):
    """Views of the next n splats of a cloud in the making, to be written in place with activated values."""

    means: F32  # (n, 3)
    quats: F32  # (n, 4) wxyz, any length
    scales: F32  # (n, 3)
    opacities: F32  # (n,)
    sh: F32  # (n, K, 3)


def cloud_bytes(count: int, coefficients: int) -> int:
    """Bytes of a SplatCloud of `count` splats with K `coefficients`."""
    return 4 * count * (3 + 4 + 3 + 1 + 3 * coefficients)


class CloudBuilder:
    """Collects splats: write into :meth:`slot`, then :meth:`commit`.

    A splat with a NaN, or with an infinite or absurdly large position, scale, rotation or colour, whose squares have no
    place in single precision, is dropped and counted. A rotation of length zero has no direction at all and becomes the
    identity, as splat-transform reads it. Opacity is clipped to 0–1 and scales lose their sign, which the Gaussian does
    not see.
    """

    def __init__(self, file: Path, capacity: int, coefficients: int) -> None:
        """Allocate room for `capacity` splats with K `coefficients`.

        Raises:
            InputError: there are none, or more than fit into memory.
        """
        if capacity < 1:
            raise InputError(file, "no splats in it", "give a capture")
        require_memory(file, cloud_bytes(capacity, coefficients), f"{capacity:,} splats")
        self._file = file
        self._whole = Slot(
            means=np.empty((capacity, 3), dtype=np.float32),
            quats=np.empty((capacity, 4), dtype=np.float32),
            scales=np.empty((capacity, 3), dtype=np.float32),
            opacities=np.empty(capacity, dtype=np.float32),
            sh=np.empty((capacity, coefficients, 3), dtype=np.float32),
        )
        self._filled = 0
        self._dropped = 0

    def slot(self, count: int) -> Slot:
        """Views of the next `count` splats."""
        here = slice(self._filled, self._filled + count)
        return Slot(*(array[here] for array in self._whole))

    def commit(self, slot: Slot) -> None:
        """Accept what was written into the slot last handed out."""
        with np.errstate(over="ignore", invalid="ignore"):
            _normalise(slot.quats)
            np.abs(slot.scales, out=slot.scales)
            np.clip(slot.opacities, 0, 1, out=slot.opacities)
            good = _sound(slot)
        kept = int(np.count_nonzero(good))
        if kept < len(good):
            for array in slot:
                array[:kept] = array[good]
        self._filled += kept
        self._dropped += len(good) - kept

    def cloud(self, *, antialiased: bool = False) -> SplatCloud:
        """The finished cloud; the builder is not used afterwards.

        Raises:
            InputError: every splat was dropped, or none of them shows.
        """
        if not self._filled:
            found = f"all {self._dropped:,} splats hold NaN, infinite or absurd values"
            raise InputError(self._file, found, "check the file")
        means, quats, scales, opacities, sh = (array[: self._filled] for array in self._whole)
        if not opacities.max() > FAINTEST:
            raise InputError(self._file, f"no splat shows: every opacity is below {FAINTEST:g}", "check the file")
        return SplatCloud(
            means=means,
            quats=quats,
            scales=scales,
            opacities=opacities,
            sh=sh,
            dropped=self._dropped,
            antialiased=antialiased,
        )


def _normalise(quats: F32) -> None:
    """Scale rotations to length 1 in place; length zero becomes the identity, infinite ones become NaN. What has that
    length in single precision stays as it is, bit for bit, so that a cloud that was written comes back."""
    square = np.einsum("ij,ij->i", quats, quats)
    odd = ~((square > 1e-30) & (square < 1e30))  # where float32 squares lose their meaning, and NaN
    if odd.any():
        quats[odd] = _normalised_extremes(quats[odd])
        square[odd] = 1
    quats *= np.where(np.abs(square - 1) < _UNIT, np.float32(1), 1 / np.sqrt(square))[:, None]


def _normalised_extremes(quats: F32) -> NDArray[np.float64]:
    q = quats.astype(np.float64)
    length = np.linalg.norm(q, axis=1, keepdims=True)
    q[length[:, 0] == 0] = (1, 0, 0, 0)
    length[length == 0] = 1
    return np.asarray(q / length)


def _sound(slot: Slot) -> NDArray[np.bool_]:
    """(n,) true where every value is finite and within bounds. A look at whole tables tells nearly always."""
    tables = (slot.means, FARTHEST), (slot.scales, FARTHEST), (slot.sh.reshape(len(slot.sh), -1), BRIGHTEST)
    good = np.isfinite(slot.opacities) & np.isfinite(np.einsum("ij->i", slot.quats))
    for table, most in tables:
        if not (table.min(initial=0) >= -most and table.max(initial=0) <= most):  # NaN is neither
            good &= (np.abs(table) <= most).all(axis=1)
    return np.asarray(good)
