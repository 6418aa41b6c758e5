"""The pictures by which a person judges an estimate: captured | irradiance | captured / irradiance; materials."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base.colour import REC709_LUMINANCE, srgb_encode
from mirelight.lighting import Tracer
from mirelight.model import F32, Camera, Lighting, LightingBuffer, ProxyMesh, RenderSettings

_FLOOR = 0.02  # of the mean light: what is darker is shown as nothing is known
_MATT, _COAT, _METAL = 0.03, np.array([0.25, 0.6, 1.0]), np.array([1.0, 0.75, 0.2])  # linear, of finishes
WHITE = 0.9  # display value of the lights' brightest 5 %


def sheet(splats: F32, lit: LightingBuffer) -> NDArray[np.uint8]:
    """Three pictures side by side, (H, 3 W, 3) uint8, display-encoded.

    Irradiance / pi is scaled so that its brightest 5 % are nearly white; the quotient is what remains of the splats
    without that light, the albedo: left-over shadows in it mean a wrong sun or a proxy that misfits.

    Args:
        splats: (H, W, 4) the splats as captured, linear, premultiplied.
        lit: the proxy of the same view under the estimated light.
    """
    covered = lit.coverage[..., None]
    albedo = np.maximum(lit.albedo * covered, np.float32(1e-4))
    light = np.where(covered > 0, lit.beauty[..., :3] / albedo, np.float32(0))
    captured = splats[..., :3]
    seen = covered[..., 0] > 0.5
    brightness = light @ REC709_LUMINANCE
    top = float(np.quantile(brightness[seen], 0.95)) if seen.any() else 1.0
    mean = float(brightness[seen].mean()) if seen.any() else 1.0
    quotient = np.where(covered > 0, captured / (light + _FLOOR * mean), 0)
    parts: list[F32] = [captured, light * np.float32(WHITE / max(top, 1e-9)), quotient]
    return np.concatenate([_shown(part) for part in parts], axis=1)


def finish_sheet(mesh: ProxyMesh, light: Lighting, camera: Camera, settings: RenderSettings) -> NDArray[np.uint8]:
    """Three pictures side by side, (H, 3 W, 3) uint8: the surface's colours | gloss | what it mirrors of the light.

    Of gloss, matt parts are dark; the smoother one is, the brighter, metals yellow, all else blue.

    Args:
        mesh: with materials and vertex colours.
        light: that it was captured under.
        camera: of the picture.
        settings: of the tracing.
    """
    tracer = Tracer(mesh, settings, layers=False, aovs=False, lobes=True)
    mirrored = tracer.trace(light, camera)
    matt = Tracer(mesh, replace(settings, spp=4, max_depth=1), layers=False, aovs=False).trace(light, camera)
    origins, ways = camera.rays()
    ways = np.ascontiguousarray(ways.reshape(-1, 3))
    starts = np.ascontiguousarray(np.broadcast_to(origins.reshape(-1, 3), ways.shape))
    face, _ = tracer.sight().first_hits(starts, ways)
    colors = np.array([(1 - x.roughness) * (_METAL if x.metallic else _COAT) for x in mesh.materials])
    gloss = np.where((face >= 0)[:, None], _MATT + colors[mesh.owners[face]], 0.0).reshape(
        camera.height, camera.width, 3
    )
    parts = (matt.albedo, gloss.astype(np.float32), mirrored.beauty)
    return np.concatenate([_shown(x) for x in parts], axis=1)


def _shown(linear: F32) -> NDArray[np.uint8]:
    return np.asarray(np.round(srgb_encode(np.clip(linear, 0, 1)) * 255), dtype=np.uint8)
