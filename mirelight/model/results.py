"""What the stages hand on: splat layers, lighting buffers, frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mirelight.model.arrays import F32, freeze
from mirelight.model.cameras import Camera
from mirelight.model.settings import Profile


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SplatLayer:
    """A composite of splats, before any lighting. `color` is in the space that the splats blend in."""

    camera: Camera
    color: F32  # (H, W, 3) premultiplied; display-encoded, or linear where `linear` is set
    transmittance: F32  # (H, W) what is left of a background, 0..1
    depth: F32  # (H, W) mean over blended splats of the view depth, world units; 0 where nothing is
    median_depth: F32  # (H, W) view depth where transmittance falls to 0.5; 0 where it does not
    profile: Profile = "physical"
    linear: bool = False  # color is linear light (playcanvas 'linear' pipeline)

    def __post_init__(self) -> None:
        h, w = self.camera.height, self.camera.width
        freeze(self, "color", (h, w, 3))
        for name in ("transmittance", "depth", "median_depth"):
            freeze(self, name, (h, w))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LightLayer:
    """What one light (or the environment, or emissive surfaces) adds to the lit proxy; premultiplied by coverage."""

    name: str
    direct: F32  # (H, W, 3) linear radiance after one reflection
    indirect: F32  # (H, W, 3) linear radiance after more

    def __post_init__(self) -> None:
        freeze(self, "direct", (None, None, 3))
        freeze(self, "indirect", (None, None, 3))

    @property
    def total(self) -> F32:
        """(H, W, 3) direct + indirect."""
        return np.asarray(self.direct + self.indirect, dtype=np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LightingBuffer:
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
    variance: F32 | None = None  # (H, W, 3) variance of the beauty's mean, where it was estimated
    spp: int = 0  # samples per pixel that went in

    def __post_init__(self) -> None:
        h, w = self.camera.height, self.camera.width
        for name in ("coverage", "depth"):
            freeze(self, name, (h, w))
        for name in ("position", "normal", "geometric_normal", "albedo", "variance"):
            freeze(self, name, (h, w, 3))
        for layer in self.layers:
            if layer.direct.shape != (h, w, 3):
                raise ValueError(f"layer {layer.name!r}: shape {layer.direct.shape}, expected {(h, w, 3)}")

    @property
    def beauty(self) -> F32:
        """(H, W, 3) sum of all layers, premultiplied by coverage."""
        out = np.zeros((self.camera.height, self.camera.width, 3), dtype=np.float32)
        for layer in self.layers:
            out += layer.direct
            out += layer.indirect
        return out


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """A finished frame: linear and premultiplied; alpha is 1 - transmittance, or coverage where there are no splats."""

    camera: Camera
    rgba: F32  # (H, W, 4) relit, linear Rec.709
    unlit: F32 | None  # (H, W, 4) the splats as captured, linear; None without splats
    factor: F32 | None  # (H, W, 3) what the splats were multiplied by, in its own space; None without splats
    lighting: LightingBuffer | None
    splats: SplatLayer | None
    made_by: Provenance | None = None
    noise: F32 | None = None  # (H, W, 3) standard deviation of rgba's colour; None where the lighting's is unknown

    def __post_init__(self) -> None:
        h, w = self.camera.height, self.camera.width
        freeze(self, "rgba", (h, w, 4))
        freeze(self, "unlit", (h, w, 4))
        freeze(self, "factor", (h, w, 3))
        freeze(self, "noise", (h, w, 3))
