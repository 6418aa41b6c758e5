"""About how much memory a render takes at once, told from a job before anything is made.

The bytes are those of the process as the system counts them, fitted to measured peaks; `tests/cli/test_memory.py`
holds them to a fifth over sizes, lights, lightings and denoising.
"""

from __future__ import annotations

import numpy as np

from mirelight import relighting
from mirelight.model import Camera, Job, Lighting, ProxyMesh
from mirelight.model.unit_lights import GLOW
from mirelight.pipeline import keys, requirements

_PROGRAM = 180 << 20  # bytes of Python, Mitsuba, Dr.Jit and compiled kernels
_SPLAT = 270  # bytes of a splat beside it and its copy: projected records twice, keys, order
_TRIANGLE = 220  # bytes of a triangle's work: Embree's tree over it
_SKY = 28  # bytes of a map's pixel while light is traced, beside its own
_FRAME = 170  # bytes a pixel: composite, and the frame while it is written
_LIGHTING = 97  # bytes a pixel of the lighting, which may have more or fewer than the frame: AOVs, what is mixed
_LAYER = 25  # bytes a pixel of each layer of the lighting that is mixed
_SET = 80  # bytes a pixel of a traced set of lights: its geometry and sums over its layers
_SET_LAYER = 70  # bytes a pixel of each light in it
_DENOISED = 510  # bytes a pixel: the denoiser's own memory and its guides
_DENOISED_LAYER = 110  # bytes a pixel: parts of the samples, the noisy layer beside the clean one
_MOST_KEPT = 2**30  # bytes of traced sets that stay while another lighting of the view is made, see `view_light`


def of_render(job: Job, proxy: ProxyMesh | None) -> int:
    """Bytes: files and their copies on the device, and one frame of the largest camera with what its view keeps.

    Args:
        job: as it was loaded.
        proxy: its mesh; None: none, or one that is still to be made of the splats.
    """
    needed = _PROGRAM
    if job.splats is not None:
        splats = job.splats.value
        arrays = (splats.means, splats.quats, splats.scales, splats.opacities, splats.sh)
        needed += 2 * sum(x.nbytes for x in arrays) + _SPLAT * len(splats)
    if proxy is not None:
        needed += 2 * mesh_bytes(proxy) + _TRIANGLE * len(proxy.faces)
    lit: list[Lighting] = [*job.lightings, *(() if job.captured is None else (job.captured,))]
    skies = {id(x.environment.pixels): x.environment.pixels for x in lit if x.environment is not None}
    needed += sum(x.nbytes for x in skies.values()) + max((x.nbytes // 12 * _SKY for x in skies.values()), default=0)
    if not job.cameras:
        return needed
    camera = max(job.cameras, key=lambda x: x.width * x.height)
    return needed + camera.width * camera.height * _FRAME + _light_bytes(job, camera, _glows(proxy))


def mesh_bytes(mesh: ProxyMesh | None) -> int:
    """Bytes of a mesh's arrays without its textures."""
    if mesh is None:
        return 0
    arrays = (mesh.vertices, mesh.faces, mesh.normals, mesh.uvs, mesh.vertex_colors, mesh.face_materials)
    return sum(x.nbytes for x in arrays if x is not None)


def _light_bytes(job: Job, camera: Camera, glows: bool) -> int:
    """Of one view: the sets and layers of the lighting that takes most, and what is kept of the others' sets."""
    seen = relighting.lighting_camera(camera, job.relight)
    pixels, made = seen.width * seen.height, keys.Keys(job)
    every: dict[str, int] = {GLOW.digest: _SET + _SET_LAYER} if glows else {}
    most = kept = 0
    for lighting in (x for x in job.lightings if x.lights_up(camera)):
        sets = made.needs(camera, [lighting]).sets
        own = {s.digest: _SET + _SET_LAYER * max(1, s.layers) for s in sets}
        layers = len(lighting.layer_names) + glows
        denoised = (
            _DENOISED + _DENOISED_LAYER * layers if job.render.denoise and not requirements.follows_engine(job) else 0
        )
        every |= own
        most = max(most, sum(own.values()) + _LAYER * layers + denoised)
        kept = max(kept, sum(own.values()))
    return pixels * (_LIGHTING + most) + min(pixels * (sum(every.values()) - kept), _MOST_KEPT)


def _glows(proxy: ProxyMesh | None) -> bool:
    """Whether surfaces send out light, which is one more set and layer."""
    return proxy is not None and any(np.any(x.emissive) for x in proxy.materials)
