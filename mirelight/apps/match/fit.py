"""Finds what lights must be for a frame to look like a picture.

Relit light is a sum over lights, each times its intensity and colour (both modes are linear in light, up to the ratio's
upper clamp). So every light is traced once, white and of intensity 1; what each adds to the frame is one column for
each colour channel, and non-negative least squares finds their weights. What has no colour in a job (an environment's
picture, a computed sun and sky) gets it as a factor in the job's `mix`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirelight.apps.match.columns import ROWS, Columns
from mirelight.apps.match.solve import Bool, Column, closest
from mirelight.apps.match.target import Target
from mirelight.apps.match.uncertain import uncertainties
from mirelight.base import colour
from mirelight.base.errors import InputError
from mirelight.base.progress import CountProgress, ShareProgress, counted, part, quiet
from mirelight.model import F64, Camera, LayerFactor, Light, Lighting
from mirelight.model.lights import SKY, SUN
from mirelight.model.unit_lights import terms
from mirelight.pipeline.scene import Scene

_CLAMPED = 1e-3  # relative: where the ratio's upper clamp takes that much, light is not linear
_CLAMP_ROUNDS = 3
_COARSE, _FINE = 15.0, 1.0  # degrees: steps of the search for a rotation

Shots = Sequence[tuple[Camera, Target]]  # pictures and where they were taken from


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LayerMatch:
    """What became of a light, a group, an environment or a sky."""

    name: str
    before: F64  # (3,) colour times intensity; of a group the factor of what its lights have
    after: F64
    uncertainty: F64  # (3,) how far `after` may be off (`uncertain`); 0 where it was not to be changed, inf: unknown
    seen: bool  # False: the picture says nothing about it, and it stays as it was
    fixed: bool = False  # it was not to be changed
    keeps_colour: bool = False  # one factor was found for all its channels

    @property
    def relative_uncertainty(self) -> F64:
        """(3,) `uncertainty` as a share of `after`; inf where that is 0."""
        dark = self.after <= 0
        share = self.uncertainty / np.where(dark, 1, self.after)
        return np.asarray(np.where(dark & (self.uncertainty > 0), np.inf, share))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Match:
    """A lighting with which the frame comes closest to the picture."""

    lighting: Lighting
    layers: tuple[LayerMatch, ...]
    psnr_before: float  # dB of display values, averaged as the fit was
    psnr_after: float
    rotation: float | None  # degrees, of the environment, where it was searched


def match(
    scene: Scene,
    shots: Shots,
    lighting: Lighting,
    *,
    free: Sequence[str] | None = None,
    keep_colours: bool = False,
    rotate: bool = False,
    report: ShareProgress = quiet,
) -> Match:
    """Fit a lighting to a picture, or to several of the same light.

    Args:
        scene: a prepared job with splats and a proxy, in a mode that is linear in light.
        shots: one or more pictures, each with the camera from which it was taken.
        lighting: where the lights stand; their intensities (and colours, but to keep them) are only said as what was
            before.
        free: names of the layers to find (None: all); others stay as they are.
        keep_colours: find one factor for each, and not one for each channel.
        rotate: search the environment's rotation, too.
        report: hears what is being done.

    Raises:
        InputError: a job whose light is not linear; unknown names; no environment to turn; a picture that does not fit.
    """
    _require_linear(scene, lighting, free, rotate)
    wish = _Wish(free, keep_colours)
    for camera, target in shots:
        target.require_shape(camera.height, camera.width)
    rotation: float | None = None
    if rotate:
        rotation = _rotation(scene, shots, lighting, wish, report)
        assert lighting.environment is not None
        lighting = replace(lighting, environment=replace(lighting.environment, rotation=rotation))
    fit = _Fit(scene, shots, lighting, wish, report)
    report("fitting", 0.0)
    found = fit.layers(fit.solved())
    return Match(
        lighting=_with(lighting, {x.name: x.after for x in found}),
        layers=found,
        psnr_before=fit.psnr({x.name: x.before for x in found}),
        psnr_after=fit.psnr({x.name: x.after for x in found}),
        rotation=rotation,
    )


def _require_linear(scene: Scene, lighting: Lighting, free: Sequence[str] | None, rotate: bool) -> None:
    job = scene.job
    if job.splats is None or job.proxy is None:
        raise InputError(job.source, "no splats or no proxy", "a match needs both")
    if scene.mixture(white(lighting)).sets[0].whole is not None:
        found = "light that is traced lighting by lighting, so single lights are not known"
        remedy = "match in the profile physical, without render.noise, with output.layers and at most 12 lights"
        raise InputError(job.source, found, remedy)
    if job.relight.space != "linear":
        raise InputError(job.source, "a factor in display space", "set it to linear", field="relight.space")
    names = [x.layer for x in terms(lighting)]
    for name in free or ():
        if name not in names:
            raise InputError(job.source, f"no light named {name!r} in {lighting.name!r}", f"it has: {', '.join(names)}")
    if not names:
        raise InputError(job.source, f"no lights in {lighting.name!r}", "name another lighting")
    around = lighting.environment
    if rotate and (around is None or around.is_constant):
        raise InputError(job.source, f"no environment with a picture in {lighting.name!r}", "leave out --rotate")


# --- one rotation ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Wish:
    """What of the lights is to be found."""

    free: Sequence[str] | None  # names of the layers; None: all
    keep_colours: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Solution:
    """Weights with which the frames come closest to the pictures, with or without the ratio's floor."""

    columns: list[Column]  # of the free layers: one for each channel, or one
    found: F64  # (n,) their weights
    told: Bool  # (n,) whether the pictures tell anything of each
    weights: dict[str, F64]  # (3,) of all layers; what is not told of stays
    counts: F64  # (P, 3) how much pixels count, those at the upper clamp left out
    rest: F64  # (P, 3) light that is there whatever the free layers are
    residual: float  # mean square of what is left, in display values


