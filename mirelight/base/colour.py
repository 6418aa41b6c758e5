"""Transfer curves, luminance and tone curves; NumPy only, float32 in and out.

Light is linear Rec.709 throughout. *Display-encoded* means the values of an 8-bit picture divided by 255. Arrays of any
shape; tone curves that mix channels want (..., 3). Nothing here clips to 1: the writer of an 8-bit picture does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

F32: TypeAlias = NDArray[np.float32]
Transfer: TypeAlias = Literal["srgb", "power"]  # curve between light and display values: sRGB, or the plain power 2.2
ToneCurve: TypeAlias = Literal["none", "aces", "neutral", "agx"]

ENGINE_GAMMA = 2.2  # PlayCanvas decodes and encodes with a plain power, not with the sRGB curve
ENGINE_ENCODE_OFFSET = 1e-7  # PlayCanvas adds this before its final power, so that pow never sees zero

_LARGEST = np.float32(1e9)  # brighter light is clamped before a rational curve, whose squares would overflow

REC709_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)  # ITU-R BT.709-6 §3.2


def srgb_encode(linear: ArrayLike) -> F32:
    """Linear light, in any shape, to display values by the sRGB curve (IEC 61966-2-1); negative values stay on its
    linear part."""
    x = np.asarray(linear, dtype=np.float32)
    curved = np.float32(1.055) * np.maximum(x, np.float32(0.0031308)) ** np.float32(1 / 2.4) - np.float32(0.055)
    return np.asarray(np.where(x <= np.float32(0.0031308), x * np.float32(12.92), curved), dtype=np.float32)


def srgb_decode(encoded: ArrayLike) -> F32:
    """Display values, in any shape, to linear light, the inverse of :func:`srgb_encode`; goes on above 1 on the power
    part."""
    x = np.asarray(encoded, dtype=np.float32)
    curved = ((np.maximum(x, np.float32(0.04045)) + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    return np.asarray(np.where(x <= np.float32(0.04045), x / np.float32(12.92), curved), dtype=np.float32)


def power_encode(linear: ArrayLike) -> F32:
    """Linear light, in any shape, to display values as PlayCanvas does: power 1 / 2.2, negative values become 0.

    Without the engine's `ENGINE_ENCODE_OFFSET`, so that :func:`power_decode` is its exact inverse.
    """
    x = np.maximum(np.asarray(linear, dtype=np.float32), np.float32(0))
    return np.asarray(x ** np.float32(1 / ENGINE_GAMMA), dtype=np.float32)


def power_decode(encoded: ArrayLike) -> F32:
    """Display values, in any shape, to linear light as PlayCanvas does: power 2.2, negative values become 0."""
    x = np.maximum(np.asarray(encoded, dtype=np.float32), np.float32(0))
    return np.asarray(x ** np.float32(ENGINE_GAMMA), dtype=np.float32)


def encode(linear: ArrayLike, transfer: Transfer) -> F32:
    """Linear light, in any shape, to display values by a profile's curve: sRGB (physical) or the 2.2 power
    (playcanvas)."""
    return power_encode(linear) if transfer == "power" else srgb_encode(linear)


def decode(encoded: ArrayLike, transfer: Transfer) -> F32:
    """Display values, in any shape, to linear light by a profile's curve, the inverse of :func:`encode`."""
    return power_decode(encoded) if transfer == "power" else srgb_decode(encoded)


def shown(
    rgb: F32,
    alpha: F32,
    transfer: Transfer,
    *,
    gain: float = 1.0,
    tone: ToneCurve = "none",
    background: ArrayLike = 0.0,
    view: Callable[[F32], F32] | None = None,
    behind: F32 | None = None,
) -> F32:
    """Display values of a premultiplied linear picture: the one way from light to what a screen or an 8-bit file shows.

    Each pixel's own colour (un-premultiplied) is multiplied by the gain, tone mapped and encoded, then laid over the
    background in display space: splats blend in display space, so a picture that was only decoded comes back as it was.

    Args:
        rgb: (..., 3) linear, premultiplied.
        alpha: (...,) 0 to 1.
        transfer: the profile's curve.
        gain: linear factor before the tone curve.
        tone: tone curve.
        background: display-encoded, broadcast to (..., 3).
        view: from linear light (..., 3) to display values, in place of the tone curve and the transfer curve.
        behind: (..., 3) linear light in place of the background, as where splats were blended in linear light
            (the engine's linear pipeline does): what both make together is exposed, tone mapped and encoded.

    Returns:
        (..., 3), 0 to 1; what is no number is 0.
    """
    if behind is not None:
        light = (rgb + behind * (np.float32(1) - alpha[..., None])) * np.float32(gain)
        return laid_over(displayed(light, transfer, tone, view), np.ones_like(alpha), 0.0)
    own = straight(rgb, alpha)
    if gain != 1:
        own *= np.float32(gain)
    return laid_over(displayed(own, transfer, tone, view), alpha, background)


