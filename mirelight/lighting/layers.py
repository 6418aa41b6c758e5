"""Which light goes to which layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.base.names import FreeNames
from mirelight.model import F32, Lighting, ParallelLight
from mirelight.model.results import EMISSION

MAX_LAYERS = 64  # above this many they become one: a layer's film takes 36 bytes a pixel


@dataclass(frozen=True, slots=True, eq=False)
class Layers:
    """Names in the film's order, and where each source of light goes."""

    names: tuple[str, ...]
    of_light: NDArray[np.uint32]  # (max(n, 2),) layer of each light
    environment: int  # its layer; 0 where there is none
    emission: int  # its layer; 0 where there is none
    first_bounce: tuple[int, int] | None = (
        None  # layers of the environment and of emission where a reflected ray meets them
    )
    separate: bool = True  # False: nobody asks for layers, so lights may be sampled for the sum alone

    @staticmethod
    def of(lighting: Lighting, *, emissive: bool, separate: bool = True) -> Layers:
        """A layer per group of lights or light without one, then the environment, then emission.

        Where they are not wanted separate there is one, "beauty", that holds everything. Names are unique: lights keep
        theirs, and an environment or glowing surfaces whose name one of them has get a number, "emission-2".
        """
        count = max(len(lighting.lights), 2)
        if not separate:
            return Layers(("beauty",), np.zeros(count, np.uint32), environment=0, emission=0, separate=False)
        names = tuple(dict.fromkeys(x.group or x.name for x in lighting.lights))
        of_light = np.zeros(count, np.uint32)
        if len(names) > MAX_LAYERS:
            names = ("lights",)
        else:
            of_light[: len(lighting.lights)] = [names.index(x.group or x.name) for x in lighting.lights]
        environment = emission = 0
        if lighting.environment:
            environment, names = len(names), (*names, FreeNames(names).take(lighting.environment.name))
        if emissive:
            emission, names = len(names), (*names, FreeNames(names).take(EMISSION))
        return Layers(names, of_light, environment=environment, emission=emission)


def sun_shares(lighting: Lighting) -> F32:
    """(max(n, 2),) each light's share of the illuminance of all directional lights and suns; other lights have none."""
    shares = np.zeros(max(len(lighting.lights), 2))
    for index, light in enumerate(lighting.lights):
        if isinstance(light, ParallelLight):
            shares[index] = light.intensity * light.color.mean()
    total = shares.sum()
    return np.asarray(shares / total if total > 0 else shares, np.float32)
