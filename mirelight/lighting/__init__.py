"""The lighting pass: a proxy mesh under lights, as a screen-aligned buffer of layers.

Path-traced in the profile `physical`, by the real-time engine's own light model in the profile `playcanvas`.
"""

from __future__ import annotations

from mirelight.lighting.albedo import colored_by
from mirelight.lighting.engine import EngineTracer
from mirelight.lighting.level import captured_level
from mirelight.lighting.profiles import finished, trace, tracer
from mirelight.lighting.trace import Interrupted, Tracer

__all__ = [
    "EngineTracer",
    "Interrupted",
    "Tracer",
    "captured_level",
    "colored_by",
    "finished",
    "trace",
    "tracer",
]
