"""Linear RGB colour spaces by their primaries, and the matrices between them; NumPy only.

A space is eight CIE 1931 chromaticities, x and y of red, green, blue and white, as OpenEXR's `chromaticities` holds
them. White points are adapted by Bradford's matrix, as the ACES transforms of OpenColorIO do (their names end in BFD).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

F32: TypeAlias = NDArray[np.float32]
F64: TypeAlias = NDArray[np.float64]
Chromaticities: TypeAlias = tuple[float, float, float, float, float, float, float, float]
ColorSpace: TypeAlias = Literal["lin_rec709", "ACEScg", "ACES2065-1", "lin_p3d65"]

_D65, _ACES_WHITE = (0.3127, 0.3290), (0.32168, 0.33767)
PRIMARIES: Mapping[ColorSpace, Chromaticities] = MappingProxyType(
    {
        "lin_rec709": (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, *_D65),  # ITU-R BT.709-6
        "ACEScg": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, *_ACES_WHITE),  # AP1: SMPTE S-2014-004
        "ACES2065-1": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, *_ACES_WHITE),  # AP0: SMPTE ST 2065-1
        "lin_p3d65": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *_D65),  # SMPTE RP 431-2 with the white of D65
    }
)
# Names of the ASWF Color Interop Forum's recommendation, which OpenEXR's attribute `colorInteropID` holds.
INTEROP_IDS: Mapping[ColorSpace, str] = MappingProxyType(
    {
        "lin_rec709": "lin_rec709_scene",
        "ACEScg": "lin_ap1_scene",
        "ACES2065-1": "lin_ap0_scene",
        "lin_p3d65": "lin_p3d65_scene",
    }
)
REC709 = PRIMARIES["lin_rec709"]

_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])  # Lam 1985
_FOOT = np.float32(0.0078125)  # light below which ACEScct is a line
_SAME = 1e-5  # chromaticities that differ by less are one: files hold them as float32
_LEAST_AREA = 1e-4  # of the triangle of primaries, twice; Rec.709's has 0.22


def are_usable(found: Sequence[float]) -> bool:
    """Whether eight numbers can be a space: finite, primaries that span a triangle, a white inside it."""
    xy = np.asarray(found, np.float64)
    if xy.shape != (8,) or not np.isfinite(xy).all() or np.abs(xy).max() > 2:
        return False
    red, green, blue, white = xy.reshape(4, 2)

    def area(a: F64, b: F64, c: F64) -> float:
        return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))

    whole = area(red, green, blue)
    parts = np.array([area(white, green, blue), area(red, white, blue), area(red, green, white)])
    return bool(abs(whole) > _LEAST_AREA and white[1] > _LEAST_AREA and (parts / whole > _LEAST_AREA).all())


def known(found: Sequence[float]) -> ColorSpace | None:
    """The space of these primaries and this white, as near as a file's float32 holds them; None: another one."""
    return next((name for name, own in PRIMARIES.items() if np.allclose(found, own, rtol=0, atol=_SAME)), None)


def name_of(found: Sequence[float]) -> str:
    """The space's name where it has one here; else its primaries."""
    name = known(found)
    if name is not None:
        return name
    red, green, blue, white = ((f"{x:.4g}", f"{y:.4g}") for x, y in np.asarray(found, np.float64).reshape(4, 2))
    return ", ".join(f"{what} {x} {y}" for what, (x, y) in zip("RGBW", (red, green, blue, white), strict=True))


def conversion(source: Sequence[float], target: Sequence[float]) -> F64:
    """(3, 3) that takes linear RGB of one space, as columns, to that of another: white stays white.

    Args:
        source: chromaticities that are usable, see :func:`are_usable`.
        target: the same.
    """
    return np.asarray(np.linalg.solve(_xyz_from(target), _adapted(source, target) @ _xyz_from(source)))


def converted(rgb: F32, source: Sequence[float], target: Sequence[float]) -> F32:
    """(..., 3) linear, premultiplied or not, in another space: the given array where both spaces are the same."""
    if np.allclose(source, target, rtol=0, atol=_SAME):
        return rgb
    matrix = conversion(source, target).astype(np.float32)
    with np.errstate(invalid="ignore", over="ignore"):  # a file may hold infinities, which its reader judges
        return np.asarray(rgb @ matrix.T, dtype=np.float32)


def acescct_encoded(light: F32) -> F32:
    """Linear Rec.709 (..., 3) as ACEScct (S-2016-001): a logarithm of light in AP1, with a line at its foot."""
    ap1 = converted(light, REC709, PRIMARIES["ACEScg"])
    foot, log = np.float32(10.5402377416545) * ap1 + np.float32(0.0729055341958355), np.log2(np.maximum(ap1, _FOOT))
    return np.asarray(np.where(ap1 <= _FOOT, foot, (log + np.float32(9.72)) / np.float32(17.52)), np.float32)


def acescct_decoded(values: F32) -> F32:
    """ACEScct (..., 3) as linear Rec.709, the inverse of :func:`acescct_encoded`; at most what a half float holds."""
    foot = (values - np.float32(0.0729055341958355)) / np.float32(10.5402377416545)
    log = np.exp2(np.minimum(values, np.float32(1.468)) * np.float32(17.52) - np.float32(9.72))
    ap1 = np.where(values <= np.float32(0.155251141552511), foot, log).astype(np.float32)
    return converted(ap1, PRIMARIES["ACEScg"], REC709)


def _xyz_from(space: Sequence[float]) -> F64:
    """(3, 3) to CIE XYZ, white of luminance 1 (SMPTE RP 177)."""
    xyz = np.array([_xyz(x, y) for x, y in np.asarray(space, np.float64).reshape(4, 2)])
    primaries = xyz[:3].T
    return np.asarray(primaries * np.linalg.solve(primaries, xyz[3] / xyz[3, 1]))


def _adapted(source: Sequence[float], target: Sequence[float]) -> F64:
    """(3, 3) on CIE XYZ, from one white to another."""
    old, new = (_BRADFORD @ (_xyz(*space[6:8]) / space[7]) for space in (source, target))
    return np.asarray(np.linalg.solve(_BRADFORD, np.diag(new / old) @ _BRADFORD))


def _xyz(x: float, y: float) -> F64:
    return np.array([x, y, 1 - x - y])
