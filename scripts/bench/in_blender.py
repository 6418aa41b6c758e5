"""Renders a benchmark scene with Blender Cycles; run by lighting.py with a Python that has `bpy` (GPL, not needed
by anything else here). Arguments: folder, light tree and denoising as 0 or 1. Reads "spp seed" lines, answers "DONE
cpu-seconds" and leaves picture.npy in the folder."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np

Z_UP = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], float)  # glTF axes to Blender's


def matrix(values: Any) -> Any:
    """A Blender matrix of a (4, 4) array."""
    from mathutils import Matrix  # type: ignore[import-not-found]

    return Matrix([list(map(float, row)) for row in values])


def pose_along(position: Any, direction: Any) -> Any:
    """A matrix whose -Z looks along `direction`, in Blender's axes."""
    back = -np.asarray(direction, float) / np.linalg.norm(direction)
    side = np.cross([0, 1, 0] if abs(back[1]) < 0.9 else [1, 0, 0], back)
    side /= np.linalg.norm(side)
    out = np.eye(4)
    out[:3, 0], out[:3, 1], out[:3, 2], out[:3, 3] = side, np.cross(back, side), back, position
    return Z_UP @ out


def build(data: Any, *, tree: bool, denoise: bool) -> Any:
    """The scene: gray two-sided diffuse mesh, lights, sky, camera."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    mesh = bpy.data.meshes.new("proxy")
    points = (data["vertices"] @ Z_UP[:3, :3].T).tolist()
    mesh.from_pydata(points, [], data["faces"].tolist())
    material = bpy.data.materials.new("gray")
    material.use_nodes = True
    nodes = material.node_tree
    nodes.nodes.clear()
    diffuse, output = nodes.nodes.new("ShaderNodeBsdfDiffuse"), nodes.nodes.new("ShaderNodeOutputMaterial")
    diffuse.inputs["Color"].default_value = (0.5, 0.5, 0.5, 1)
    nodes.links.new(diffuse.outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("proxy", mesh))
    for number, row in enumerate(data["lights"]):
        add_light(scene, number, row)
    add_sky(scene, data["sky"])
    width, height, fx = data["camera"]
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit, camera.sensor_width, camera.lens = "HORIZONTAL", 36.0, float(fx / width * 36.0)
    camera.clip_start, camera.clip_end = 0.01, 1e4
    holder = bpy.data.objects.new("camera", camera)
    holder.matrix_world = matrix(Z_UP @ data["pose"])
    scene.collection.objects.link(holder)
    scene.camera = holder
    settings(scene, int(width), int(height), int(data["bounces"]), tree=tree, denoise=denoise)
    return scene


def add_light(scene: Any, number: int, row: Any) -> None:
    """Rows as lighting.write_scene makes them: kind, position, direction, strength, sun angle, half cone."""
    kind, position, direction, strength = int(row[0]), row[1:4], row[4:7], row[7:10]
    peak = float(strength.max())
    light = bpy.data.lights.new(f"light{number}", {1: "SUN", 2: "SPOT", 3: "POINT"}[kind])
    light.color = [float(x) / peak for x in strength]
    if kind == 1:
        light.energy, light.angle = peak, float(row[10])
    else:
        light.energy = 4 * np.pi * peak  # W of a lamp of that many W per steradian
        light.shadow_soft_size = 0.0
    if kind == 2:
        light.spot_size, light.spot_blend = 2 * float(row[11]), 0.0
    holder = bpy.data.objects.new(f"light{number}", light)
    holder.matrix_world = matrix(pose_along(position, direction))
    scene.collection.objects.link(holder)


def add_sky(scene: Any, radiance: Any) -> None:
    """The map as world background; Blender's own orientation is the one of mirelight's conventions."""
    world = bpy.data.worlds.new("world")
    scene.world = world
    world.use_nodes = True
    tree = world.node_tree
    tree.nodes.clear()
    background, output = tree.nodes.new("ShaderNodeBackground"), tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(background.outputs[0], output.inputs["Surface"])
    background.inputs["Color"].default_value = (0, 0, 0, 1)
    if radiance.size:
        h, w = radiance.shape[:2]
        image = bpy.data.images.new("sky", w, h, float_buffer=True)
        image.colorspace_settings.name = "Non-Color"
        rgba = np.ones((h, w, 4), np.float32)
        rgba[..., :3] = radiance[::-1]
        image.pixels.foreach_set(rgba.ravel())
        texture = tree.nodes.new("ShaderNodeTexEnvironment")
        texture.image = image
        tree.links.new(texture.outputs[0], background.inputs["Color"])


def settings(scene: Any, width: int, height: int, bounces: int, *, tree: bool, denoise: bool) -> None:
    """Unbiased, box filter, everything counted alike; denoising as good as it has it."""
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = width, height, 100
    scene.render.film_transparent = True
    scene.render.use_persistent_data = True
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    cycles = scene.cycles
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.max_bounces = cycles.diffuse_bounces = bounces - 1
    cycles.use_light_tree = tree
    if denoise:
        cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
        cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "ACCURATE"


def main() -> None:
    folder, tree, denoise = Path(sys.argv[1]), sys.argv[2] == "1", sys.argv[3] == "1"
    with np.load(folder / "scene.npz") as data:
        scene = build(data, tree=tree, denoise=denoise)
    target = folder / "picture.exr"
    scene.render.filepath = str(target)
    for line in sys.stdin:
        spp, seed = map(int, line.split())
        scene.cycles.samples, scene.cycles.seed = spp, seed
        start = time.process_time()
        bpy.ops.render.render(write_still=True)
        spent = time.process_time() - start
        image = bpy.data.images.load(str(target), check_existing=False)
        image.colorspace_settings.name = "Non-Color"
        w, h = image.size
        rgba = np.empty(w * h * 4, np.float32)
        image.pixels.foreach_get(rgba)
        bpy.data.images.remove(image)
        np.save(folder / "picture.npy", np.ascontiguousarray(rgba.reshape(h, w, 4)[::-1, :, :3]))
        print("DONE", spent, flush=True)


if __name__ == "__main__":
    main()
