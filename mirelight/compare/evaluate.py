"""One pair: read, made comparable, scored."""

from __future__ import annotations

import numpy as np

from mirelight.base.errors import InputError
from mirelight.compare import metrics
from mirelight.compare.display import Display
from mirelight.compare.oversight import oversight, why_other_size
from mirelight.compare.pictures import read_mask, read_picture
from mirelight.compare.regions import regions
from mirelight.compare.types import (
    NOISE_MARGIN,
    Bool,
    CompareSettings,
    Comparison,
    Maps,
    Pair,
    Picture,
    RegionName,
    Scores,
    Verdict,
)
from mirelight.model import F32


def evaluate(pair: Pair, settings: CompareSettings) -> tuple[Comparison, Maps]:
    """Scores one picture file against another.

    Returns:
        The figures, and the pictures behind them.

    Raises:
        InputError: a file that cannot be read, or pictures of two sizes.
        MirelightError: a package of the extra `compare` is missing.
    """
    reference = read_picture(pair.reference, premultiplied=settings.premultiplied)
    test = read_picture(pair.test, premultiplied=settings.premultiplied)
    if reference.size != test.size:
        (h, w), (rows, columns) = reference.size, test.size
        found = (
            f"{columns} x {rows} pixels where the reference has {w} x {h}{why_other_size(reference.size, test.size)}"
        )
        raise InputError(pair.test, found, "render one size")
    whole = np.ones(reference.size, dtype=bool)
    counted = whole if pair.mask is None else read_mask(pair.mask, reference.size)
    if not counted.any():
        raise InputError(str(pair.mask), "a mask without a white pixel", "paint white what counts")

    display = Display.of(reference, test, settings)
    gain = display.fit_gain(reference, test) if settings.fit_gain else 1.0
    figures = _Figures(reference, test, gain, display)
    masks = regions(reference, test, counted, settings.band)
    scores = tuple(figures.scores(name, mask) for name, mask in masks.items())
    remark = ""
    if scores[0].verdict in ("difference", "unknown"):
        remark = oversight(reference, test, figures.shown_reference, figures.shown_test, display)
    comparison = Comparison(
        name=pair.name,
        reference=pair.reference,
        test=pair.test,
        width=reference.size[1],
        height=reference.size[0],
        linear=reference.linear and test.linear,
        gain=gain,
        regions=scores,
        remark=remark,
        reference_settings=reference.settings,
        test_settings=test.settings,
    )
    return comparison, figures.maps(counted)


class _Figures:
    """Every map of a pair, made once; regions only average."""

    def __init__(self, reference: Picture, test: Picture, gain: float, display: Display) -> None:
        self.shown_reference = display.show(reference, gain)
        self.shown_test = display.show(test)
        a, b = self.shown_reference, self.shown_test
        self.squared = metrics.squared_error(a, b)
        self.ssim = metrics.ssim(a, b)
        self.flip = metrics.flip(a, b, display.settings)
        self.delta_e = metrics.delta_e(a, b)
        self.largest = np.abs(b - a).max(axis=-1)
        self.noise = _noise_map(
            display.noise(reference, a, gain), display.noise(test, b), 1 / 255**2 / 12 if display.eight_bit else 0.0
        )
        self.relative: F32 | None = None
        self.hdr_flip: F32 | None = None
        self.relative_noise: F32 | None = None
        if reference.linear and test.linear:
            light = reference.rgb * np.float32(gain)
            self.relative = metrics.relative_squared_error(light, test.rgb - light)
            self.hdr_flip = metrics.hdr_flip(light, test.rgb, display.settings)
            deviation = _together(_scaled(reference.noise, gain), test.noise)
            if deviation is not None:
                self.relative_noise = metrics.relative_squared_error(light, deviation)

    def scores(self, region: RegionName, mask: Bool) -> Scores:
        error = _mean(self.squared, mask)
        noise = None if self.noise is None else _mean(self.noise, mask)
        relative = None if self.relative is None else _mean(self.relative, mask)
        relative_noise = None if self.relative_noise is None else _mean(self.relative_noise, mask)
        return Scores(
            region=region,
            pixels=int(mask.sum()),
            psnr=metrics.psnr(error),
            ssim=_mean(self.ssim, mask),
            flip=_mean(self.flip, mask),
            delta_e=_mean(self.delta_e, mask),
            delta_e_p99=float(np.percentile(self.delta_e[mask], 99)),
            max_error=float(self.largest[mask].max()),
            rel_mse=relative,
            hdr_flip=None if self.hdr_flip is None else _mean(self.hdr_flip, mask),
            noise_psnr=None if noise is None else metrics.psnr(noise),
            noise_rel_mse=relative_noise,
            verdict=_verdict(error, noise, relative, relative_noise),
        )

    def maps(self, counted: Bool) -> Maps:
        signed = metrics.luma(self.shown_test) - metrics.luma(self.shown_reference)
        return Maps(
            reference=self.shown_reference, test=self.shown_test, flip=self.flip, signed=signed, counted=counted
        )


def _verdict(error: float, noise: float | None, relative: float | None, relative_noise: float | None) -> Verdict:
    """Noise where neither the shown nor the linear difference is larger than noise explains."""
    if error == 0 and not relative:
        return "identical"
    if noise is None:
        return "unknown"
    shown = error <= NOISE_MARGIN * noise
    linear = relative is None or relative_noise is None or relative <= NOISE_MARGIN * relative_noise
    return "noise" if shown and linear else "difference"


def _noise_map(reference: F32 | None, test: F32 | None, rounding: float) -> F32 | None:
    """(H, W) expected squared display difference of two pictures whose true values are equal."""
    both = _together(reference, test)
    if both is None:
        return None
    alone = reference is None or test is None  # the other side has no noise of its own, but was rounded too
    return np.asarray((both**2).mean(axis=-1) + (rounding if alone else 0.0), dtype=np.float32)


def _together(a: F32 | None, b: F32 | None) -> F32 | None:
    """The standard deviation of the difference of two independent values; None counts as exact, two None as unknown."""
    if a is None or b is None:
        return a if b is None else b
    return np.asarray(np.hypot(a, b), dtype=np.float32)


def _scaled(deviation: F32 | None, gain: float) -> F32 | None:
    return None if deviation is None else deviation * np.float32(gain)


def _mean(values: F32, mask: Bool) -> float:
    return float(values[mask].mean(dtype=np.float64))
