"""The mixer as a folder: a static page, PlayCanvas, the splats, and their layers of light."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.apps.mixer import behind, rgb9e5
from mirelight.apps.mixer.layers import Mixed, MixLayers, make
from mirelight.apps.realtime import engine
from mirelight.base.errors import InputError
from mirelight.base.progress import ShareProgress
from mirelight.io.atomic import atomic_path
from mirelight.io.job.hashing import file_digest
from mirelight.io.splats import compressed_ply, ply
from mirelight.model import F64, Camera, Job, SplatCloud
from mirelight.pipeline import requirements
from mirelight.pipeline.scene import Scene
from mirelight.relighting.modes import mode_of

_MODULES = ("mixer", "view", "behind", "panel", "files", "colors", "handles", "live", "served")
PAGE = ("index.html", "style.css", *(f"{name}.mjs" for name in _MODULES))
SPLATS = ("splats.ply", "splats.compressed.ply")  # without and with colours that change with the view
LAYERS, DESCRIPTION = "layers.bin", "layers.json"
_MOST_CAMERAS = 500  # bookmarks


@dataclass(frozen=True, slots=True, eq=False)
class Exported:
    """What was written, and a line for everything that the page shows otherwise than the offline frame."""

    folder: Path
    layers: MixLayers
    order: NDArray[np.intp]  # (N,) which of the capture's splats the page's files have, one after another
    warnings: tuple[str, ...]


def export(
    scene: Scene,
    directory: str | Path,
    *,
    spp: int,
    lightings: tuple[str, ...] | None = None,
    progress: ShareProgress | None = None,
) -> Exported:
    """Write the mixer's page of a job. Any static server can serve the folder.

    Args:
        scene: a prepared job; its store keeps the traced layers.
        directory: made where it is missing; files of earlier exports are replaced, the description last.
        spp: samples a splat.
        lightings: names of those to mix; None: all.
        progress: hears what is traced.

    Raises:
        InputError: the job has no splats, no proxy or no light, too many layers, or another profile than `physical`.
        BackendError: the engine is not installed and cannot be fetched.
        RenderError: no splat lies on the proxy.
        OutputError: the folder cannot be written.
    """
    job = scene.job
    requirements.check_lit_splats(job)
    folder = Path(directory)
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "a file", "name a folder to write into")
    chosen = tuple(x for x in job.lightings if lightings is None or x.name in lightings)
    engine.install()
    layers = make(scene, spp=spp, lightings=chosen, progress=progress)
    assert scene.splats is not None
    engine.copy_page(folder, "mixer", PAGE)
    (folder / DESCRIPTION).unlink(missing_ok=True)
    file, order = write_splats(scene.splats, folder)
    packed, scales = rgb9e5.pack(layers.values[:, order])
    with atomic_path(folder / LAYERS) as temporary:
        packed.astype("<u4").tofile(temporary)
    around = behind.write(scene, layers.units, folder)
    with atomic_path(folder / DESCRIPTION) as temporary:
        described = _described(job, scene.splats, layers, scales, file)
        if around is not None:
            described["behind"] = {**_file(folder / behind.BEHIND), **around}
        text = json.dumps(described, indent=1, ensure_ascii=False)
        temporary.write_text(text + "\n", encoding="utf-8")
    return Exported(folder, layers, order, tuple(_warnings(job, layers)))


def write_splats(splats: SplatCloud, folder: Path) -> tuple[Path, NDArray[np.intp]]:
    """Splats as a page loads them: the file, and the order (N,) in which it has them.

    SH of degree 3 is 180 bytes a splat as floats, and 45 as codes.
    """
    for name in SPLATS:
        (folder / name).unlink(missing_ok=True)
    plain, compressed = (folder / name for name in SPLATS)
    if splats.sh.shape[1] == 1:
        ply.write(splats, plain)
        return plain, np.arange(len(splats))
    compressed_ply.write(splats, compressed)
    return compressed, compressed_ply.morton_order(splats.means)


def _described(job: Job, splats: SplatCloud, layers: MixLayers, scales: F64, file: Path) -> dict[str, Any]:
    space = job.relight.space or mode_of(job.relight).space or "linear"
    return {
        "title": job.source.parent.name if job.source.stem == "job" else job.source.stem,
        "count": len(splats),
        "splats": _file(file),
        "light": _file(file.with_name(LAYERS)),
        "layers": [{"name": n, "scale": float(s)} for n, s in zip(layers.names, scales, strict=True)],
        "constant": list(layers.constant),
        "lightings": [_lighting(x) for x in layers.lightings],
        "several": len(job.lightings) > 1,
        "mode": job.relight.mode,
        "space": space,
        "limit": layers.limit,
        "blend": job.relight.blend,
        "exposure": job.display.exposure,
        "tone": job.display.tone,
        "background": list(job.display.background),
        "cameras": [bookmark(x, splats) for x in _bookmarks(job)],
    }


def _file(path: Path) -> dict[str, Any]:
    """How the page knows a file."""
    return {"file": path.name, "bytes": path.stat().st_size, "sha256": file_digest(path)}


def _lighting(lighting: Mixed) -> dict[str, Any]:
    faders = [
        {"layer": f.layer, "name": f.name, "weight": f.weight.tolist(), "factor": f.factor.tolist()}
        for f in lighting.faders
    ]
    handles = [
        {"name": h.name, "layer": h.layer, "light": h.light, "position": h.position.tolist()} for h in lighting.handles
    ]
    return {"name": lighting.name, "faders": faders, "handles": handles}


def _bookmarks(job: Job) -> list[Camera]:
    """Its perspective cameras; of orthographic ones alone, what stands in the first one's place."""
    found = [x for x in job.cameras if x.projection == "perspective"][:_MOST_CAMERAS]
    if found:
        return found
    first = job.cameras[0]
    return [Camera.perspective(first.world_from_camera, first.width, first.height, yfov=45, name=first.name)]


def bookmark(camera: Camera, splats: SplatCloud) -> dict[str, Any]:
    """A camera as a page goes to it."""
    forward = -camera.world_from_camera[:3, 2]
    middle = np.median(splats.means[:: max(len(splats) // 4096, 1)].astype(np.float64), axis=0)
    ahead = max(float((middle - camera.position) @ forward), 2 * camera.near)
    far = float(np.linalg.norm(splats.means.astype(np.float64) - camera.position, axis=1).max())
    return {
        "name": camera.name,
        "position": camera.position.tolist(),
        "target": (camera.position + ahead * forward).tolist(),
        "up": camera.world_from_camera[:3, 1].tolist(),
        "fov": math.degrees(2 * math.atan(camera.height / (2 * camera.fy))),
        "aspect": camera.width / camera.height,
        "near": camera.near,
        "far": min(camera.far, max(4 * far, 2 * camera.near)),
    }


def _warnings(job: Job, layers: MixLayers) -> list[str]:
    out = []
    if layers.near < 0.9:
        out.append(f"{1 - layers.near:.0%} of the splats lie off the proxy and take their neighbours' light")
    if job.compositor.holds_light:
        out.append("splats that hold linear light: stills are right, the page itself shows them too dark")
    if job.display.view is not None:
        out.append(f"view {job.display.view.view!r}: stills have it, the page itself has the plain curve")
    if job.display.tone == "agx":
        out.append("tone agx: the engine has no such curve; the page uses none")
    if any(x.projection != "perspective" for x in job.cameras):
        out.append("orthographic cameras are no bookmarks of the page")
    if len(job.cameras) > _MOST_CAMERAS:
        out.append(f"{len(job.cameras)} cameras: the page has the first {_MOST_CAMERAS} perspective ones")
    return out