def displayed(light: F32, transfer: Transfer, tone: ToneCurve, view: Callable[[F32], F32] | None = None) -> F32:
    """(..., 3) display values of exposed light: by a view, or by tone curve and transfer curve."""
    return encode(tone_map(light, tone), transfer) if view is None else view(light)


def straight(rgb: F32, alpha: F32) -> F32:
    """(..., 3) a premultiplied colour over its alpha (...,); 0 where the alpha is 0. A new array."""
    a = np.where(alpha > 0, alpha, np.float32(np.inf))
    out = np.empty(rgb.shape, dtype=np.float32)
    for channel in range(3):  # several times faster than a plane against all channels at once
        np.divide(rgb[..., channel], a, out=out[..., channel])
    return out


def laid_over(display: F32, alpha: F32, background: ArrayLike) -> F32:
    """(..., 3) straight display values over a background of display values, 0 to 1; what is no number is 0."""
    a = alpha[..., None]
    over = display * a + np.asarray(background, dtype=np.float32) * (np.float32(1) - a)
    clean = np.nan_to_num(over, copy=False, nan=0.0, posinf=1.0, neginf=0.0)
    return np.asarray(np.clip(clean, np.float32(0), np.float32(1), out=clean), dtype=np.float32)


def luminance(rgb: ArrayLike) -> F32:
    """Relative luminance (...,) of linear Rec.709 (..., 3)."""
    return np.asarray(np.asarray(rgb, dtype=np.float32) @ REC709_LUMINANCE, dtype=np.float32)


def tone_map(linear: ArrayLike, curve: ToneCurve) -> F32:
    """Scene-linear light (..., 3) to display-linear light by a tone curve; encode and clip afterwards.

    Exposure is the caller's: multiply first. `none` returns the input. `aces`, `neutral` and `agx` treat negative light
    as none.

    - `aces`: Narkowicz' fit of the ACES RRT and sRGB ODT (2016), per channel, as PlayCanvas' TONEMAP_ACES computes it;
      it tends to 2.51 / 2.43, not to 1.
    - `neutral`: Khronos PBR Neutral (specification 1.0): keeps base colours, compresses above 0.76 + 0.04.
    - `agx`: Troy Sobotka's AgX, base look, with the matrices of Blender and three.js (Rec.2020 inset) and Sobotka's
      closed-form sigmoid. three.js replaces that by a polynomial of degree 6, off by up to 0.006 of display value.
    """
    light = np.asarray(linear, dtype=np.float32)
    if curve == "none":
        return light
    light = np.clip(light, np.float32(0), _LARGEST)
    if curve == "aces":
        return _aces(light)
    if curve == "neutral":
        return _neutral(light)
    return _agx(light)


def _aces(x: F32) -> F32:
    a, b, c, d, e = (np.float32(v) for v in (2.51, 0.03, 2.43, 0.59, 0.14))
    return np.asarray(x * (a * x + b) / (x * (c * x + d) + e), dtype=np.float32)


def _neutral(light: F32) -> F32:
    fresnel = np.float32(0.04)  # normal-incidence reflectance of a dielectric, taken off so that base colours stay
    start = np.float32(0.8) - fresnel
    room = 1 - start
    desaturation = np.float32(0.15)

    lowest = light.min(axis=-1, keepdims=True)
    offset = np.where(lowest < 2 * fresnel, lowest - lowest * lowest / (4 * fresnel), fresnel)
    shifted = light - offset
    peak = shifted.max(axis=-1, keepdims=True)
    over = np.maximum(peak, start)  # where the peak lies below, the result is `shifted` itself
    compressed_peak = 1 - room * room / (over + room - start)
    compressed = shifted * (compressed_peak / over)
    towards_white = 1 - 1 / (desaturation * (over - compressed_peak) + 1)
    out = compressed + (compressed_peak - compressed) * towards_white
    return np.asarray(np.where(peak < start, shifted, out), dtype=np.float32)


