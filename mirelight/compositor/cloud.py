"""The cloud and the camera in the device's memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight.compositor.device import Array, Device
from mirelight.compositor.kernel import SlopeLimits, SplatKernel, slope_limits
from mirelight.compositor.source import shape_of
from mirelight.model import Camera, CompositorSettings, SplatCloud

PADDED = {1: 4, 4: 16, 9: 32, 16: 48}  # SH coefficients -> floats a row: whole packets


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """A splat cloud in the device's memory. N splats."""

    count: int
    degree: int
    antialiased: bool
    means: list[Array]  # 3 x (N,) world units
    factors: list[Array]  # 9 x (N,): rows of R diag(scales)
    opacities: Array  # (N,)
    sh: Array  # (N * padded,) rows of K x 3 coefficients


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """A camera as opaque scalars, so that a new one compiles nothing."""

    eye: list[tuple[Array, Array]]  # each coordinate rounded to float32, and what that lost
    axes: list[list[Array]]  # right, up, back
    focal: tuple[Array, Array]
    center: tuple[Array, Array]
    size: tuple[Array, Array]  # px, as floats
    depths: tuple[Array, Array]  # between which splats are seen
    slopes: SlopeLimits  # of opaque scalars
    perspective: bool


def upload(device: Device, splats: SplatCloud, settings: CompositorSettings) -> Cloud:
    """Copy a cloud to the device, through the engine's work buffer where the profile has one."""
    quats, scales, opacities = shape_of(splats, settings)
    w, x, y, z = (device.floats(quats[:, i]) for i in range(4))
    s = [device.floats(scales[:, i]) for i in range(3)]
    factors = [
        (1 - 2 * (y * y + z * z)) * s[0], 2 * (x * y - w * z) * s[1], 2 * (x * z + w * y) * s[2],
        2 * (x * y + w * z) * s[0], (1 - 2 * (x * x + z * z)) * s[1], 2 * (y * z - w * x) * s[2],
        2 * (x * z - w * y) * s[0], 2 * (y * z + w * x) * s[1], (1 - 2 * (x * x + y * y)) * s[2],
    ]  # fmt: skip
    device.dr.eval(factors)
    count, coefficients = splats.sh.shape[:2]
    padded = PADDED[coefficients]
    rows = splats.sh.reshape(count, -1)
    if padded != 3 * coefficients:
        rows = np.pad(rows, ((0, 0), (0, padded - 3 * coefficients)))
    return Cloud(
        count=count,
        degree=splats.sh_degree,
        antialiased=splats.antialiased,
        means=[device.floats(splats.means[:, i]) for i in range(3)],
        factors=factors,
        opacities=device.floats(opacities),
        sh=device.floats(rows),
    )


def view_of(device: Device, camera: Camera, kernel: SplatKernel) -> Eye:
    """The camera's numbers on the device."""
    c = device.constant
    limits = slope_limits(kernel, camera)
    rounded = camera.position.astype(np.float32).astype(np.float64)
    return Eye(
        eye=[(c(high), c(v - high)) for v, high in zip(camera.position, rounded, strict=True)],
        axes=[[c(v) for v in camera.world_from_camera[:3, i]] for i in range(3)],
        focal=(c(camera.fx), c(camera.fy)),
        center=(c(camera.cx), c(camera.cy)),
        size=(c(camera.width), c(camera.height)),
        depths=(c(camera.near), c(camera.far)) if kernel.clips_depth else (c(0), c(np.inf)),
        slopes=SlopeLimits(*(c(v) for v in (limits.left, limits.right, limits.bottom, limits.top))),
        perspective=camera.projection == "perspective",
    )


def from_eye(cloud: Cloud, view: Eye) -> list[Array]:
    """Centres as seen from the eye, world axes. Exact far from the origin too, where float32 would lose the eye."""
    return [(m - high) - low for m, (high, low) in zip(cloud.means, view.eye, strict=True)]


def dot(dr: Array, a: list[Array], b: list[Array]) -> Array:
    """a · b of three components."""
    return dr.fma(a[0], b[0], dr.fma(a[1], b[1], a[2] * b[2]))


def clamp(dr: Array, value: Array, low: Array, high: Array) -> Array:
    """Without the NaN rules of `dr.clip`, which cost five instructions a side."""
    value = dr.select(value < low, low, value)
    return dr.select(value > high, high, value)
