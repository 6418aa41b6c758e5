"""What is in a file: counts, bounds, lights, cameras, and the memory it will take.

Splats and meshes are read whole, because only that shows whether a file is sound and how far it reaches.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from mirelight.apps.inspect.facts import (
    CameraFacts,
    Facts,
    JobFacts,
    LightFacts,
    MeshFacts,
    ObjectFacts,
    PictureFacts,
    SplatFacts,
    bounds_of,
    camera_facts,
    gltf_camera_facts,
    light_facts,
    lighting_facts,
    numbers,
    rounded,
    stage_camera_facts,
)
from mirelight.base import primaries
from mirelight.base.errors import InputError
from mirelight.base.primaries import Chromaticities
from mirelight.io.safety import existing, open_binary, read_bytes
from mirelight.io.suffixes import GLTF, USD
from mirelight.model import F32, F64, Inserted, Job, ProxyMesh, SplatCloud, camera_checks
from mirelight.pipeline import peak

_MESHES = (".obj", ".stl")  # and nothing else; other meshes' files may as well hold splats
_PICTURES = (".exr", ".hdr", ".png", ".jpg", ".jpeg", ".webp")
_HEAD = 64 * 2**10  # bytes in which a PLY header names its first properties
_LONGEST_JSON = 256 * 2**20


def inspect(path: str | Path) -> Facts:
    """What is in a splat, mesh, glTF, image or job file; its content decides, its suffix only where that cannot.

    Raises:
        InputError: it cannot be read, or is of no known kind.
        ManyInputsError: a job file with several mistakes.
    """
    from mirelight.io import splats

    path = existing(path)
    suffix = path.suffix.lower()
    if suffix == ".toml":
        return _job(path)
    if path.is_file() and (suffix in _PICTURES):
        return _picture(path)
    if path.is_file() and (suffix in _MESHES or _is_mesh(path, suffix)):
        return _gltf(path) if suffix in GLTF else _mesh(path)
    if path.is_file() and suffix in USD:
        return _stage(path)
    if path.is_file() and suffix not in splats.SUFFIXES:
        known = ", ".join((".toml", *splats.SUFFIXES, *_MESHES, *_PICTURES))
        raise InputError(path, f"of no known kind ({suffix or 'no suffix'})", f"known are {known}")
    return _splats(path)


# --- splats and meshes -----------------------------------------------------------------------------------------------


def _is_mesh(path: Path, suffix: str) -> bool:
    with open_binary(path) as file:
        head = file.read(_HEAD)
        if head[:4] == b"glTF":
            head += file.read(min(int.from_bytes(head[12:16], "little"), _LONGEST_JSON))
    if head[:3] == b"ply":
        return b"f_dc_0" not in head and b"packed_position" not in head
    if head[:4] == b"glTF":
        return b"KHR_gaussian_splatting" not in head
    is_json = head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{"
    return is_json and suffix in GLTF and b"KHR_gaussian_splatting" not in read_bytes(path, _LONGEST_JSON)


def _splats(path: Path) -> SplatFacts:
    from mirelight.io import splats

    info = splats.summary(path)
    cloud = splats.read(path)
    return SplatFacts(
        path=str(path),
        format=info.format,
        splats=len(cloud),
        dropped=cloud.dropped,
        sh_degree=cloud.sh_degree,
        antialiased=cloud.antialiased,
        color_space=cloud.color_space,
        levels=info.levels,
        bounds=bounds_of(cloud.means),
        median_scale=rounded(np.median(cloud.scales)) if len(cloud) else None,
        mean_opacity=rounded(np.mean(cloud.opacities)) if len(cloud) else None,
        memory=sum(x.nbytes for x in (cloud.means, cloud.quats, cloud.scales, cloud.opacities, cloud.sh)),
        notes=(*info.notes, *_far(cloud)),
    )


def _mesh(path: Path) -> MeshFacts:
    from mirelight.io.mesh import read_mesh

    return _mesh_facts(path, read_mesh(path, textures=False), (), ())


def _gltf(path: Path) -> MeshFacts:
    from mirelight.io.gltf import blender
    from mirelight.io.gltf.moving_lights import moving_lights
    from mirelight.io.gltf.scene import read_scene

    scene = read_scene(path, textures=False)
    cameras = tuple(gltf_camera_facts(camera, camera.name in scene.animated_cameras) for camera in scene.cameras)
    moving = moving_lights(path)
    lights = tuple(replace(light_facts(x), animated=y) for x, y in zip(scene.lights, moving, strict=True))
    facts = _mesh_facts(path, scene.mesh, lights, cameras)
    if scene.blender is None or not scene.lights:
        return facts
    note = blender.note(path.name, scene.blender, 'in a job: lights_from with unit = "blender"')
    return replace(facts, notes=(*facts.notes, note))


def _stage(path: Path) -> SplatFacts | MeshFacts:
    """A stage: of one with splats those, and a line on what else there is; of another meshes, lights and cameras."""
    from mirelight.io.usd.cameras import read_cameras
    from mirelight.io.usd.contents import contents
    from mirelight.io.usd.files import notes_of
    from mirelight.io.usd.lights import read_lights
    from mirelight.io.usd.mesh import read_proxy

    found = contents(path)
    lit = read_lights(path)
    if found.splats:
        facts = _splats(path)
        line = f"beside them {found.meshes} meshes, {found.cameras} cameras, {found.lamps} lamps, {found.domes} domes"
        return replace(facts, notes=tuple(dict.fromkeys((*facts.notes, line, *lit.notes, *notes_of(path)))))
    cameras = tuple(stage_camera_facts(camera) for camera in read_cameras(path))
    mesh = _mesh_facts(path, read_proxy(path, textures=False), tuple(light_facts(x) for x in lit.lights), cameras)
    return replace(mesh, notes=tuple(dict.fromkeys((*mesh.notes, *lit.notes, *notes_of(path)))))


def _mesh_facts(
    path: Path, mesh: ProxyMesh | None, lights: tuple[LightFacts, ...], cameras: tuple[CameraFacts, ...]
) -> MeshFacts:
    return MeshFacts(
        path=str(path),
        triangles=len(mesh.faces) if mesh else 0,
        vertices=len(mesh.vertices) if mesh else 0,
        bounds=bounds_of(mesh.vertices) if mesh else None,
        normals=mesh is not None and mesh.normals is not None,
        uvs=mesh is not None and mesh.uvs is not None,
        vertex_colors=mesh is not None and mesh.vertex_colors is not None,
        materials=tuple(m.name for m in mesh.materials) if mesh else (),
        memory=peak.mesh_bytes(mesh),
        lights=lights,
        cameras=cameras,
        notes=_far(mesh),
    )


def _far(*things: SplatCloud | ProxyMesh | None) -> tuple[str, ...]:
    """Lines on what lies where single precision is too coarse."""
    lines = [camera_checks.too_far(x) for x in things if x is not None]
    return tuple(x for x in lines if x)


# --- images ----------------------------------------------------------------------------------------------------------


def _finite(pixels: F32) -> tuple[int, F64, float]:
    """How many of pixels (H, W, 3) are finite, their sum (3,) and their greatest value; some rows at a time, as a large
    sky takes enough memory as it is."""
    count, total, brightest = 0, np.zeros(3), -np.inf
    for first in range(0, len(pixels), 256):
        rows = pixels[first : first + 256]
        sound = rows[np.isfinite(rows).all(axis=-1)]
        count += len(sound)
        total += sound.sum(axis=0, dtype=np.float64)
        brightest = max(brightest, float(sound.max(initial=-np.inf)))
    return count, total, brightest


def _picture(path: Path) -> PictureFacts:
    from mirelight.io.image import read_fingerprint

    fingerprint = read_fingerprint(path) if path.suffix.lower() in (".exr", ".png") else None
    if path.suffix.lower() == ".exr":
        from mirelight.io.exr import chromaticities_of, read_exr, to_rec709

        image = read_exr(path)
        first = next(iter(image.channels.values()))
        own = [image.channels[c] for c in "RGB" if c in image.channels]
        pixels = np.stack(own, axis=-1).astype(np.float32) if len(own) == 3 else None
        pixels = None if pixels is None else to_rec709(path, image.metadata, pixels)
        space = _space(chromaticities_of(path, image.metadata))
        names, (height, width) = tuple(image.channels), first.shape[:2]
        memory = sum(channel.nbytes for channel in image.channels.values())
    else:
        from mirelight.io.environment import read_environment
        from mirelight.io.hdr import read_hdr_primaries

        pixels = read_environment(path)
        names, (height, width), memory = ("R", "G", "B"), pixels.shape[:2], pixels.nbytes
        space = _space(read_hdr_primaries(path)) if path.suffix.lower() == ".hdr" else "sRGB"
    sound, total, brightest = _finite(pixels) if pixels is not None else (0, np.zeros(3), 0.0)
    return PictureFacts(
        path=str(path),
        width=int(width),
        height=int(height),
        channels=names,
        mean=numbers(total / sound) if sound else None,
        brightest=rounded(brightest) if sound else None,
        not_finite=0 if pixels is None else int(height * width - sound),
        color_space=space,
        memory=int(memory),
        fingerprint=fingerprint,
    )


def _space(found: Chromaticities | None) -> str:
    return "not named, taken as lin_rec709" if found is None else primaries.name_of(found)


# --- jobs ------------------------------------------------------------------------------------------------------------


def _job(path: Path) -> JobFacts:
    from mirelight.io import job

    return of_job(job.load(path), path)


def of_job(work: Job, path: str | Path) -> JobFacts:
    """What a loaded job holds. A proxy that has to be made of the splats is not: its triangles are not known then.

    Raises:
        InputError: a file that it names cannot be used.
    """
    splats = work.splats.value if work.splats is not None else None
    to_make = work.made_proxy is not None and not work.made_proxy.mesh.is_there
    proxy = work.proxy.value if work.proxy is not None and not to_make else None
    seen = splats.means if splats is not None else proxy.vertices if proxy else None
    return JobFacts(
        path=str(path),
        splats=len(splats) if splats is not None else 0,
        dropped=splats.dropped if splats is not None else 0,
        sh_degree=splats.sh_degree if splats is not None else None,
        triangles=len(proxy.faces) if proxy else 0,
        proxy_to_make=to_make,
        bounds=None if seen is None else bounds_of(seen),
        lightings=tuple(lighting_facts(x) for x in work.lightings),
        captured=lighting_facts(work.captured) if work.captured else None,
        cameras=tuple(camera_facts(x) for x in work.cameras),
        objects=_objects(work.objects, proxy),
        frames=sum(x.lights_up(camera) for camera in work.cameras for x in work.lightings) or len(work.cameras),
        inputs=tuple(work.inputs),
        mode=work.relight.mode,
        profile=work.compositor.profile,
        output=str(work.output.directory),
        memory=peak.of_render(work, proxy),
        notes=(*work.notes, *_far(splats, proxy)),
    )


def _objects(objects: tuple[Inserted, ...], proxy: ProxyMesh | None) -> tuple[ObjectFacts, ...]:
    """Objects where they stand, or where the job puts them while there is nothing to stand on.

    Raises:
        InputError: one that finds no place on the proxy.
    """
    if not objects:
        return ()
    if proxy is None:
        made = [(x, x.mesh.value) for x in objects]
        return tuple(
            ObjectFacts(x.name, len(m.faces), bounds_of(m.vertices), bool(x.drop or x.scatter)) for x, m in made
        )
    from mirelight.lighting.objects import inserted

    found = inserted(objects, proxy)
    faces = [found.mesh.faces[found.owners == i] for i in range(len(objects))]
    places = [bounds_of(found.mesh.vertices[np.unique(own)]) for own in faces]
    return tuple(ObjectFacts(x.name, len(own), at, False) for x, own, at in zip(objects, faces, places, strict=True))
