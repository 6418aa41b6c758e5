"""What a shipped scene is made from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mirelight.model import Camera, Lighting
from scenegen.truth import Looks


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """A scene before it is made. All light is scaled so that exposure 0 shows it and nothing captured clips."""

    name: str
    title: str
    looks: Callable[[], Looks]
    captured: Lighting
    lightings: tuple[Lighting, ...]  # new ones
    cameras: tuple[Camera, ...]  # shipped with the scene
    orbit: tuple[Camera, ...]  # from where the capture is made: what they see becomes splats
    pixels_per_splat: float  # wanted distance of neighbouring splats in the nearest of the orbit's pictures
    spacing: tuple[float, float]  # metres, limits of that distance
    proxy_faces: int  # triangles kept in the proxy
    proxy_error: float  # metres, by how much its vertices are off
    spp: int = 64  # of the job's lighting pass