class _Fit:
    """One lighting, and all pictures as one."""

    def __init__(
        self,
        scene: Scene,
        shots: Shots,
        lighting: Lighting,
        wish: _Wish,
        report: ShareProgress,
    ) -> None:
        units = white(lighting)

        def said(shot: int) -> CountProgress:
            share = part(report, shot / len(shots), (shot + 1) / len(shots))
            return counted(share, "tracing the lights")

        self._views = [Columns(scene, camera, units, target, said(k)) for k, (camera, target) in enumerate(shots)]
        self._before = {x.layer: np.asarray(x.weight, np.float64) for x in terms(lighting)}
        names = [name for name in self._before if wish.free is None or name in wish.free]
        self._whole = wish.keep_colours
        each = 1 if self._whole else 3
        self._free = {name: slice(each * i, each * i + each) for i, name in enumerate(names)}  # where their columns are
        self._tint = _tints(lighting) if self._whole else dict.fromkeys(names, np.ones(3))
        self._counts = np.concatenate([x.counts for x in self._views])
        self._target = np.concatenate([x.target for x in self._views])
        self._unlit = {k: np.concatenate([x.unlit[k] for x in self._views]) for k in self._views[0].unlit}
        self._alone = {k: np.concatenate([x.alone[k] for x in self._views]) for k in self._before}
        self._gain = 2.0**scene.job.display.exposure

    def solved(self) -> _Solution:
        """The lights' weights that fit the picture best.

        Where no light falls, the ratio leaves a little of the captured light. Another program's picture and a
        photograph lack it: then it would be taken from the faintest light, so what comes closer counts.
        """
        return min((self._solved(unlit) for unlit in self._unlit.values()), key=lambda x: x.residual)

    def _solved(self, unlit: F64) -> _Solution:
        """With this light (P, 3) where no lamp's falls."""
        fixed = [name for name in self._before if name not in self._free]
        rest: F64 = np.sum([unlit, *(self._alone[n] * self._before[n] for n in fixed)], axis=0)
        channels = (None,) if self._whole else range(3)
        columns = [Column(self._alone[name] * self._tint[name], k) for name in self._free for k in channels]
        counts = self._counts
        for _ in range(_CLAMP_ROUNDS):
            found, told = closest(columns, self._target, rest, counts, self._gain)
            weights = self._before | {
                name: found[at] * self._tint[name] for name, at in self._free.items() if told[at].any()
            }
            lit: F64 = np.sum([self._alone[n] * weights[n] for n in weights], axis=0)
            held, straight = self._relit(weights), self._unlit[True] + lit
            left = self._counts * (np.abs(held - straight) <= _CLAMPED * np.abs(straight) + 1e-6)
            if np.array_equal(left, counts) or not left.any():
                break
            counts = left
        return _Solution(
            columns=columns,
            found=found,
            told=told,
            weights=weights,
            counts=counts,
            rest=rest,
            residual=self._error(unlit + lit, counts),
        )

    def layers(self, x: _Solution) -> tuple[LayerMatch, ...]:
        """What became of each layer, and how well it is known."""
        starts = np.cumsum([0, *(view.tiles.max() + 1 for view in self._views)])
        tile = np.concatenate([view.tiles + first for view, first in zip(self._views, starts, strict=False)])
        off = uncertainties(x.columns, x.found, x.told, self._target, x.rest, x.counts, self._gain, tile)
        return tuple(
            LayerMatch(
                name=name,
                before=before,
                after=x.weights[name],
                uncertainty=_times(off[self._free[name]], self._tint[name]) if name in self._free else np.zeros(3),
                seen=name not in self._free or bool(x.told[self._free[name]].any()),
                fixed=name not in self._free,
                keeps_colour=self._whole,
            )
            for name, before in self._before.items()
        )

    def psnr(self, weights: dict[str, F64]) -> float:
        """dB of display values of the frames with these weights."""
        return float(-10 * np.log10(max(self._error(self._relit(weights), self._counts), 1e-12)))

    def _relit(self, weights: dict[str, F64]) -> F64:
        return np.concatenate([x.relit(weights) for x in self._views])

    def _error(self, picture: F64, counts: F64) -> float:
        a, b = (np.clip(colour.srgb_encode(x * self._gain), 0, 1).astype(np.float64) for x in (picture, self._target))
        return float((counts * (a - b) ** 2).sum() / counts.sum())


