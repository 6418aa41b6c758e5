"""What every reader, writer and list knows of a class of lights: a record beside each class, and what all can answer.

`mirelight.model.light_classes` and `surface_lights` have the classes. Nobody else lists them: lists are made from these
records, and what a format has no words for is written and read by them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, cast

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base import conventions
from mirelight.model.arrays import F64, ArrayHolder, freeze


@dataclass(frozen=True, slots=True, kw_only=True)
class IntensityUnit:
    """What a light's intensity counts in."""

    key: str  # as the `unit` of a job's light
    name: str  # in sentences
    symbol: str  # in lists
    of_data_sets: str  # as lights.json says it
    grows: int = 0  # in a world scaled by s, the number is s to the power of this times as large


LUX = IntensityUnit(key="lux", name="lux", symbol="lux", of_data_sets="lux")
CANDELA = IntensityUnit(
    key="candela",
    name="candela",
    symbol="cd",
    of_data_sets="candela, of the data set's world: the job's times the square of its scale",
    grows=2,
)
NIT = IntensityUnit(key="nit", name="cd/m²", symbol="cd/m²", of_data_sets="candela per square metre")


@dataclass(frozen=True, slots=True, kw_only=True)
class LightField:
    """A number that lights of a class have beside colour, intensity, place and direction."""

    name: str  # of the attribute; key in job files and, after "mirelight_", in a glTF file's extras
    unit: Literal["world units", "degrees", "rad"]
    meaning: str  # a sentence
    default: float
    least: float = 0.0
    least_itself: bool = False  # whether it may be the least
    most: float = 1e9

    @property
    def label(self) -> str:
        """Its name on a page."""
        return self.name.replace("_", " ").capitalize()

    def wrong(self, value: float) -> str:
        """What is expected instead of a value; empty where it is right."""
        if self.least < value <= self.most or (self.least_itself and value == self.least):
            return ""
        return f"expected {'' if self.least_itself else 'above '}{self.least:g}, and not above {self.most:g}"


@dataclass(frozen=True, slots=True, kw_only=True)
class UsdPrim:
    """A prim of UsdLux that is a class's light, its `intensity` in cd/m², other inputs of the fields' names."""

    name: str
    axis: Literal["-Z", "X"] = "-Z"  # of the prim, that stands where the light is aimed


@dataclass(frozen=True, slots=True, kw_only=True)
class LightKind:
    """What is known of a class of lights."""

    name: str  # its `type` in job files, reports, data sets and pages
    meaning: str  # a sentence
    unit: IntensityUnit
    layer: Literal["lamp", "sun", "area"]  # what an index of kept layers calls one
    fields: tuple[LightField, ...] = ()
    aim: str = ""  # what its direction says, a sentence, where the record is all that readers and writers need
    one_sided: bool = False  # of a glowing surface: it shines into the half space that it is aimed at, not all around
    usd: UsdPrim | None = None  # what it is written as; None: the prim of the nearest punctual light, or its own code


class LightBase(ArrayHolder):
    """What every light can answer; its fields are those of its dataclass."""

    __slots__ = ()
    KIND: ClassVar[LightKind]

    if TYPE_CHECKING:  # fields of the dataclasses

        @property
        def name(self) -> str:
            """Names its layer."""

        @property
        def color(self) -> F64:
            """(3,) linear Rec.709."""

        @property
        def intensity(self) -> float:
            """In the unit of its kind."""

    @property
    def place(self) -> F64 | None:
        """(3,) where it is, world units; None: nowhere, as it shines from far away."""
        return None

    @property
    def is_sharp(self) -> bool:
        """Whether it reaches a point from one direction alone."""
        return False

    def moved_to(self, position: ArrayLike) -> Self:
        """The light at another place (3,), world units, turned as before; one from far away as it is."""
        return self

    def carried(self, matrix: F64) -> Self:
        """The light carried through a matrix (4, 4): place and direction move; lengths and intensity stay, as in
        KHR_lights_punctual."""
        raise NotImplementedError


class DistantLight(LightBase):
    """Shines from far away, along a direction."""

    __slots__ = ()

    if TYPE_CHECKING:

        @property
        def direction(self) -> F64:
            """(3,) unit, the way the light travels."""

    def __post_init__(self) -> None:
        freeze(self, "color", (3,), np.float64)
        object.__setattr__(self, "direction", conventions.unit(self.direction))
        freeze(self, "direction", (3,), np.float64)

    def carried(self, matrix: F64) -> Self:
        """Turned by a matrix (4, 4)."""
        return cast(Self, replace(cast(Any, self), direction=matrix[:3, :3] @ self.direction))


class LampLight(LightBase):
    """Shines from one place."""

    __slots__ = ()

    if TYPE_CHECKING:

        @property
        def position(self) -> F64:
            """(3,) world units."""

        @property
        def radius(self) -> float:
            """World units; 0: a point with hard shadows."""

    def __post_init__(self) -> None:
        freeze(self, "color", (3,), np.float64)
        freeze(self, "position", (3,), np.float64)

    @property
    def place(self) -> F64:
        """(3,) world units."""
        return self.position

    @property
    def is_sharp(self) -> bool:
        """Without a radius it is."""
        return self.radius == 0

    def moved_to(self, position: ArrayLike) -> Self:
        """At another place (3,), world units."""
        return cast(Self, replace(cast(Any, self), position=np.asarray(position, np.float64)))


class PosedLight(LightBase):
    """A glowing surface with a pose, seen by light only: it is not part of the proxy and blocks nothing.

    A new class of these needs no line in any reader, writer or list: they take its record, and what stands here.
    """

    __slots__ = ()

    if TYPE_CHECKING:

        @property
        def world_from_light(self) -> F64:
            """(4, 4) rigid; it is aimed along its -Z."""

    def __post_init__(self) -> None:
        freeze(self, "color", (3,), np.float64)
        freeze(self, "world_from_light", (4, 4), np.float64)

    @property
    def place(self) -> F64:
        """(3,) its middle, world units."""
        return self.world_from_light[:3, 3]

    @property
    def way(self) -> F64:
        """(3,) unit, the way it is aimed."""
        return -self.world_from_light[:3, 2]

    @property
    def peak(self) -> float:
        """Candela in its brightest direction, from afar."""
        raise NotImplementedError

    @property
    def flux(self) -> float:
        """Lumens, all of its light."""
        raise NotImplementedError

    def seen_area(self, ways: F64) -> F64:
        """(N,) square world units of it that are seen from afar, looking from it along unit directions (N, 3)."""
        raise NotImplementedError

    def moved_to(self, position: ArrayLike) -> Self:
        """At another place (3,), world units, turned as before."""
        pose = self.world_from_light.copy()
        pose[:3, 3] = position
        return self._posed(pose)

    def carried(self, matrix: F64) -> Self:
        """Carried through a matrix (4, 4); its size stays."""
        return self._posed(conventions.rigid_part(matrix @ self.world_from_light))

    def _posed(self, pose: F64) -> Self:
        return cast(Self, replace(cast(Any, self), world_from_light=pose))
