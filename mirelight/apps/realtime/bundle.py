"""A job as a folder that runs the engine: a static page, PlayCanvas, and the scene in the engine's terms."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mirelight.apps.realtime import captures, engine, pages
from mirelight.base.colour import ENGINE_GAMMA
from mirelight.base.errors import InputError
from mirelight.io.atomic import write_file
from mirelight.io.gltf.write import write_glb
from mirelight.io.hdr import write_hdr
from mirelight.lighting.engine.raster import culling_warnings
from mirelight.lighting.objects import inserted
from mirelight.model import (
    PROFILES,
    Camera,
    CompositorSettings,
    EngineSettings,
    Job,
    Lighting,
    ProxyMesh,
    SplatCloud,
    ToneCurve,
    rules_of,
    triangles,
)
from mirelight.model.playcanvas_lights import (
    NORMAL_OFFSET_BIAS,
    EngineLight,
    EngineLighting,
    camera_warnings,
    engine_diffuse,
    engine_rotation,
    to_engine,
)
from mirelight.pipeline.artefact_cache import NullCache
from mirelight.pipeline.scene import Scene

PAGE = ("index.html", "live.mjs", "scene.mjs", "sides.mjs")  # what a person opens
_TONE_CURVES: dict[ToneCurve, str] = {"none": "none", "aces": "aces", "neutral": "neutral", "agx": "none"}
_FAR_FACTOR = 4.0  # far plane, in distances from the eye to the scene's far end
_SHADOW_PIXELS, _SHADOW_BIAS = 2048, 0.1
_HEAVY = 300_000_000  # bytes of splats and proxy, from which a page is long in coming
_NO_PROXY = ProxyMesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))


@dataclass(frozen=True, slots=True, kw_only=True)
class Exported:
    """What was written, and a line for everything in the job that the engine cannot follow."""

    folder: Path
    description: Mapping[str, Any]  # scene.json
    warnings: tuple[str, ...]


def export(
    job: Job,
    camera: Camera,
    lighting: Lighting,
    directory: str | Path,
    *,
    shadows: bool = True,
    like: Path | None = None,
) -> Exported:
    """Write a page that shows the job's scene live in PlayCanvas, as its own GsplatRelighting relights it.

    The folder can be served by any static server, ``python3 -m http.server`` for one, and adapted by hand.

    Args:
        job: scene and settings; of the cameras and lightings only the two that follow are used.
        camera: perspective.
        lighting: physical units.
        directory: made where it is missing; files of earlier exports are replaced.
        shadows: whether the lights cast shadow maps.
        like: the folder of another export of the same job; engine, splats and proxy are hard links to its files where
            the disk can, so that they take room and time once.

    Raises:
        InputError: the scene has nothing to show, or the camera is orthographic.
        BackendError: the engine is not installed and cannot be fetched.
        OutputError: the folder cannot be written.
    """
    folder = Path(directory)
    scene = _Shown.of(job)
    if scene.splats is None and scene.proxy is None:
        raise InputError(job.source, "neither splats nor a proxy", "the engine has nothing to show")
    if camera.projection != "perspective":
        raise InputError(
            job.source,
            f"camera {camera.name} is orthographic",
            "the engine's relighting follows perspective cameras only",
        )
    objects = job.objects_of(lighting, camera)
    lighting = Scene(job, NullCache()).resolved(lighting)  # unchecked: the engine shows what no frame is rendered of
    clustered = job.engine.clustered
    proxy = scene.proxy or _NO_PROXY
    engine_lighting, light_warnings = to_engine(lighting, proxy, shadows=shadows, clustered=clustered)
    behind = () if scene.proxy is None else culling_warnings(scene.proxy, [camera], job.render.variant)
    views = (f"camera {x}" for x in camera_warnings(camera))
    warnings = (*views, *_settings_warnings(job), *(f"proxy: {x}" for x in behind), *light_warnings)
    description = _describe(job, camera, engine_lighting)
    engine.copy_page(folder, "realtime", PAGE, None if like is None else like / "engine")
    if scene.splats is not None:
        description["splat"] = captures.write(job, folder, lambda target, name: engine.linked(like, name, target))
    if scene.proxy is not None and not engine.linked(like, "proxy.glb", folder):
        write_glb(folder / "proxy.glb", _with_normals(scene.proxy))
    if objects and scene.proxy is not None:
        write_glb(folder / "objects.glb", _with_normals(inserted(objects, scene.proxy).alone))
        description["objects"] = {"file": "objects.glb"}
    if engine_lighting.environment is not None:
        write_hdr(folder / "environment.hdr", engine_lighting.environment.pixels)
    write_file(folder / "scene.json", json.dumps(description, indent=1) + "\n")
    pages.write(folder)
    return Exported(folder=folder, description=description, warnings=(*warnings, *_heavy(folder)))


def _heavy(folder: Path) -> list[str]:
    """What a page loads, where that is much."""
    each = {x.name: x.stat().st_size for x in sorted(folder.iterdir()) if x.suffix in (".ply", ".sog", ".webp", ".glb")}
    total = sum(each.values())
    if total < _HEAVY:
        return []
    parts = ", ".join(f"{name} {size / 1e6:,.0f}" for name, size in each.items())
    return [
        f"the page loads {total / 1e6:,.0f} MB ({parts}): splats as .sog take a tenth of a .ply, and "
        "`mirelight proxy CAPTURE --triangles 200000` makes a proxy that takes less"
    ]


def _with_normals(proxy: ProxyMesh) -> ProxyMesh:
    """A mesh that is flat, or flat where its normals are 0, with its faces apart and their normals written: the engine
    would smooth over shared corners."""
    if (proxy.normals is not None and proxy.normals.any(axis=1).all()) or not len(proxy.faces):
        return proxy
    corners = proxy.vertices[proxy.faces]  # (F, 3, 3)
    across = triangles.crossed(corners)
    normals = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-30)
    apart = proxy.faces.ravel()
    flat = np.repeat(normals, 3, axis=0).astype(np.float32)
    given = flat * 0 if proxy.normals is None else proxy.normals[apart]
    return replace(
        proxy,
        vertices=corners.reshape(-1, 3),
        faces=np.arange(len(apart), dtype=np.int32).reshape(-1, 3),
        normals=np.where(given.any(axis=1, keepdims=True), given, flat),
        uvs=None if proxy.uvs is None else proxy.uvs[apart],
        vertex_colors=None if proxy.vertex_colors is None else proxy.vertex_colors[apart],
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Shown:
    """What the engine is handed: the files' content, the proxy in its own albedo."""

    splats: SplatCloud | None
    proxy: ProxyMesh | None

    @staticmethod
    def of(job: Job) -> _Shown:
        return _Shown(job.splats.value if job.splats else None, Scene(job, NullCache()).mesh)