def _rotation(scene: Scene, shots: Shots, lighting: Lighting, wish: _Wish, report: ShareProgress) -> float:
    """Degrees of the environment that come closest: in steps all around, then by halves about the best."""
    around = lighting.environment
    assert around is not None
    small = [(_small(camera), target) for camera, target in shots]
    known: dict[float, float] = {}
    steps = [float(x) for x in np.arange(0, 360, _COARSE)]
    count = len(steps) + 2 * int(np.ceil(np.log2(_COARSE / _FINE)))

    def error(turn: float) -> float:
        turn %= 360
        if turn not in known:
            report("turning the environment", len(known) / count)
            turned = replace(lighting, environment=replace(around, rotation=_upright(around.rotation + turn)))
            known[turn] = _Fit(scene, small, turned, wish, quiet).solved().residual
        return known[turn]

    best = min(steps, key=error)
    step = _COARSE / 2
    while step >= _FINE / 2:
        best = min((best, best - step, best + step), key=error)
        step /= 2
    return _upright(around.rotation + best)


def _small(camera: Camera) -> Camera:
    rows = min(camera.height, ROWS)
    return camera.resized(max(1, round(rows * camera.width / camera.height)), rows)


def _upright(degrees: float) -> float:
    """The same angle between -180 and 180 degrees."""
    return (degrees + 180) % 360 - 180


# --- lightings -------------------------------------------------------------------------------------------------------


def white(lighting: Lighting) -> Lighting:
    """The lighting with every light white and of intensity 1; those of a group as they are."""
    around, sky = lighting.environment, lighting.sky
    return replace(
        lighting,
        mix=(),
        lights=tuple(
            x if x.group is not None else replace(x, color=np.ones(3), intensity=1.0) for x in lighting.lights
        ),
        environment=None if around is None else replace(around, intensity=1.0),
        sky=None if sky is None else replace(sky, intensity=1.0),
    )


def _times(off: F64, tint: F64) -> F64:
    """(3,) doubts of a colour's channels; what has no light of a channel has no doubt of it, be the rest unknown."""
    return np.where(tint > 0, off, 0.0) * tint


def _tints(lighting: Lighting) -> dict[str, F64]:
    """(3,) the colour of each layer, 1 in its strongest channel; lights that are off have one, too."""
    around, sky = lighting.environment, lighting.sky
    lit = replace(
        lighting,
        lights=tuple(x if x.intensity else replace(x, intensity=1.0) for x in lighting.lights),
        environment=around and replace(around, intensity=around.intensity or 1.0),
        sky=sky and replace(sky, intensity=sky.intensity or 1.0),
        mix=tuple(x for x in lighting.mix if x.factor.any()),
    )
    weights = {x.layer: np.asarray(x.weight, np.float64) for x in terms(lit)}
    return {name: x / x.max() if x.max() > 0 else np.ones(3) for name, x in weights.items()}


def _with(lighting: Lighting, weights: dict[str, F64]) -> Lighting:
    """The lighting with the weights as intensities and colours; what has no colour of its own gets a factor."""
    around, sky = lighting.environment, lighting.sky
    mix: list[LayerFactor] = []
    if around is not None:
        weight = weights[around.name]
        top = float(weight.max())
        around = replace(around, intensity=_rounded(top))
        if top > 0:
            mix.append(LayerFactor(layer=around.name, factor=_colour(weight / top)))
    if sky is not None:
        sky = replace(sky, intensity=sky.intensity or 1.0)
        mix += [LayerFactor(layer=part, factor=_colour(weights[part] / sky.intensity)) for part in (SUN, SKY)]
    lights = tuple(_light(x, weights[x.group or x.name]) for x in lighting.lights)
    return replace(lighting, lights=lights, environment=around, sky=sky, mix=tuple(mix))


def _light(light: Light, weight: F64) -> Light:
    """`weight`: colour times intensity, or what multiplies them for a light of a group."""
    total = weight if light.group is None else weight * light.color * light.intensity
    top, strongest = float(total.max()), float(light.color.max())
    if top <= 0:
        return replace(light, intensity=0.0)
    if strongest > 0 and np.allclose(total / top * strongest, light.color, rtol=1e-9, atol=0):
        return replace(light, intensity=_rounded(top / strongest))  # a colour that stays is written as it was
    return replace(light, color=_colour(total / top), intensity=_rounded(top))


def _colour(values: F64) -> F64:
    return np.array([_rounded(float(x)) for x in values])


def _rounded(value: float) -> float:
    """To six digits: what is beyond is noise."""
    return float(f"{value:.6g}")
