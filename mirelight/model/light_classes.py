"""The classes of lights, each with the record that readers, writers and lists take of it. KHR = glTF extension
KHR_lights_punctual."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal, Self, TypeAlias, get_args

import numpy as np

from mirelight.base import conventions
from mirelight.model.arrays import F64, freeze
from mirelight.model.cones import ConeLaw
from mirelight.model.ies import IesProfile
from mirelight.model.light_kinds import CANDELA, LUX, DistantLight, LampLight, LightField, LightKind, PosedLight
from mirelight.model.surface_lights import AreaLight, GlowingLight

_RANGE = LightField(
    name="range",
    unit="world units",
    meaning="Distance at which it has faded to nothing (the window of KHR).",
    default=math.inf,
    most=math.inf,
)
_RADIUS = LightField(
    name="radius",
    unit="world units",
    meaning="Radius of a glowing sphere of the same candela; 0: hard shadows.",
    default=0.0,
    least_itself=True,
)
_INNER = LightField(
    name="inner_cone_angle",
    unit="rad",
    meaning="Half angle at which it starts to fade.",
    default=0.0,
    least_itself=True,
    most=math.pi / 2,
)
_OUTER = LightField(
    name="outer_cone_angle",
    unit="rad",
    meaning="Half angle at which it is gone.",
    default=math.pi / 4,
    most=math.pi / 2,
)

Falloff: TypeAlias = Literal["linear", "inverse-squared"]  # the real-time engine's two


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DirectionalLight(DistantLight):
    """KHR directional light: parallel, no position, hard shadows."""

    KIND: ClassVar = LightKind(
        name="directional", meaning="Parallel light with hard shadows (KHR directional).", unit=LUX, layer="sun"
    )

    name: str
    direction: F64  # (3,) unit, the way the light travels
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear Rec.709
    intensity: float = 1.0  # lux (illuminance on a facing surface)
    shadows: bool = True  # playcanvas: casts shadows; physical light always does
    penumbra: float = 0.0  # of the real-time engine's soft shadows (its penumbraSize); 0: hard ones
    penumbra_falloff: float = 1.0  # of those, directional ones (its penumbraFalloff)
    group: str | None = None  # names the layer that it shares; None: one of its own

    @property
    def is_sharp(self) -> bool:
        """It is."""
        return True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointLight(LampLight):
    """KHR point light, or a sphere of that radius with the same candela."""

    KIND: ClassVar = LightKind(
        name="point",
        meaning="Light from one place in all directions (KHR point).",
        unit=CANDELA,
        layer="lamp",
        fields=(_RANGE, _RADIUS),
    )

    name: str
    position: F64  # (3,) world units
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # candela
    range: float = float("inf")  # world units; KHR window max(min(1 - (d/range)^4, 1), 0); inf: none
    radius: float = 0.0  # world units; 0: a point with hard shadows
    profile: IesProfile | None = None  # by direction, times the candela; None: the same all around
    falloff: Falloff | None = None  # of a light written in the real-time engine's terms; physical light has its own law
    shadows: bool = True  # playcanvas: casts shadows; physical light always does
    penumbra: float = 0.0  # of the real-time engine's soft shadows (its penumbraSize); 0: hard ones
    group: str | None = None  # names the layer that it shares; None: one of its own

    def carried(self, matrix: F64) -> Self:
        """Carried through a matrix (4, 4), with its profile; range, radius and candela stay."""
        return replace(self, position=_moved(matrix, self.position), profile=_turned(matrix, self.profile))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpotLight(LampLight):
    """KHR spot light: light fades between two half angles by a law (`model.cones`), `range` as for points."""

    KIND: ClassVar = LightKind(
        name="spot",
        meaning="Light from one place into a cone (KHR spot).",
        unit=CANDELA,
        layer="lamp",
        fields=(_RANGE, _INNER, _OUTER, _RADIUS),
    )

    name: str
    position: F64  # (3,) world units
    direction: F64  # (3,) unit, the cone's axis away from the light
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # candela inside the inner cone
    range: float = float("inf")  # world units
    inner_cone_angle: float = 0.0  # rad, half angle, 0 <= inner < outer; equal to it: a hard edge
    outer_cone_angle: float = float(np.pi / 4)  # rad, half angle, <= pi / 2
    cone: ConeLaw = "khr"
    profile: IesProfile | None = None  # by direction, times candela and cone; its nadir is the axis
    radius: float = 0.0  # world units; 0: a point with hard shadows
    falloff: Falloff | None = None  # of a light written in the real-time engine's terms; physical light has its own law
    shadows: bool = True  # playcanvas: casts shadows; physical light always does
    penumbra: float = 0.0  # of the real-time engine's soft shadows (its penumbraSize); 0: hard ones
    group: str | None = None  # names the layer that it shares; None: one of its own

    def __post_init__(self) -> None:
        LampLight.__post_init__(self)
        object.__setattr__(self, "direction", conventions.unit(self.direction))
        freeze(self, "direction", (3,), np.float64)
        if self.profile is not None and not np.allclose(self.profile.nadir, self.direction, atol=1e-6):
            raise ValueError("SpotLight.profile: its nadir is not the spot's direction")

    def carried(self, matrix: F64) -> Self:
        """Carried through a matrix (4, 4), with its profile; range, radius, cone and candela stay."""
        return replace(
            self,
            position=_moved(matrix, self.position),
            direction=matrix[:3, :3] @ self.direction,
            profile=_turned(matrix, self.profile),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SunLight(DistantLight):
    """A far disc: a directional light with an angular diameter, so soft shadow edges."""

    KIND: ClassVar = LightKind(
        name="sun",
        meaning="A far disc: parallel light with soft shadow edges.",
        unit=LUX,
        layer="sun",
        fields=(
            LightField(
                name="angular_diameter",
                unit="degrees",
                meaning="Size of the disc in the sky, in degrees.",
                default=0.53,
                most=90.0,
            ),
        ),
    )

    name: str
    direction: F64  # (3,) unit, the way the light travels (from the disc's centre)
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # lux on a surface facing the disc's centre
    angular_diameter: float = 0.53  # degrees, > 0
    group: str | None = None  # names the layer that it shares; None: one of its own


Light: TypeAlias = PointLight | SpotLight | SunLight | DirectionalLight | GlowingLight
LIGHT_CLASSES: tuple[type[Light], ...] = get_args(Light)  # every list of lights is made from these
PunctualLight: TypeAlias = DirectionalLight | PointLight | SpotLight  # KHR_lights_punctual has words for them
ParallelLight: TypeAlias = DirectionalLight | SunLight  # shine from far away, along a direction


def kind_named(name: str) -> LightKind | None:
    """The record of a class by the name of its kind, "point"; None: there is none."""
    return next((x.KIND for x in LIGHT_CLASSES if x.KIND.name == name), None)


def punctual(light: Light) -> PunctualLight:
    """The light of KHR_lights_punctual nearest to a light, which any viewer shows: of a glowing surface one of as many
    candela as that has in its brightest direction."""
    match light:
        case SunLight():
            return DirectionalLight(
                name=light.name, direction=light.direction, color=light.color, intensity=light.intensity
            )
        case PosedLight():
            whole = not light.KIND.one_sided or (isinstance(light, AreaLight) and light.shape == "sphere")
            if whole:
                return PointLight(name=light.name, position=light.place, color=light.color, intensity=light.peak)
            return SpotLight(
                name=light.name,
                position=light.place,
                direction=light.way,
                color=light.color,
                intensity=light.peak,
                outer_cone_angle=math.pi / 2,
            )
        case _:
            return light


def _moved(matrix: F64, point: F64) -> F64:
    return np.asarray(matrix[:3, :3] @ point + matrix[:3, 3])


def _turned(matrix: F64, profile: IesProfile | None) -> IesProfile | None:
    """A profile whose axes go through a matrix (4, 4)."""
    if profile is None:
        return None
    nadir, zero = (conventions.unit(matrix[:3, :3] @ way) for way in (profile.nadir, profile.zero))
    return replace(profile, nadir=nadir, zero=zero)
