"""The engine's lighting texture as a lighting buffer: its light laws and culling, with shadows traced exactly.

One point a pixel, at its centre; no indirect light. So a difference from a frame of the engine is that frame's own
error: the resolution, bias and blur of its shadow maps, and the bits of its targets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.base.progress import CountProgress
from mirelight.lighting.develop import refuse_if_too_large
from mirelight.lighting.engine.raster import Rasterised, rasterise
from mirelight.lighting.engine.shading import ambient, received
from mirelight.lighting.layers import Layers
from mirelight.lighting.sunsky import plain
from mirelight.lighting.visibility import ShadowRays
from mirelight.model import (
    F32,
    F64,
    I32,
    Camera,
    Lighting,
    LightingBuffer,
    LightLayer,
    ProxyMesh,
    RenderSettings,
)
from mirelight.model.playcanvas_lights import EngineLight, to_engine


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """The pixels of a camera that see the proxy, N of them, and their points."""

    camera: Camera
    surface: Rasterised
    face: NDArray[np.int32]  # (N,) triangle of each
    position: F64  # (N, 3) world space
    normal: F64  # (N, 3) unit
    albedo: F64  # (N, 3) linear

    @property
    def pixels(self) -> NDArray[np.bool_]:
        """(H, W) True at those pixels."""
        return self.surface.coverage


class EngineTracer:
    """A proxy made ready for the engine's light; called as :class:`mirelight.lighting.Tracer` is.

    Of the settings only the variant and the threads count: there is nothing to sample.

    Args:
        proxy: world space.
        settings: of the job.
        layers: False: one layer, "beauty".

    Raises:
        BackendError: the variant cannot be used on this machine.
    """

    def __init__(self, proxy: ProxyMesh, settings: RenderSettings, *, layers: bool = True) -> None:
        self._proxy = proxy
        self._layers = layers
        self._variant = settings.variant
        self._threads, self._most = settings.threads, settings.max_memory
        self._rays: ShadowRays | None = None
        self._seen: _Seen | None = None  # the last camera's, as many lightings share it

    def trace(
        self,
        lighting: Lighting,
        camera: Camera,
        *,
        emission: bool = True,
        progress: CountProgress | None = None,
    ) -> LightingBuffer:
        """The lighting texture that the engine would make.

        Args:
            lighting: physical units; `mirelight.model.playcanvas_lights` says what the engine makes of them.
            camera: the splat camera; pixels coincide with its own.
            emission: changes nothing, as glowing surfaces light nothing in the engine.
            progress: called once, when all is done.

        Returns:
            A layer for each light or group and the environment, all of it direct; coverage 0 or 1; variance 0.

        Raises:
            RenderError: the frame does not fit in memory.
        """
        lighting = plain(lighting)
        layers = Layers.of(lighting, emissive=False, separate=self._layers)
        refuse_if_too_large(camera, layers, most=self._most)
        engine, _ = to_engine(lighting, self._proxy)
        seen = self._look(camera)
        light = np.zeros((len(layers.names), len(seen.albedo), 3))
        for lamp, layer in zip(engine.lights, layers.of_light, strict=False):
            eye = seen.camera.position
            light[layer] += self._lit(lamp, seen.face, seen.position, seen.normal, eye)
        if lighting.environment is not None:
            light[layers.environment] += ambient(engine, seen.normal)
        if progress is not None:
            progress(camera.width * camera.height, camera.width * camera.height)
        return _buffer(seen, layers.names, light)

    def irradiance(self, lighting: Lighting, face: I32, points: F64, normals: F64) -> F64:
        """What the engine's light model lets fall on points of the proxy, in the units of its frames times pi.

        Args:
            lighting: physical units.
            face: (N,) triangle of each point.
            points: (N, 3) on them, world space.
            normals: (N, 3) unit, towards the side that is asked for.

        Returns:
            (N, 3) linear.
        """
        lighting = plain(lighting)
        engine, _ = to_engine(lighting, self._proxy)
        light = np.zeros(points.shape)
        for lamp in engine.lights:
            light += self._lit(lamp, face, points, normals, points + normals)
        if lighting.environment is not None:
            light += ambient(engine, normals)
        return np.asarray(np.pi * light)

    def _look(self, camera: Camera) -> _Seen:
        """What the engine's rasteriser sees; kept for the next lighting of the same camera."""
        if self._seen is None or self._seen.camera is not camera:
            surface = rasterise(self._proxy, camera, variant=self._variant, threads=self._threads)
            hit = surface.coverage
            face, position = surface.face[hit], surface.position[hit].astype(np.float64)
            normal = surface.normal[hit].astype(np.float64)
            self._seen = _Seen(camera, surface, face, position, normal, self._albedo(face, position))
        return self._seen

    def _albedo(self, face: NDArray[np.int32], position: F64) -> F64:
        if self._proxy.albedo is not None:
            return np.broadcast_to(self._proxy.albedo, position.shape)
        return self._ray_caster().albedo(face, position)

    def _lit(self, lamp: EngineLight, face: I32, points: F64, normals: F64, eye: F64) -> F64:
        """(N, 3) one lamp's light on points that are seen from `eye`, (3,) or one for each."""
        light = received(lamp, points, normals)
        lit = light.any(axis=1)
        if lamp.cast_shadows and lit.any():
            way = np.append(-lamp.direction, 0) if lamp.kind == "directional" else np.append(lamp.position, 1)
            eyes = np.broadcast_to(eye, points.shape)[lit]
            visible = self._ray_caster().visible(face[lit], points[lit], eyes, way)
            light[lit] *= visible[:, None]
        return light

    def _ray_caster(self) -> ShadowRays:
        if self._rays is None:
            self._rays = ShadowRays(self._proxy, self._variant, self._threads)
        return self._rays


def _buffer(seen: _Seen, names: tuple[str, ...], light: F64) -> LightingBuffer:
    """The light (K, N, 3) of K layers as pictures."""
    surface, pixels = seen.surface, seen.pixels

    def picture(values: F64) -> F32:
        out = np.zeros((*pixels.shape, 3), dtype=np.float32)
        out[pixels] = values
        return out

    dark = np.zeros((*pixels.shape, 3), dtype=np.float32)
    return LightingBuffer(
        camera=seen.camera,
        coverage=pixels.astype(np.float32),
        layers=tuple(
            LightLayer(name=name, direct=picture(seen.albedo * own), indirect=dark, variance=dark)
            for name, own in zip(names, light, strict=True)
        ),
        depth=surface.depth,
        position=surface.position,
        normal=surface.normal,
        geometric_normal=surface.geometric_normal,
        albedo=picture(seen.albedo),
        variance=dark,
        spp=1,
    )
