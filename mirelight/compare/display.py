"""Both sides as display values, by one exposure, tone curve and transfer curve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mirelight.base import colour
from mirelight.compare.pictures import blended_in_light, shows_engine_colours
from mirelight.compare.types import CompareSettings, Picture
from mirelight.model import F32, Profile, rules_of

_GAIN_STOPS = 6.0  # a fitted gain lies within this many stops of 1
_GAIN_SAMPLES = 1 << 16  # pixels that the fit looks at


@dataclass(frozen=True, slots=True)
class Display:
    """How linear light is shown in one comparison."""

    settings: CompareSettings
    profile: Profile  # whose transfer curve
    eight_bit: bool  # one side has 8 bits, so both are rounded to them

    @staticmethod
    def of(reference: Picture, test: Picture, settings: CompareSettings) -> Display:
        """The display that suits a pair."""
        engine = settings.transfer == "power"
        if settings.transfer == "auto":
            engine = shows_engine_colours(reference) or shows_engine_colours(test)
        return Display(settings, "playcanvas" if engine else "physical", not (reference.linear and test.linear))

    def show(self, picture: Picture, gain: float = 1.0) -> F32:
        """(H, W, 3) display values 0..1 over the background; `gain` multiplies the picture's light."""
        return self.show_light(picture.rgb, picture.alpha, picture.linear, gain, blended_in_light(picture.settings))

    def show_light(self, rgb: F32, alpha: F32, linear: bool, gain: float = 1.0, whole: bool = False) -> F32:
        """As :meth:`show`, for premultiplied (..., 3) and (...,); `whole`: blended in linear light."""
        settings, transfer = self.settings, rules_of(self.profile).transfer
        if linear:
            shown = colour.shown(
                rgb,
                alpha,
                transfer,
                gain=gain * 2.0**settings.exposure,
                tone=settings.tone,
                background=settings.background,
                behind=colour.decode(settings.background, transfer) if whole else None,
            )
        elif whole:
            lit = rgb if gain == 1 else colour.encode(colour.decode(rgb, transfer) * np.float32(gain), transfer)
            shown = np.clip(lit + np.asarray(settings.background, np.float32) * (1 - alpha[..., None]), 0, 1)
        else:
            own = colour.straight(rgb, alpha)
            if gain != 1:
                own = colour.encode(colour.decode(own, transfer) * np.float32(gain), transfer)
            shown = colour.laid_over(own, alpha, settings.background)
        if self.eight_bit:
            shown = np.rint(shown * np.float32(255)) / np.float32(255)
        return np.asarray(shown, dtype=np.float32)

    def noise(self, picture: Picture, shown: F32, gain: float = 1.0) -> F32 | None:
        """(H, W, 3) standard deviation of the display values, from that of the picture's light.

        One standard deviation is added to the light and shown; rounding to 8 bits adds its own variance.
        """
        if picture.noise is None:
            return None
        finer = Display(self.settings, self.profile, eight_bit=False)
        whole = blended_in_light(picture.settings)
        up = finer.show_light(picture.rgb + picture.noise, picture.alpha, True, gain, whole)
        down = finer.show_light(np.maximum(picture.rgb - picture.noise, 0), picture.alpha, True, gain, whole)
        deviation = (up - down) / 2
        rounding = (1 / 255**2 / 12) if self.eight_bit else 0.0
        return np.asarray(np.sqrt(deviation**2 + np.float32(rounding)), dtype=np.float32)

    def fit_gain(self, reference: Picture, test: Picture) -> float:
        """The factor on the reference's light whose picture comes nearest to the test's, in squared display error."""
        count = reference.alpha.size
        step = max(1, count // _GAIN_SAMPLES)
        rgb, alpha = reference.rgb.reshape(-1, 3)[::step], reference.alpha.reshape(-1)[::step]
        finer = Display(self.settings, self.profile, eight_bit=False)
        whole = blended_in_light(test.settings)
        rgb_test, alpha_test = test.rgb.reshape(-1, 3)[::step], test.alpha.reshape(-1)[::step]
        target = finer.show_light(rgb_test, alpha_test, test.linear, whole=whole)
        whole = blended_in_light(reference.settings)

        def error(stops: float) -> float:
            return float(np.mean((finer.show_light(rgb, alpha, reference.linear, 2.0**stops, whole) - target) ** 2))

        coarse = np.linspace(-_GAIN_STOPS, _GAIN_STOPS, 49)
        best = coarse[int(np.argmin([error(s) for s in coarse]))]
        spread = coarse[1] - coarse[0]
        return float(2.0 ** _golden_section(error, best - spread, best + spread))


def _golden_section(error: Callable[[float], float], low: float, high: float) -> float:
    """The place of the smallest value between two bounds, to a thousandth."""
    ratio = (5**0.5 - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    at_a, at_b = error(a), error(b)
    while high - low > 1e-3:
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - ratio * (high - low)
            at_a = error(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + ratio * (high - low)
            at_b = error(b)
    return (low + high) / 2