# --- scene.json ------------------------------------------------------------------------------------------------------


def _describe(job: Job, camera: Camera, lighting: EngineLighting) -> dict[str, Any]:
    scene, relight = _Shown.of(job), job.relight
    playcanvas = rules_of(job.compositor.profile).splats.pipelines
    tone = job.compositor.tone if playcanvas else job.display.tone
    exposure = job.compositor.exposure if playcanvas else 2.0**job.display.exposure
    if tone == "none" and exposure != 1:
        curve = "linear"  # the engine exposes within its tone curves only
    else:
        curve = _TONE_CURVES[tone]
    linear = job.compositor.blends_linear
    behind = np.asarray(job.display.background)
    background = (behind**ENGINE_GAMMA if linear else behind).tolist()  # the linear pipeline clears in linear light
    out: dict[str, Any] = {
        "width": camera.width,
        "height": camera.height,
        "camera": _camera(camera, scene),
        "clearColor": [*background, 1.0 if any(background) else 0.0],
        "pipeline": "linear" if linear else "gamma",
        "toneMapping": curve,
        "exposure": exposure,
        "relighting": {
            "blend": relight.blend,
            "brightness": relight.brightness,
            "background": relight.far_number,
            "textureScale": relight.texture_scale,
        },
        "gsplat": _gsplat(job.compositor),
        "lights": [_light(light, _furthest(camera, scene), job.engine) for light in lighting.lights],
        "clusteredLighting": job.engine.clustered,
        "physicalUnits": job.engine.physical_units,
        "ambient": lighting.ambient.tolist(),
    }
    if scene.proxy is not None:
        albedo = scene.proxy.albedo
        surface = {"ownColors": True} if albedo is None else {"diffuse": engine_diffuse(albedo).tolist()}
        out["proxy"] = {"file": "proxy.glb", "twoSidedShadows": True, **surface}
    if job.engine.hdr_format is not None:
        out["hdrFormat"] = job.engine.hdr_format
    if lighting.environment is not None:
        out["env"] = {
            "equirect": "environment.hdr",
            "intensity": lighting.environment.intensity,
            "rotation": engine_rotation(lighting.environment.rotation),
        }
    return out


