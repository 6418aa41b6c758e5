#!/usr/bin/env python3
"""What Blender makes of UsdLux lights, of cameras and of splats: what docs/guides/hand-over.md says of it.

    pip install bpy    # Blender as a Python package: GPL, a tool for this script and no part of mirelight
    python tests/blender/usd.py            # imports a stage with one light of each kind and prints what came
    python tests/blender/usd.py STAGE      # imports another stage and lists its objects

Of each light Cycles renders a white matte plane 3 m in front: printed is the irradiance there (pi times what the image
holds) over the closed form of UsdLux in lux. Without bpy it says so and ends with 0.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path
from typing import Any

_HEAD = '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Y"\n)\n'
_L = 8.0  # intensity 2, exposure 2: cd/m2, or lux where it is a normalised sun
_COMMON = "float inputs:intensity = 2\nfloat inputs:exposure = 2\n"
_FAR = 3.0  # m
_BALL = math.pi * (0.25 / _FAR) ** 2  # projected solid angle (sr)
_DISK = math.pi * 0.5**2 / (0.5**2 + _FAR**2)
_SUN = math.pi * math.sin(math.radians(0.5)) ** 2
_NORMAL = "\nbool inputs:normalize = 1"


def _rect(width: float, height: float) -> float:
    a, b = width / 2 / _FAR, height / 2 / _FAR
    p, q = math.hypot(1, a), math.hypot(1, b)
    return 2 * (a / p * math.atan(b / p) + b / q * math.atan(a / q))


# Name, kind, attributes, and lux for each cd/m2 of `_L`.
_LIGHTS = (
    ("distant", "DistantLight", "float inputs:angle = 1", _SUN),
    ("distant, normalised", "DistantLight", "float inputs:angle = 1" + _NORMAL, 1.0),
    ("sphere", "SphereLight", "float inputs:radius = 0.25", _BALL),
    ("sphere, normalised", "SphereLight", "float inputs:radius = 0.25" + _NORMAL, _BALL / (4 * math.pi * 0.25**2)),
    ("sphere, treatAsPoint", "SphereLight", "float inputs:radius = 0.25\nbool treatAsPoint = 1", _BALL),
    ("rect", "RectLight", "float inputs:width = 2\nfloat inputs:height = 0.5", _rect(2, 0.5)),
    ("rect, normalised", "RectLight", "float inputs:width = 2\nfloat inputs:height = 0.5" + _NORMAL, _rect(2, 0.5)),
    ("disk", "DiskLight", "float inputs:radius = 0.5", _DISK),
    ("disk, normalised", "DiskLight", "float inputs:radius = 0.5" + _NORMAL, _DISK / (math.pi * 0.5**2)),
    ("cylinder", "CylinderLight", "float inputs:length = 0.2\nfloat inputs:radius = 0.02", 0.008 / _FAR**2),
    ("cone", "SphereLight", "float inputs:radius = 0.25\nfloat inputs:shaping:cone:angle = 30", _BALL),
    ("dome", "DomeLight", "color3f inputs:color = (1, 1, 1)", math.pi),
)


def main() -> int:
    """Import and print."""
    try:
        import bpy
    except ImportError:
        print("bpy is not installed (pip install bpy): nothing imported")
        return 0
    print("Blender", bpy.app.version_string)
    if len(sys.argv) > 1:
        _import(bpy, Path(sys.argv[1]).resolve())
        for thing in bpy.data.objects:
            print(thing.name, thing.type, *_facts(thing))
        return 0
    for name, kind, body, per_luminance in _LIGHTS:
        api = ' (prepend apiSchemas = ["ShapingAPI"])' if "shaping" in body else ""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "stage.usda"
            path.write_text(f'{_HEAD}def {kind} "it"{api}\n{{\n{_COMMON}{body}\n}}\n')
            _import(bpy, path)
        found = [x for x in bpy.data.objects if x.type == "LIGHT"]
        share = _irradiance(bpy) / (_L * per_luminance)
        print(f"{name}: {share:.3f} of UsdLux';", *(f for x in found for f in _facts(x)), *_world(bpy))
    return 0


def _irradiance(bpy: Any) -> float:
    """On a plane 3 m along the stage's -Z, Blender's +Y, that faces the light."""
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=1, location=(0, _FAR, 0), rotation=(math.pi / 2, 0, 0))
    material = bpy.data.materials.new("white")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    matte, out = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    matte.inputs["Color"].default_value = (1, 1, 1, 1)
    material.node_tree.links.new(matte.outputs["BSDF"], out.inputs["Surface"])
    bpy.context.object.data.materials.append(material)
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    eye.data.type, eye.data.ortho_scale = "ORTHO", 0.02
    eye.location, eye.rotation_euler = (0, _FAR - 0.5, 0), (math.pi / 2, 0, 0)
    scene.collection.objects.link(eye)
    scene.camera, scene.render.engine = eye, "CYCLES"
    scene.cycles.samples, scene.cycles.use_adaptive_sampling, scene.cycles.use_denoising = 4096, False, False
    scene.cycles.max_bounces = 0
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 2, 2, 100
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "frame.exr")
        bpy.ops.render.render(write_still=True)
        picture = bpy.data.images.load(scene.render.filepath)
        values = list(picture.pixels)
    return math.pi * float(sum(values[0::4])) / len(values[0::4])


def _import(bpy: Any, path: Path) -> None:
    bpy.ops.wm.read_factory_settings()  # with a world, which domes need
    bpy.context.scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    bpy.ops.wm.usd_import(filepath=str(path), import_all_materials=True)


def _facts(thing: Any) -> list[str]:
    if thing.type == "CAMERA":
        lens = thing.data
        return [f"{lens.lens:g} mm on {lens.sensor_width:g} x {lens.sensor_height:g}, shift {lens.shift_x:g}"]
    if thing.type != "LIGHT":
        return []
    lamp = thing.data
    out = [lamp.type, f"energy {lamp.energy:.6g}", f"exposure {lamp.exposure:g}", f"normalize {lamp.normalize}"]
    if lamp.type == "SUN":
        return [*out, f"angle {math.degrees(lamp.angle):g}"]
    if lamp.type == "AREA":
        return [
            *out,
            lamp.shape,
            f"size {lamp.size:g} {lamp.size_y:g}",
            f"scale {tuple(round(x, 3) for x in thing.scale)}",
        ]
    cone = [f"cone {math.degrees(lamp.spot_size):g} blend {lamp.spot_blend:g}"] if lamp.type == "SPOT" else []
    return [*out, f"radius {lamp.shadow_soft_size:g}", *cone]


def _world(bpy: Any) -> list[str]:
    world = bpy.context.scene.world
    if world is None or world.node_tree is None:
        return []
    back = [x for x in world.node_tree.nodes if x.type == "BACKGROUND"]
    return [f"world of strength {x.inputs['Strength'].default_value:g}" for x in back]


if __name__ == "__main__":
    sys.exit(main())
