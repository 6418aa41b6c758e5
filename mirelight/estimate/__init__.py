"""The light that splats were captured under, from the splats and a proxy. See docs/guides/captured-light.md."""

from __future__ import annotations

from mirelight.estimate.solve import estimate
from mirelight.estimate.types import Confidence, Estimate, lighting_of

__all__ = ["Confidence", "Estimate", "estimate", "lighting_of"]
