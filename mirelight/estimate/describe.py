"""An estimate in plain lines: what was found, how sure it is, and what cannot be known."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mirelight.base.colour import REC709_LUMINANCE
from mirelight.estimate.tuning import TUNING
from mirelight.estimate.types import Estimate
from mirelight.model import F64


def described(found: Estimate) -> Iterator[str]:
    """What was found and how sure it is, a line each."""
    c = found.confidence
    if found.sun.any():
        up = float(np.degrees(np.arcsin(np.clip(found.to_sun[1], -1, 1))))
        share = _luminance(found.sun)
        yield (
            f"sun          {up:.0f}° above the horizon, towards ({_numbers(found.to_sun)}), {share:.3g} lux, "
            f"a disc of {found.sun_diameter:.2g}°"
        )
        yield f"             explains {c.sun_gain:.3f} of the differences; halves of the splats: {_apart(c.sun_apart)}"
    else:
        yield f"sun          none found (the best one explains {c.sun_gain:.3f} of the differences)"
    for light in found.named:
        strength, unit = _luminance(light.color * light.intensity), light.KIND.unit.name
        yield f"light        {light.name}: {strength:.3g} {unit}"
    for lamp, gain in zip(found.lamps, c.lamps_gain, strict=True):
        weak = "" if gain >= TUNING.doubt_sure_lamp else "a weak one, perhaps none: "
        yield (
            f"lamp         {weak}at ({_numbers(lamp[:3])}), {_luminance(lamp[3:]):.3g} candela; explains {gain:.3f} of "
            "the differences in splats that it was not found from"
        )
    rows = len(found.radiance)
    weights = np.sin(np.pi * (np.arange(rows) + 0.5) / rows)[:, None, None]
    above, below = (
        (half * w).sum(axis=(0, 1)) / (w.sum() * half.shape[1])
        for half, w in zip(np.split(found.radiance, 2), np.split(weights, 2), strict=True)
    )
    yield f"sky          mean radiance ({_numbers(above)}) above the horizon, ({_numbers(below)}) below"
    low, middle, high = c.albedo
    yield f"albedo       {low:.2f} to {high:.2f}, {middle:.2f} in the middle, as it comes out of this light"
    yield f"told by      {c.places:,} splats on the proxy; {c.blocked:.0%} of their view is other surfaces"
    yield f"checked      halves of the splats give light that differs by {c.halves_apart:.0%}"
    if found.sun.any():
        yield f"             edges of its shadows speak {_spoken(c.sun_beaten)} deviations"
    else:
        yield f"             and explains {c.held_out:.0%} of the differences in the other half"


def doubts(found: Estimate) -> Iterator[str]:
    """What speaks against it, and not against every estimate, a line each: it may be worse than none."""
    c = found.confidence
    if found.sun.any() and not c.sun_beaten <= TUNING.doubt_beaten:
        yield "where the sun stood: edges of its shadows speak for another one, so its direction is a guess"
    elif found.sun.any() and not c.sun_apart <= TUNING.doubt_apart and c.sun_beaten > -TUNING.edge_sure:
        yield "where the sun stood: halves of the splats disagree on it and no edges of shadows speak for it"
    if not c.halves_apart <= TUNING.doubt_halves_agree:
        yield "the light at places few splats see: the two halves of the splats disagree by more than 15 %"
    if not found.sun.any() and c.held_out < TUNING.doubt_little:  # one with a sun is judged by its shadows' edges
        yield "whether this is the light at all: it explains hardly more than even light from everywhere"
    if len(found.lamps) and not found.sun.any() and c.blocked < TUNING.doubt_alone:
        yield "whether there were lamps: nothing in it shadows anything else, and brighter paint looks the same"


def doubted(found: Estimate) -> bool:
    """Whether any of :func:`doubts` does."""
    return next(doubts(found), None) is not None


def unknown(found: Estimate) -> Iterator[str]:
    """What these splats cannot tell, a line each; the last ones are true of every estimate."""
    c = found.confidence
    if not c.scale_known:
        yield (
            f"how bright: only {c.blocked:.0%} of the view is blocked, so little light goes from surface to surface; "
            "the scale is a guess that makes the mean albedo 0.35: set it with --exposure"
        )
    yield from doubts(found)
    low, high = c.sun_disc
    if found.sun.any() and high - low > TUNING.doubt_disc_known:
        yield f"how wide the sun's disc is: anything from {low:.2g}° to {high:.2g}° explains about as much"
    if c.albedo[2] > 1:
        yield "the light where albedos come out above 1: glow, gloss, or a proxy that misfits there"
    if found.sun.any():
        yield "its colour: the sun has that of sunlight at its height; what else pictures had stays in the surfaces"
    else:
        yield "its colour: it is taken as white in the mean; a sunset's or a lamp's colour stays in the surfaces"
    yield "parts of the sky that the same splats see, and what casts shadows from outside the proxy"
    yield "small lamps, lamps that are no points, and what pictures that were tone-mapped or exposed by themselves hide"


def _luminance(rgb: F64) -> float:
    return float(rgb @ REC709_LUMINANCE.astype(np.float64))


def _numbers(values: F64) -> str:
    return ", ".join(f"{x:.2f}" for x in values)


def _spoken(beaten: float) -> str:
    return f"for it, against any other sun by {-beaten:.1f}" if beaten <= 0 else f"for another sun by {beaten:.1f}"


def _apart(degrees: float) -> str:
    return "one finds none" if np.isnan(degrees) else f"{degrees:.1f}° apart"