# ITU-R BT.2407 §2.2: linear Rec.709 to linear Rec.2020; rows are output channels.
_REC2020_FROM_REC709 = np.array(
    [[0.6274039, 0.3292830, 0.0433131], [0.0690973, 0.9195404, 0.0113623], [0.0163914, 0.0880133, 0.8955953]]
)
# Blender's and three.js' AgX primaries in Rec.2020: colours are drawn inwards, shaped per channel, and drawn back less.
_AGX_INSET = np.array(
    [
        [0.856627153315983, 0.0951212405381588, 0.0482516061458583],
        [0.137318972929847, 0.761241990602591, 0.101439036467562],
        [0.11189821299995, 0.0767994186031903, 0.811302368396859],
    ]
)
_AGX_OUTSET = np.array(
    [
        [1.1271005818144368, -0.11060664309660323, -0.016493938717834573],
        [-0.1413297634984383, 1.157823702216272, -0.016493938717834257],
        [-0.14132976349843826, -0.11060664309660294, 1.2519364065950405],
    ]
)
_AGX_STOPS = (-10.0, 6.5)  # stops below and above middle gray that the sigmoid spans
_AGX_GRAY = 0.18
_AGX_SLOPE, _AGX_TOE, _AGX_SHOULDER = 2.0, 3.0, 3.25  # of the sigmoid at middle gray, and its two powers


def _agx(light: F32) -> F32:
    inset = light.astype(np.float64) @ (_AGX_INSET @ _REC2020_FROM_REC709).T
    low, high = _AGX_STOPS
    stops = np.log2(np.maximum(inset, 1e-10) / _AGX_GRAY)
    shaped = _agx_sigmoid(np.clip((stops - low) / (high - low), 0, 1))
    display = np.maximum(shaped @ _AGX_OUTSET.T, 0)
    out = display**2.2 @ np.linalg.inv(_REC2020_FROM_REC709).T
    return np.asarray(np.maximum(out, 0), dtype=np.float32)


def _agx_sigmoid(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sobotka's curve: through (0, 0), (1, 1) and, with the given slope, (pivot, 1/2)."""
    pivot = -_AGX_STOPS[0] / (_AGX_STOPS[1] - _AGX_STOPS[0])
    distance = np.abs(x - pivot)
    toe = _half_sigmoid(distance, pivot, _AGX_TOE)
    shoulder = _half_sigmoid(distance, 1 - pivot, _AGX_SHOULDER)
    return np.asarray(np.where(x < pivot, 0.5 - toe, 0.5 + shoulder))


def _half_sigmoid(distance: NDArray[np.float64], span: float, power: float) -> NDArray[np.float64]:
    """Rises with the slope from 0 and reaches 1/2 at `span`: s d / (1 + k d^p)^(1/p)."""
    k = ((2 * _AGX_SLOPE * span) ** power - 1) / span**power
    return np.asarray(_AGX_SLOPE * distance / (1 + k * distance**power) ** (1 / power))


# --- temperature -----------------------------------------------------------------------------------------------------

_RGB_FROM_XYZ = np.array(
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)
# Lobes (height, peak in nm, width below and above it) of the CIE 1931 observer: Wyman, Sloan and Shirley 2013,
# "Simple analytic approximations to the CIE XYZ color matching functions", table 1.
_OBSERVER = (
    ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
)


def blackbody(kelvin: float) -> NDArray[np.float64]:
    """(3,) linear Rec.709 colour of a black body, of luminance 1, so that it changes no light's photometric strength.

    Planck's law, seen by the CIE 1931 observer; colours redder than Rec.709 holds (below about 1,900 K) lose their
    negative blue.

    Args:
        kelvin: 1,000 to 40,000.
    """
    nm = np.arange(360.0, 831.0)
    meters = nm * 1e-9
    power = meters**-5 / np.expm1(1.438776877e-2 / (meters * kelvin))
    seen = [sum(h * np.exp(-0.5 * ((nm - p) / np.where(nm < p, a, b)) ** 2) for h, p, a, b in row) for row in _OBSERVER]
    rgb = np.maximum(_RGB_FROM_XYZ @ (np.asarray(seen) @ power), 0.0)
    return np.asarray(rgb / (rgb @ REC709_LUMINANCE.astype(np.float64)), dtype=np.float64)
