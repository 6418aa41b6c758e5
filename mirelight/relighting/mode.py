"""What a relight mode is: one object that says what it needs and how light becomes a factor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, Camera, LightingBuffer, RelightMode, RelightSettings, Space


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lit:
    """The lit proxy as a factor is made of it, h x w pixels."""

    beauty: F32  # (h, w, 3) linear radiance of all lights, premultiplied by coverage
    coverage: F32  # (h, w) 0 to 1
    albedo: F32  # (h, w, 3) of the covered part
    depth: F32 | None = None  # (h, w) view depth of the covered part; None: not told
    far: F32 | None = None  # what the light has far away, a map of `mirelight.relighting.far`; None: not told

    @staticmethod
    def of(lighting: LightingBuffer, far: F32 | None = None) -> Lit:
        """That of a whole buffer, with a far map (128, 256, 3) beside it."""
        return Lit(
            beauty=lighting.beauty,
            coverage=lighting.coverage,
            albedo=lighting.albedo,
            depth=lighting.depth,
            far=far,
        )

    def moved(self, by: F32) -> Lit:
        """With that much more light (h, w, 3), not below zero."""
        return replace(self, beauty=np.maximum(self.beauty + by, np.float32(0)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Task:
    """What a mode makes a factor from: splats, light and settings of one view."""

    size: tuple[int, int]  # rows and columns of the frame; those of the light may be fewer
    unlit: F32  # (H, W, 4) the splats as captured: linear, premultiplied
    new: Lit
    captured: Lit | None  # the light that the capture was made under; there where the mode needs it
    captured_level: float | None  # its mean luminance over the scene's surface (radiance over albedo); None: unknown
    settings: RelightSettings
    camera: Camera | None = None  # of the frame, where what is far away is looked at
    beyond: F32 | None = None  # (H, W, 2) share of the splats that lie off the proxy, their view depth; None: not told


Factor: TypeAlias = Callable[[F32, F32 | None], F32]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mode:
    """How light becomes a factor."""

    name: RelightMode
    needs_captured: bool  # the light that the capture was made under must be known
    uses_proxy_colours: bool  # light may be traced on a proxy with the splats' colours: its own albedo is divided out
    leaves_floor: bool  # where no light falls a little of the captured colour stays; else the factor is linear in light
    reads: frozenset[str]  # settings that decide the factor, fields of RelightSettings beside mode, profile and blend
    space: Space | None  # in which the factor multiplies; None: as the settings or the profile say
    # All but the light made ready once; then, for the new light's beauty (h, w, 3) and far map (or None), the factor
    # (H, W, 3) at full strength: `blend` is not its business. `new.beauty` and `new.far` of the task are not read.
    prepared: Callable[[Task], Factor]

    def factor(self, task: Task) -> F32:
        """(H, W, 3) the factor of a task at full strength."""
        return self.prepared(task)(task.new.beauty, task.new.far)


Seen = NDArray[np.bool_]  # (H, W) where the proxy covers anything
