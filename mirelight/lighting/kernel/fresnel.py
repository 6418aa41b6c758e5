"""Schlick's approximation of how much a surface reflects by the angle that it is seen from."""

from __future__ import annotations

import drjit as dr

from mirelight.lighting.kernel.types import Float, Vector3f

COAT = 0.04  # reflectance at normal incidence of lacquer (an index of refraction of 1.5)


def fresnel(f0: Vector3f, f90: Float, cosine: Float) -> Vector3f:
    """From reflectances at normal and at grazing incidence; nothing where `f0` is 0."""
    return dr.select(dr.max(f0) > 0, f0 + (f90 - f0) * grazing(cosine), 0)


def of_coat(strength: Float, cosine: Float) -> Float:
    """What lacquer takes of the light below it."""
    return strength * (COAT + (1 - COAT) * grazing(cosine))


def grazing(cosine: Float) -> Float:
    """(1 - cos)⁵."""
    away = 1 - cosine
    return dr.square(dr.square(away)) * away
