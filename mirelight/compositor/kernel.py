"""The numbers that turn a splat into pixels, for one frame's size; shared by the NumPy oracle and the Dr.Jit kernels.

A splat of projected covariance S (px²) and opacity o covers a pixel at offset d from its centre with

    E     = exp(-½ dᵀ (S + low_pass I)⁻¹ d)
    alpha = min(o E, alpha_max)                     plain
    alpha = o (E - e⁻⁴) / (1 - e⁻⁴)                 truncated: falls to 0 at d²= 8, where the engine's quad ends

and a fragment with alpha below the clip is dropped. Where there is a cut-off c, so is one with
dᵀ (S + low_pass I)⁻¹ d ≥ c².

The numbers of each profile, and their sources, are in `mirelight.model.profiles`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight.model import Camera, CompositorSettings, rules_of

LEAST_CLIP = 1e-6  # a clip of 0 would give every splat the whole frame
E4 = float(np.exp(-4.0))  # the truncated kernel's value at its edge


@dataclass(frozen=True, slots=True)
class FragmentRule:
    """How a fragment's alpha follows from its exponent, and when a pixel ends: all that is compiled into the blend."""

    alpha_clip: float  # fragments below are dropped
    alpha_max: float  # upper clamp of a fragment's alpha; 1: none
    truncated: bool  # the kernel minus its value at d² = 8, rescaled
    stop: float | None  # a fragment that would leave less transmittance is not blended and ends its pixel
    cutoff: float | None  # fragments from so many standard deviations on are dropped


@dataclass(frozen=True, slots=True)
class SplatKernel:
    """How one profile rasterises. Lengths in pixels of the frame."""

    low_pass: float  # px², added to both variances
    alpha_clip: float  # fragments below are dropped
    alpha_max: float  # upper clamp of a fragment's alpha; 1: none
    truncated: bool  # the kernel minus its value at d² = 8, rescaled
    stop: float | None  # a fragment that would leave less transmittance is not blended and ends its pixel
    cutoff: float | None  # fragments from so many standard deviations on are dropped
    frustum_margin: float | None  # Jacobian's slope clamp, in tangents of the half field of view; None: no clamp
    clips_depth: bool  # centres outside near..far are dropped; else only those behind the eye
    least_compensation: float  # floor of the squared opacity compensation of antialiased clouds
    min_variance: float  # px² (low-pass included): splats whose major variance is smaller are dropped
    max_variance: float  # px²: variances along the axes are clamped to it

    @property
    def fragment(self) -> FragmentRule:
        """What holds for single fragments, whatever the frame."""
        return FragmentRule(self.alpha_clip, self.alpha_max, self.truncated, self.stop, self.cutoff)


def splat_kernel(settings: CompositorSettings, camera: Camera) -> SplatKernel:
    """The kernel of `settings.profile` for one frame size."""
    rules = rules_of(settings.profile).splats
    limit = rules.largest_half
    half = float("inf") if limit is None else float(min(limit, camera.width, camera.height))
    return SplatKernel(
        low_pass=rules.low_pass,
        alpha_clip=max(settings.alpha_clip, LEAST_CLIP),
        alpha_max=rules.alpha_max,
        truncated=rules.truncated,
        stop=rules.stop,
        cutoff=None if rules.truncated else settings.cutoff,
        frustum_margin=rules.frustum_margin,
        clips_depth=rules.clips_depth,
        least_compensation=rules.least_compensation,
        # half extent sqrt(8 v) px, against min_pixel_size / 2 px and against the largest
        min_variance=settings.min_pixel_size**2 / 32 if rules.drops_small else 0.0,
        max_variance=half**2 / 8,
    )


@dataclass(frozen=True, slots=True)
class SlopeLimits:
    """Where a perspective Jacobian's slopes x/w and y/w (y up) are clamped."""

    left: float
    right: float
    bottom: float
    top: float


def slope_limits(kernel: SplatKernel, camera: Camera) -> SlopeLimits:
    """The frustum widened by `frustum_margin` half fields of view on each side.

    For a centred camera that is the CUDA rasteriser's 1.3 tan(fov / 2); off-centre cameras follow gsplat's form.
    """
    if kernel.frustum_margin is None or camera.projection == "orthographic":
        return SlopeLimits(-np.inf, np.inf, -np.inf, np.inf)
    x = kernel.frustum_margin * camera.width / (2 * camera.fx)
    y = kernel.frustum_margin * camera.height / (2 * camera.fy)
    return SlopeLimits(
        left=-camera.cx / camera.fx - x,
        right=(camera.width - camera.cx) / camera.fx + x,
        bottom=-(camera.height - camera.cy) / camera.fy - y,
        top=camera.cy / camera.fy + y,
    )
