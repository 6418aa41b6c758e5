"""The lighting pass: a proxy mesh under lights, path-traced into a screen-aligned buffer of layers."""

from __future__ import annotations

from mirelight.lighting.trace import Interrupted, Progress, Tracer, trace

__all__ = ["Interrupted", "Progress", "Tracer", "trace"]
