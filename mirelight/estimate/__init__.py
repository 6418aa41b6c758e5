"""The light that splats were captured under, from the splats and a proxy. docs/captured-light.md has the method."""

from __future__ import annotations

from mirelight.estimate.solve import estimate
from mirelight.estimate.types import Confidence, Estimate, lighting_of

__all__ = ["Confidence", "Estimate", "estimate", "lighting_of"]
