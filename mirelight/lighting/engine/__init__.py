"""The real-time engine's light model, evaluated at the pixels of a lighting camera: no samples, no noise."""

from __future__ import annotations

from mirelight.lighting.engine.tracer import EngineTracer

__all__ = ["EngineTracer"]
