"""Lights that are glowing surfaces with a pose, each with the record that readers, writers and lists take of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np

from mirelight.model.arrays import F64
from mirelight.model.light_kinds import NIT, LightField, LightKind, PosedLight, UsdPrim


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AreaLight(PosedLight):
    """A glowing rectangle, disk or sphere, seen by light only (it is not part of the proxy and blocks nothing)."""

    KIND: ClassVar = LightKind(
        name="area", meaning="A glowing rectangle, disk or sphere.", unit=NIT, layer="area", one_sided=True
    )

    name: str
    shape: Literal["rectangle", "disk", "sphere"]
    world_from_light: F64  # (4, 4) rigid; a rectangle or disk lies in its XY plane and shines along its -Z
    size: tuple[float, float]  # world units: rectangle width and height; disk and sphere: diameter, twice
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # candela per square metre (radiance), the same in every direction it shines
    group: str | None = None  # names the layer that it shares; None: one of its own

    @property
    def peak(self) -> float:
        """Candela along its axis; of a sphere, everywhere."""
        return self.intensity * self._area

    @property
    def flux(self) -> float:
        """Lumens: pi times the whole surface times the luminance; a sphere's is four times its silhouette."""
        return self.peak * math.pi * (4 if self.shape == "sphere" else 1)

    def seen_area(self, ways: F64) -> F64:
        """(N,) square world units: nothing of its back."""
        if self.shape == "sphere":
            return np.full(len(ways), self._area)
        return np.asarray(self._area * np.maximum(-ways @ self.world_from_light[:3, 2], 0))

    @property
    def _area(self) -> float:
        """Of what its axis sees of it."""
        return self.size[0] * self.size[1] * (1.0 if self.shape == "rectangle" else math.pi / 4)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TubeLight(PosedLight):
    """A glowing tube, as fluorescent and neon ones: it shines around its axis, not from its ends."""

    KIND: ClassVar = LightKind(
        name="tube",
        meaning="A glowing tube: it shines around its axis, not from its ends.",
        unit=NIT,
        layer="area",
        fields=(
            LightField(name="length", unit="world units", meaning="Length in world units.", default=1.0),
            LightField(name="radius", unit="world units", meaning="Radius in world units.", default=0.02),
        ),
        aim="Its axis.",
        usd=UsdPrim(name="CylinderLight", axis="X"),
    )

    name: str
    world_from_light: F64  # (4, 4) rigid; the tube lies along its Z, its middle at 0
    length: float = 1.0  # world units, above 0
    radius: float = 0.02  # world units, above 0
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # candela per square metre (radiance), the same in every direction
    group: str | None = None  # names the layer that it shares; None: one of its own

    @property
    def peak(self) -> float:
        """Candela across its axis."""
        return self.intensity * 2 * self.radius * self.length

    @property
    def flux(self) -> float:
        """Lumens: pi times its surface times the luminance (Lambert)."""
        return self.intensity * math.pi * 2 * math.pi * self.radius * self.length

    def seen_area(self, ways: F64) -> F64:
        """(N,) square world units: its outline's, the sine of the angle to its axis."""
        cosine = ways @ self.way
        return np.asarray(2 * self.radius * self.length * np.sqrt(np.maximum(1 - cosine**2, 0)))


GlowingLight: TypeAlias = AreaLight | TubeLight
# What readers and writers know by the record alone: glowing surfaces with a pose and numbers.
DESCRIBED: tuple[type[GlowingLight], ...] = tuple(x for x in get_args(GlowingLight) if x.KIND.aim)


def described_light(
    kind: LightKind,
    name: str,
    pose: F64,
    values: Mapping[str, float],
    *,
    color: F64,
    intensity: float = 1.0,
) -> GlowingLight:
    """A light of one of `DESCRIBED`.

    Args:
        kind: its record.
        name: of the light.
        pose: (4, 4) its `world_from_light`.
        values: of the kind's fields, by name.
        color: (3,) linear.
        intensity: in the kind's unit.
    """
    made: Any = next(x for x in DESCRIBED if x.KIND is kind)
    light: GlowingLight = made(name=name, world_from_light=pose, color=color, intensity=intensity, **values)
    return light
