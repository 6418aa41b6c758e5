#!/usr/bin/env python3
"""Blender's lamps on a white floor, rendered by Cycles: the data that tests hold cones, watts and their units against.

    pip install bpy    # Blender as a Python package: GPL, a tool for this script and no part of mirelight
    python tests/blender/measure_lights.py tests/data/blender/lights.json

Every lamp hangs 2 m above the middle of a matte floor of albedo 0.8 and shines down; an orthographic camera above looks
at 8 m of it, direct light alone, without view transform. Written are the radiance of each pixel of the row nearest to
the middle, and where on the floor its centre lies. Without bpy it says so and ends with 0.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from pathlib import Path
from typing import Any

WIDTH, HEIGHT, ACROSS = 256, 4, 8.0  # px, px, m
ABOVE, ALBEDO, SAMPLES = 2.0, 0.8, 256


def main() -> int:
    """Measure all lamps and write them."""
    if len(sys.argv) != 2:
        print("usage: measure_lights.py FILE.json", file=sys.stderr)
        return 2
    try:
        import bpy
    except ImportError:
        print("bpy is not installed (pip install bpy): nothing measured")
        return 0
    scene = _stage(bpy)
    cases: list[dict[str, Any]] = [{"type": "POINT", "watt": 100.0}, {"type": "SUN", "strength": 2.0}]
    cases += [
        {"type": "SPOT", "watt": 100.0, "size": size, "blend": blend}
        for size in (30.0, 75.0, 120.0)
        for blend in (0.0, 0.15, 0.5, 1.0)
    ]
    cases += [{"type": "AREA", "watt": 100.0, "shape": "SQUARE", "side": 0.5}]
    for case in cases:
        case["radiance"] = _measured(bpy, scene, case)
        print(case["type"], *(f"{k} {v}" for k, v in case.items() if k in ("size", "blend")), max(case["radiance"]))
    step = ACROSS / WIDTH
    found = {
        "made_with": f"Blender {bpy.app.version_string}, Cycles, CPU, {SAMPLES} samples, box filter of one pixel",
        "script": "tests/blender/measure_lights.py",
        "height": ABOVE,
        "albedo": ALBEDO,
        "x": [(i + 0.5) * step - ACROSS / 2 for i in range(WIDTH)],
        "y": 0.5 * step,
        "cases": cases,
    }
    path = Path(sys.argv[1])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(found, indent=None, separators=(",", ":")) + "\n", encoding="utf-8")
    return 0


def _stage(bpy: Any) -> Any:
    scene = bpy.context.scene
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    scene.render.engine = "CYCLES"
    scene.cycles.samples = SAMPLES
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 0
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.filter_width = 1.0
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = WIDTH, HEIGHT, 100
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    bpy.ops.mesh.primitive_plane_add(size=4 * ACROSS)
    material = bpy.data.materials.new("floor")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    matte, out = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    matte.inputs["Color"].default_value = (ALBEDO, ALBEDO, ALBEDO, 1)
    matte.inputs["Roughness"].default_value = 0.0
    material.node_tree.links.new(matte.outputs["BSDF"], out.inputs["Surface"])
    bpy.context.object.data.materials.append(material)
    camera = bpy.data.cameras.new("above")
    camera.type, camera.ortho_scale = "ORTHO", ACROSS
    above = bpy.data.objects.new("above", camera)
    above.location = (0, 0, 10)
    scene.collection.objects.link(above)
    scene.camera = above
    return scene


def _measured(bpy: Any, scene: Any, case: dict[str, Any]) -> list[float]:
    lamp = bpy.data.lights.new("lamp", case["type"])
    lamp.energy = case.get("watt", case.get("strength"))
    if case["type"] in ("POINT", "SPOT"):
        lamp.shadow_soft_size = 0.0
    if case["type"] == "SUN":
        lamp.angle = 0.0
    if case["type"] == "SPOT":
        lamp.spot_size, lamp.spot_blend = math.radians(case["size"]), case["blend"]
    if case["type"] == "AREA":
        lamp.shape, lamp.size = case["shape"], case["side"]
    hung = bpy.data.objects.new("lamp", lamp)
    hung.location = (0, 0, ABOVE)
    scene.collection.objects.link(hung)
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "frame.exr")
        bpy.ops.render.render(write_still=True)
        picture = bpy.data.images.load(scene.render.filepath)
        values = list(picture.pixels)
        bpy.data.images.remove(picture)
    bpy.data.objects.remove(hung)
    start = HEIGHT // 2 * WIDTH * 4
    return [round(values[start + 4 * i], 7) for i in range(WIDTH)]


if __name__ == "__main__":
    sys.exit(main())
