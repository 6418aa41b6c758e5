"""The light table: every light as one row of floats, so that lights can change without a recompile. NumPy only.

Formulas of directional, point and spot lights: KHR_lights_punctual, "Range Property" and "Inner and Outer Cone Angles".
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from mirelight.model import (
    F32,
    AreaLight,
    DirectionalLight,
    IesProfile,
    Light,
    PointLight,
    SpotLight,
    SunLight,
    TubeLight,
    cones,
    digest,
)

ROW = 24  # floats a light: six groups of four, which one packet gather each reads
ALL_LIGHTS = (
    12  # up to this many, every light is sampled at every hit, so that each layer is as clean as rendered alone
)
_NEAREST = 1e18  # the largest 1 / range in the table: what reaches no farther lights nothing, and more is no float32
_OWN = np.uint32(1 << 31)  # apart from the numbers that a hit's other samples are drawn with


class Kind(IntEnum):
    """How a row is sampled. Order matters: up to SPOT a light is a point, up to SPHERE a cone of directions."""

    DIRECTIONAL = 0
    POINT = 1
    SPOT = 2
    SUN = 3
    SPHERE = 4
    RECTANGLE = 5
    DISK = 6
    TUBE = 7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Row:
    """One light, in the order in which it is packed, and what stands where it has nothing of a kind."""

    kind: Kind
    position: NDArray[np.float64]  # the way to the light, for lights at infinity
    axis: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    radius: float = 0.0  # of a sun: the sine of its angular radius
    strength: NDArray[np.float64]
    reach: float = float("inf")
    x: tuple[NDArray[np.float64], float] = field(default_factory=lambda: (np.zeros(3), 0.0))  # axis, half width
    y: tuple[NDArray[np.float64], float] = field(default_factory=lambda: (np.zeros(3), 0.0))  # axis, half height
    cone: tuple[float, float, float] = (0.0, 1.0, 0.0)  # that of `spot_cone`; this one is none

    def packed(self) -> NDArray[np.float64]:
        """(ROW,) position, kind | axis, radius | strength, 1 / range | x | y | cone, and where a profile begins."""
        groups = [
            (self.position, float(self.kind)),
            (self.axis, self.radius),
            (self.strength, min(1.0 / self.reach, _NEAREST)),
            self.x,
            self.y,
            (np.array(self.cone), 0.0),
        ]
        return np.concatenate([np.append(vector, number) for vector, number in groups])


def spot_cone(light: SpotLight) -> tuple[float, float, float]:
    """(scale, offset, smooth): t = saturate(scale cos + offset), the cone t² or, where smooth is 1, t² (3 - 2t)."""
    scale, offset = cones.scale_and_offset(light.cone, light.inner_cone_angle, light.outer_cone_angle)
    return scale, offset, float(light.cone == "playcanvas")


def _row(light: Light) -> _Row:
    strength = light.color * light.intensity
    match light:
        case DirectionalLight():
            return _Row(kind=Kind.DIRECTIONAL, position=-light.direction, strength=strength)
        case SunLight():
            sine = float(np.sin(np.radians(light.angular_diameter) / 2))
            kind = Kind.SUN if sine > 0 else Kind.DIRECTIONAL
            return _Row(kind=kind, position=-light.direction, strength=strength, radius=sine)
        case PointLight():
            kind = Kind.SPHERE if light.radius > 0 else Kind.POINT
            row = _Row(kind=kind, position=light.position, strength=strength, radius=light.radius, reach=light.range)
            return (
                row if light.profile is None else _with_profile(replace(row, axis=light.profile.nadir), light.profile)
            )
        case SpotLight():
            row = _Row(
                kind=Kind.SPHERE if light.radius > 0 else Kind.SPOT,
                position=light.position,
                strength=strength,
                axis=light.direction,
                radius=light.radius,
                reach=light.range,
                cone=spot_cone(light),
            )
            return row if light.profile is None else _with_profile(row, light.profile)
        case AreaLight():
            return _area_row(light)
        case TubeLight():
            return _Row(
                kind=Kind.TUBE,
                position=light.place,
                axis=light.way,
                radius=light.radius,
                strength=strength,
                x=(np.zeros(3), light.length / 2),
            )
        case _:
            assert_never(light)


def _with_profile(row: _Row, profile: IesProfile) -> _Row:
    return replace(row, x=(profile.zero, 0.0), y=(profile.quarter, 0.0))


def _area_row(light: AreaLight) -> _Row:
    m = light.world_from_light
    half_width, half_height = light.size[0] / 2, light.size[1] / 2
    radiance = light.color * light.intensity
    if light.shape == "sphere":  # candela of a glowing ball: radiance times its silhouette
        strength = radiance * np.pi * half_width**2
        return _Row(kind=Kind.SPHERE, position=m[:3, 3], strength=strength, radius=half_width)
    return _Row(
        kind=Kind.RECTANGLE if light.shape == "rectangle" else Kind.DISK,
        position=m[:3, 3],
        strength=radiance,
        axis=-m[:3, 2],
        radius=half_width,
        x=(m[:3, 0], half_width),
        y=(m[:3, 1], half_height),
    )


def pack(lights: tuple[Light, ...]) -> F32:
    """The light table, (max(n, 2) or more, ROW) float32: unused rows are dark directional lights.

    At least two rows, because Dr.Jit treats a single one as a constant and would compile it in. Behind them stand the
    profiles of lights that have one, each once; the last float of a light's row is where its own begins, 0 for none.
    """
    rows = [_row(light).packed() for light in lights]
    while len(rows) < 2:
        dark = _Row(kind=Kind.DIRECTIONAL, position=np.array([0.0, 1.0, 0.0]), strength=np.zeros(3))
        rows.append(dark.packed())
    places: dict[str, int] = {}
    profiles: list[NDArray[np.float64]] = []
    for row, light in zip(rows, lights, strict=False):
        profile = light.profile if isinstance(light, PointLight | SpotLight) else None
        if profile is not None:
            known = digest(profile.share)
            if known not in places:
                places[known] = len(rows) + sum(len(x) for x in profiles)
                flat = profile.share.ravel().astype(np.float64)
                profiles.append(np.append(flat, np.zeros(-len(flat) % ROW)).reshape(-1, ROW))
            row[-1] = places[known]
    return np.concatenate([np.asarray(rows), *profiles]).astype(np.float32)


def brightness(table: F32) -> F32:
    """(N,) candela, or lux of what is far away, that a row may have at most, of rows (N, ROW), by colour on average."""
    kind, strength = table[:, 3], table[:, 8:11].mean(axis=1)
    flat = np.isin(kind, (Kind.RECTANGLE, Kind.DISK))
    strength = np.where(flat, strength * 4 * table[:, 15] * table[:, 19], strength)
    return np.asarray(np.where(kind == Kind.TUBE, strength * 4 * table[:, 7] * table[:, 15], strength))


def seeds(lights: tuple[Light, ...]) -> NDArray[np.uint32]:
    """(max(n, 2),) what each light's random numbers are drawn with, as long as all are sampled at every hit.

    Up to `ALL_LIGHTS` they are functions of the light alone, whatever its strength and name and whatever lights are
    beside it: its layer then has the same bits wherever it is traced. Equal lights of one layer differ.
    """
    if len(lights) > ALL_LIGHTS:
        return _OWN | np.arange(len(lights), dtype=np.uint32)
    met: Counter[str] = Counter()
    out = np.zeros(max(len(lights), 2), np.uint32)
    for i, light in enumerate(lights):
        own = digest(replace(light, name="", group=None, color=np.ones(3), intensity=1.0))
        layer = f"{own} {light.group or light.name}"
        out[i] = int(own[:8], 16) + met[layer]
        met[layer] += 1
    return _OWN | out
