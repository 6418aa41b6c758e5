"""What the stages hand on: splat layers, lighting buffers, frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from mirelight.model import shown
from mirelight.model.arrays import F32, F64, I32, ArrayHolder, freeze
from mirelight.model.cameras import Camera
from mirelight.model.profiles import Profile


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SplatLayer(ArrayHolder):
    """A composite of splats, before any lighting. `color` is in the space that the splats blend in."""

    camera: Camera
    color: F32  # (H, W, 3) premultiplied; display-encoded, or linear where `linear` is set
    transmittance: F32  # (H, W) what is left of a background, 0..1
    depth: F32  # (H, W) mean over blended splats of the view depth, world units; 0 where nothing is
    median_depth: F32  # (H, W) view depth where transmittance falls to 0.5; 0 where it does not
    diffuse: F32 | None = None  # (H, W, 3) `color` without what changes with the view (SH above degree 0), if asked for
    beyond: F32 | None = None  # (H, W, 2) share of the blended splats that lie off the proxy, their depth; if asked for
    profile: Profile = "physical"
    linear: bool = False  # color is linear light: of such splats, or the playcanvas 'linear' pipeline

    def __post_init__(self) -> None:
        h, w = self.camera.height, self.camera.width
        freeze(self, "color", (h, w, 3))
        freeze(self, "diffuse", (h, w, 3))
        freeze(self, "beyond", (h, w, 2))
        for name in ("transmittance", "depth", "median_depth"):
            freeze(self, name, (h, w))

    def __repr__(self) -> str:
        alpha, space = shown.share(1 - self.transmittance), "linear" if self.linear else "display"
        values = f"{space} colour {shown.span(self.color)}, depth {shown.span(self.depth)}"
        return f"SplatLayer({shown.view(self.camera)}, {self.profile}: alpha {alpha}, {values})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LightLayer(ArrayHolder):
    """What one light (or the environment, or emissive surfaces) adds to the lit proxy; premultiplied by coverage."""

    name: str
    direct: F32  # (H, W, 3) linear radiance after one reflection
    indirect: F32  # (H, W, 3) linear radiance after more
    variance: F32 | None = None  # (H, W, 3) variance of the mean of direct + indirect, where it was estimated
    # Means of direct + indirect over a half and two quarters of the samples, (H, W, 3) each, which share none; kept for
    # `mirelight.lighting.denoise` alone, which tells its error by them.
    half: F32 | None = None
    quarter: F32 | None = None
    other_quarter: F32 | None = None

    def __post_init__(self) -> None:
        for name in ("direct", "indirect", "variance", "half", "quarter", "other_quarter"):
            freeze(self, name, (None, None, 3))

    def times(self, factor: float | Sequence[float] | F64 | F32) -> LightLayer:
        """The layer of a light that is brighter by a factor, a number or linear [r, g, b]."""
        by = np.asarray(factor, np.float32)
        parts = ("direct", "indirect", "half", "quarter", "other_quarter")
        scaled = {name: x * by for name in parts if (x := getattr(self, name)) is not None}
        variance = None if self.variance is None else self.variance * by**2
        return replace(self, variance=variance, **scaled)

    @property
    def total(self) -> F32:
        """(H, W, 3) direct + indirect."""
        return np.asarray(self.direct + self.indirect, dtype=np.float32)

    def __repr__(self) -> str:
        height, width, _ = self.direct.shape
        noise = ", with variance" if self.variance is not None else ""
        spans = f"direct {shown.span(self.direct)}, indirect {shown.span(self.indirect)}"
        return f"LightLayer({self.name!r}, {width} x {height}: {spans}{noise})"

    def _repr_png_(self) -> bytes:
        """In a notebook: the layer over black."""
        return shown.picture(np.concatenate([self.total, np.ones_like(self.direct[..., :1])], axis=-1))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LightingBuffer(ArrayHolder):
    """The lit proxy as the splat camera sees it. Colours are premultiplied by coverage; AOVs are averages over the
    covered samples alone (0 where nothing is covered)."""

    camera: Camera
    coverage: F32  # (H, W) antialiased alpha of the proxy, 0..1
    layers: tuple[LightLayer, ...]  # sum of their totals is the beauty
    depth: F32  # (H, W) along the view axis, world units
    position: F32  # (H, W, 3) world units
    normal: F32  # (H, W, 3) shading normal, world, turned to the viewer
    geometric_normal: F32  # (H, W, 3) face normal, world, turned to the viewer
    albedo: F32  # (H, W, 3)
    sun_visibility: F32 | None = None  # (H, W) share of the suns' light that reaches the surface, 0..1; None: no sun
    ambient_occlusion: F32 | None = None  # (H, W) share of the cosine-weighted hemisphere that is free, 0..1
    variance: F32 | None = None  # (H, W, 3) mean square error of the beauty, where it was estimated
    samples: F32 | None = None  # (H, W) samples that went into each pixel
    spp: int = 0  # the fewest samples of any pixel
    cell_rays: int = 0  # of each piece of the surface that light was read from; 0: none was
    noisy: tuple[LightLayer, ...] = ()  # the layers as traced, where `layers` are denoised
    # What inserted objects show, as if they were a proxy of their own: its coverage is theirs, and the light of this
    # buffer that of the surface beside them. None: there are no objects.
    objects: LightingBuffer | None = None

    def __post_init__(self) -> None:
        h, w = self.camera.height, self.camera.width
        for name in ("coverage", "depth", "sun_visibility", "ambient_occlusion", "samples"):
            freeze(self, name, (h, w))
        for name in ("position", "normal", "geometric_normal", "albedo", "variance"):
            freeze(self, name, (h, w, 3))
        for layer in (*self.layers, *self.noisy):
            if layer.direct.shape != (h, w, 3):
                raise ValueError(f"layer {layer.name!r}: shape {layer.direct.shape}, expected {(h, w, 3)}")

    def __repr__(self) -> str:
        samples = f", {self.spp} samples a pixel" if self.spp else ""
        made = f"{shown.count(len(self.layers), 'layer')} of light ({shown.names([x.name for x in self.layers])})"
        made += ", denoised" if self.noisy else ""
        values = f"coverage {shown.share(self.coverage)}, light {shown.span(self.beauty)}"
        return f"LightingBuffer({shown.view(self.camera)}{samples}: {values};\n    {made})"

    def _repr_png_(self) -> bytes:
        """In a notebook: the lit proxy over black."""
        return shown.picture(self.rgba)

    @property
    def nbytes(self) -> int:
        """Size of all its arrays in bytes."""
        owners: tuple[LightingBuffer | LightLayer, ...] = (self, *self.layers, *self.noisy)
        values = (getattr(owner, f.name) for owner in owners for f in fields(owner))
        own = sum(x.nbytes for x in values if isinstance(x, np.ndarray))
        return own + (0 if self.objects is None else self.objects.nbytes)

    @property
    def beauty(self) -> F32:
        """(H, W, 3) sum of all layers, premultiplied by coverage."""
        return self._sum(self.layers)

    @property
    def noisy_beauty(self) -> F32 | None:
        """(H, W, 3) the beauty before denoising; None where nothing was denoised."""
        return self._sum(self.noisy) if self.noisy else None

    def _sum(self, layers: tuple[LightLayer, ...]) -> F32:
        out = np.zeros((self.camera.height, self.camera.width, 3), dtype=np.float32)
        for layer in layers:
            out += layer.direct
            out += layer.indirect
        return out

    @property
    def rgba(self) -> F32:
        """(H, W, 4) beauty and coverage: the lit proxy as a premultiplied picture."""
        return np.concatenate([self.beauty, self.coverage[..., None]], axis=-1)

    @property
    def relative_noise(self) -> float | None:
        """Root mean square error over covered pixels, relative to each pixel; None where no variance is known.

        sqrt(mean(variance / (beauty² + 0.01 mean²))): the second term keeps dark pixels from deciding.
        """
        if self.variance is None:
            return None
        covered = self.coverage > 0
        beauty = self.beauty[covered]
        floor = 0.01 * float(beauty.mean(dtype=np.float64)) ** 2 if len(beauty) else 0.0
        if floor == 0:
            return 0.0
        return float(np.sqrt(np.mean(self.variance[covered] / (beauty**2 + np.float32(floor)), dtype=np.float64)))

    def reweighted(self, weights: Mapping[str, float | Sequence[float] | F64]) -> LightingBuffer:
        """The same frame with its lights dimmed, brightened or tinted, without tracing again.

        Args:
            weights: by the name of a layer its factor, a number or linear [r, g, b] (3,), 0 or more. Others stay.

        Returns:
            The buffer with those layers multiplied; what a fresh trace would give, but for noise. Layers of one frame
            share paths, so their errors are correlated: the new `variance` takes every pair of a pixel's layers as
            correlated alike, as strongly as explains the variance of the sum before.

        Raises:
            ValueError: no layer of that name; a factor below 0.
        """
        names = [layer.name for layer in self.layers]
        for name, weight in weights.items():
            if name not in names:
                raise ValueError(f"no layer named {name!r}; there are: {', '.join(names)}")
            if np.min(weight) < 0:
                raise ValueError(f"layer {name!r}: factor {weight}, expected 0 or more")
        factors = [np.asarray(weights.get(name, 1.0), np.float32) for name in names]
        return replace(
            self,
            layers=tuple(layer.times(f) for layer, f in zip(self.layers, factors, strict=True)),
            noisy=tuple(layer.times(f) for layer, f in zip(self.noisy, factors, strict=False)),
            objects=None if self.objects is None else self.objects.reweighted(weights),
            variance=self._variance_of_sum(factors),
        )

    def variance_of(self, weights: Mapping[str, float | Sequence[float] | F64]) -> F32 | None:
        """(H, W, 3) variance of the beauty that :meth:`reweighted` gives, without making it; None where unknown."""
        return self._variance_of_sum([np.asarray(weights.get(x.name, 1.0), np.float32) for x in self.layers])

    def _variance_of_sum(self, factors: Sequence[F32]) -> F32 | None:
        """Of the layers' sum with these factors; None where it is not known of the layers or their plain sum."""
        if self.variance is None or any(layer.variance is None for layer in self.layers):
            return None
        zero = np.zeros_like(self.variance)
        apart, together, new_apart, new_together = zero, zero, zero, zero  # errors independent, or all alike
        for layer, factor in zip(self.layers, factors, strict=True):
            variance = np.asarray(layer.variance)
            deviation = np.sqrt(variance)
            apart, together = apart + variance, together + deviation
            new_apart, new_together = new_apart + factor**2 * variance, new_together + factor * deviation
        between = together**2 - apart
        correlation = np.where(between > 0, (self.variance - apart) / np.where(between > 0, between, 1), 0)
        return np.asarray(new_apart + np.clip(correlation, 0, 1) * (new_together**2 - new_apart), dtype=np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matte(ArrayHolder):
    """Which named parts of the proxy a picture shows (Cryptomatte): of each pixel the parts that cover it, the largest
    first."""

    name: str  # of `planes.MATTES`
    names: tuple[str, ...]  # every part of the proxy, whether it is seen or not
    index: I32  # (H, W, ranks) into `names`, -1 where fewer cover the pixel; an even number of ranks
    share: F32  # (H, W, ranks) of the pixel that it covers, 0..1

    def __post_init__(self) -> None:
        freeze(self, "index", (None, None, None), np.int32)
        freeze(self, "share", self.index.shape)

    def behind(self, through: F32) -> Matte:
        """What is left of it behind something of which (H, W) is let through."""
        return replace(self, share=self.share * through[..., None])

    def __repr__(self) -> str:
        height, width, ranks = self.index.shape
        parts = f"{shown.count(len(self.names), 'name')} ({shown.names(self.names)})"
        return f"Matte({self.name!r}, {width} x {height}: {ranks} ranks of {parts})"


EMISSION = "emission"  # the layer of what the proxy's own surfaces send out


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What made an output; written into every file."""

    mirelight: str  # version
    versions: Mapping[str, str] = field(default_factory=dict)  # mitsuba, drjit, llvm, numpy, …
    job: str = ""  # the job file's name
    inputs: Mapping[str, str] = field(default_factory=dict)  # path as the job names it -> SHA-256 hex
    settings: Mapping[str, Any] = field(default_factory=dict)  # every setting that shapes pixels, JSON values
    lighting: str = ""
    fingerprint: str = ""  # SHA-256 over all that decides this frame's pixels; equal: the frame need not be made again
    partial: bool = False  # interrupted: not all samples are in


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame(ArrayHolder):
    """A finished frame: linear and premultiplied; alpha is 1 - transmittance, or coverage where there are no splats."""

    camera: Camera
    rgba: F32  # (H, W, 4) relit, linear Rec.709
    unlit: F32 | None  # (H, W, 4) the splats as captured, linear; None without splats
    factor: F32 | None  # (H, W, 3) what the splats were multiplied by, in its own space; None without splats
    lighting: LightingBuffer | None
    splats: SplatLayer | None
    made_by: Provenance | None = None
    noise: F32 | None = None  # (H, W, 3) standard deviation of rgba's colour; None where it is unknown or not wanted
    profile: Profile = "physical"  # by whose transfer curve it is shown; that of the splats where there are any
    background: F32 | None = None  # (H, W, 3) linear light behind the picture; None: what shows it takes a plain colour
    shadow: F32 | None = None  # (H, W, 3) light beside inserted objects over that without them, where it is wanted
    mattes: tuple[Matte, ...] = ()  # what `output.aovs` names of `planes.MATTES`; not read back from a file

    def __post_init__(self) -> None:
        h, w = self.camera.height, self.camera.width
        freeze(self, "rgba", (h, w, 4))
        freeze(self, "unlit", (h, w, 4))
        freeze(self, "factor", (h, w, 3))
        freeze(self, "noise", (h, w, 3))
        freeze(self, "background", (h, w, 3))
        freeze(self, "shadow", (h, w, 3))
        if self.splats is not None:
            object.__setattr__(self, "profile", self.splats.profile)

    def __repr__(self) -> str:
        lighting = f" under {self.made_by.lighting!r}" if self.made_by is not None and self.made_by.lighting else ""
        parts = {"unlit": self.unlit, "factor": self.factor, "noise": self.noise, "splats": self.splats}
        parts["background"] = self.background
        held = [name for name, part in parts.items() if part is not None]
        if self.lighting is not None:
            held.append(f"lighting in {shown.count(len(self.lighting.layers), 'layer')}")
        values = f"alpha {shown.share(self.rgba[..., 3])}, light {shown.span(self.rgba[..., :3])}"
        partial = ", interrupted" if self.made_by is not None and self.made_by.partial else ""
        return (
            f"Frame({shown.view(self.camera)}{lighting}, {self.profile}{partial}: {values};\n"
            f"    with {', '.join(held) if held else 'nothing else'})"
        )

    def _repr_png_(self) -> bytes:
        """In a notebook: the relit picture over its background or black, by the profile's transfer curve."""
        return shown.picture(self.rgba, self.profile, self.background)
