"""The real engine on the same scene: PlayCanvas' own GsplatRelighting script, run in headless Chromium.

``mapping`` turns physical lights into the engine's and back; ``raster`` and ``shading`` evaluate the engine's light
model in NumPy; ``export`` writes a page that runs the engine; ``engine`` fetches the engine; ``browser`` runs the page
and reads its buffers.
"""

from __future__ import annotations
