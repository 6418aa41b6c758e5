"""The real engine on the same scene: PlayCanvas' own GsplatRelighting script, run in headless Chromium.

``engine`` fetches the engine; ``bundle`` writes a page that runs it; ``browser`` runs that page and reads its buffers;
``predict`` makes the same frame without the engine. Its light model is `mirelight.lighting.engine`, the table of its
units `mirelight.model.playcanvas_lights`.
"""

from __future__ import annotations

from mirelight.apps.realtime.browser import EngineFrames, load_frames, render
from mirelight.apps.realtime.bundle import Exported, export
from mirelight.apps.realtime.predict import blended, engine_frame

__all__ = ["EngineFrames", "Exported", "blended", "engine_frame", "export", "load_frames", "render"]
