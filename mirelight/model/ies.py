"""A luminaire's measured light: how strong it is in every direction (IES LM-63, Type C). NumPy only."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base import conventions
from mirelight.model.arrays import F32, F64, ArrayHolder, freeze

AROUND, DOWN = 144, 361  # directions: every 2.5 degrees around the axis, every half degree from nadir to zenith


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IesProfile(ArrayHolder):
    """Light by direction, bilinear between the table's angles, as a share of its brightest. In Type C, vertical angles
    count from the nadir and horizontal ones counter-clockwise seen from above."""

    share: F32  # (AROUND, DOWN) 0..1; rows: 0, 2.5, … 357.5 degrees around; columns: 0 (nadir) to 180
    nadir: F64 = field(default_factory=lambda: np.array([0.0, -1.0, 0.0]))  # (3,) unit, the way of vertical angle 0
    zero: F64 = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))  # (3,) unit, across it: horizontal angle 0

    def __post_init__(self) -> None:
        freeze(self, "share", (AROUND, DOWN))
        for name in ("nadir", "zero"):
            object.__setattr__(self, name, conventions.unit(getattr(self, name)))
            freeze(self, name, (3,), np.float64)

    @property
    def quarter(self) -> F64:
        """(3,) the way of horizontal angle 90."""
        return np.asarray(np.cross(-self.nadir, self.zero))

    @property
    def solid_angle(self) -> float:
        """The share summed over all directions, in sr: lumens for each candela of the brightest."""
        theta = np.linspace(0, math.pi, DOWN)
        mean = self.share.mean(axis=0, dtype=np.float64)
        return float(2 * math.pi * np.trapezoid(mean * np.sin(theta), theta))

    def solid_angle_in(self, cone: Callable[[F64], F64]) -> float:
        """The same of what a cone about the nadir leaves; `cone`: its share (N,) by cosines (N,) of the angle to
        that."""
        theta = np.linspace(0, math.pi, DOWN)
        finer = np.linspace(0, math.pi, 16 * (DOWN - 1) + 1)
        mean = np.interp(finer, theta, self.share.mean(axis=0, dtype=np.float64)) * cone(np.cos(finer))
        return float(2 * math.pi * np.trapezoid(mean * np.sin(finer), finer))

    def toward(self, way: ArrayLike) -> F64:
        """The share in unit directions (..., 3) away from the lamp."""
        d = np.asarray(way, dtype=np.float64)
        x = np.arctan2(d @ self.quarter, d @ self.zero) % (2 * math.pi) * (AROUND / (2 * math.pi))
        y = np.arccos(np.clip(d @ self.nadir, -1, 1)) * ((DOWN - 1) / math.pi)
        i, j = x.astype(int) % AROUND, np.minimum(y.astype(int), DOWN - 2)
        fx, fy = x - np.floor(x), y - j
        near = self.share[i, j] * (1 - fy) + self.share[i, j + 1] * fy
        far = self.share[(i + 1) % AROUND, j] * (1 - fy) + self.share[(i + 1) % AROUND, j + 1] * fy
        return np.asarray(near * (1 - fx) + far * fx)