def _camera(camera: Camera, scene: _Shown) -> dict[str, Any]:
    low, high = _bounds(scene)
    forward = -camera.world_from_camera[:3, 2]
    ahead = float((0.5 * (low + high) - camera.position) @ forward)
    return {
        "position": camera.position.tolist(),
        "target": (camera.position + max(ahead, camera.near) * forward).tolist(),
        "up": camera.world_from_camera[:3, 1].tolist(),
        "fov": math.degrees(2 * math.atan(camera.height / (2 * camera.fy))),
        "near": camera.near,
        "far": min(camera.far, max(_FAR_FACTOR * _furthest(camera, scene), 2 * camera.near)),
    }


def _furthest(camera: Camera, scene: _Shown) -> float:
    """Distance from the eye to the furthest corner of the scene's bounds."""
    corners = np.array(np.meshgrid(*zip(*_bounds(scene), strict=True))).reshape(3, -1).T
    return float(np.linalg.norm(corners - camera.position, axis=1).max())


def _gsplat(settings: CompositorSettings) -> dict[str, Any]:
    if not rules_of(settings.profile).splats.packed:
        return {}  # the engine's defaults
    return {
        "dataFormat": "GSPLATDATA_COMPACT" if settings.work_buffer == "compact" else "GSPLATDATA_LARGE",
        "radialSorting": settings.sort == "radial",
        "minPixelSize": settings.min_pixel_size,
        "alphaClipForward": settings.alpha_clip,
    }


def _light(light: EngineLight, shadow_distance: float, settings: EngineSettings) -> dict[str, Any]:
    strength = {"luminance": light.luminance} if settings.physical_units else {"intensity": light.intensity}
    out: dict[str, Any] = {
        "name": light.name,
        "type": light.kind,
        "color": light.color.tolist(),
        **strength,
        "castShadows": light.cast_shadows,
    }
    if light.cast_shadows:
        out |= {
            "shadowType": "SHADOW_PCSS_32F" if light.penumbra > 0 else "SHADOW_PCF3_32F",
            "shadowResolution": _SHADOW_PIXELS,
            "shadowDistance": shadow_distance,
            "shadowBias": _SHADOW_BIAS,
            "normalOffsetBias": NORMAL_OFFSET_BIAS,
        }
    if light.penumbra > 0:
        out |= {"penumbraSize": light.penumbra, "penumbraFalloff": light.penumbra_falloff}
    if light.kind != "omni":
        out["direction"] = light.direction.tolist()
    if light.kind != "directional":
        falloff = "LINEAR" if light.falloff == "linear" else "INVERSESQUARED"
        out |= {
            "position": light.position.tolist(),
            "range": light.range,
            "falloffMode": f"LIGHTFALLOFF_{falloff}",
        }
    if light.kind == "spot":
        out |= {"innerConeAngle": light.inner_cone_angle, "outerConeAngle": light.outer_cone_angle}
    return out


# --- what the engine cannot follow -----------------------------------------------------------------------------------


def _settings_warnings(job: Job) -> list[str]:
    out = []
    if job.relight.mode not in PROFILES["playcanvas"].modes:
        out.append(f"relight.mode {job.relight.mode}: the engine knows the tint only")
    if not rules_of(job.relight.profile).blending_space and job.splats is not None:
        out.append("profile physical: the engine tints in display space; the profile playcanvas does the same here")
    if job.compositor.holds_light and not job.compositor.blends_linear:
        out.append("splats that hold linear light: the engine takes their colours as display values")
    if job.objects:
        out.append("inserted objects: the engine's cast shadows, and neither mirror the capture nor light it")
    tone = job.compositor.tone if rules_of(job.compositor.profile).splats.pipelines else job.display.tone
    if tone == "agx":
        out.append("tone agx: the engine has no such curve; none is used")
    return out


def _bounds(scene: _Shown) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    points = [
        x
        for x in (scene.proxy.vertices if scene.proxy else None, scene.splats.means if scene.splats else None)
        if x is not None and len(x)
    ]
    if not points:
        return np.zeros(3), np.zeros(3)
    low = np.min([p.min(axis=0) for p in points], axis=0).astype(np.float64)
    return low, np.max([p.max(axis=0) for p in points], axis=0).astype(np.float64)
