"""Which light goes to which layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import Lighting

MAX_LAYERS = 64  # above this many lights they share one layer: a layer's film takes 24 bytes a pixel


@dataclass(frozen=True, slots=True, eq=False)
class Layers:
    """Names in the film's order, and where each source of light goes."""

    names: tuple[str, ...]
    of_light: NDArray[np.uint32]  # (max(n, 2),) layer of each light
    environment: int  # its layer; 0 where there is none
    emission: int  # its layer; 0 where there is none
    separate: bool = True  # False: nobody asks for layers, so lights may be sampled for the sum alone

    @staticmethod
    def of(lighting: Lighting, *, emissive: bool, separate: bool = True) -> Layers:
        """A layer per light, then the environment, then emission; or one named "beauty" that holds everything."""
        if not separate:
            everything = np.zeros(max(len(lighting.lights), 2), np.uint32)
            return Layers(("beauty",), everything, environment=0, emission=0, separate=False)
        lights = tuple(x.name for x in lighting.lights)
        of_light = np.arange(max(len(lights), 2), dtype=np.uint32)
        if len(lights) > MAX_LAYERS:
            lights, of_light = ("lights",), np.zeros_like(of_light)
        environment = (lighting.environment.name,) if lighting.environment else ()
        names = lights + environment + (("emission",) if emissive else ())
        return Layers(
            names,
            of_light,
            environment=len(lights) if environment else 0,
            emission=len(names) - 1 if emissive else 0,
        )

    @staticmethod
    def single(lighting: Lighting) -> Layers:
        """One layer for everything."""
        return Layers(("all",), np.zeros(max(len(lighting.lights), 2), np.uint32), environment=0, emission=0)
