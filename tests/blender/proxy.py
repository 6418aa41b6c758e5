#!/usr/bin/env python3
"""A proxy lit in Blender and taken back: the left half of the picture of docs/guides/blender.md.

    mirelight proxy scenes/courtyard/job.toml -o out/blender/room.glb
    pip install bpy    # Blender as a Python package: GPL, a tool for this script and no part of mirelight
    python tests/blender/proxy.py out/blender/room.glb

Imports the proxy with its cameras, hangs a lamp and a spot, renders the view of the first camera by name by Cycles into
`blender.png`, and exports everything as `lit.glb` beside it. The right half is the page's job with that file, at the
same exposure. Without bpy it says so and ends with 0.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

SIZE, SAMPLES = (640, 360), 96
# In the file's axes (Y up): name, kind, place, what it shines at, watts, colour.
LAMPS: tuple[tuple[str, str, tuple[float, ...], tuple[float, ...], float, tuple[float, ...]], ...] = (
    ("lamp", "POINT", (0.4, 2.4, 1.9), (0.0, 0.0, 0.0), 60.0, (1.0, 0.62, 0.3)),
    ("spot", "SPOT", (2.4, 3.4, 2.6), (-2.6, 1.4, -0.4), 420.0, (0.45, 0.65, 1.0)),
)


def main() -> int:
    """Import, light, render, export."""
    try:
        import bpy
        from mathutils import Vector  # type: ignore[import-not-found]
    except ImportError:
        print("bpy is not installed (pip install bpy): nothing done")
        return 0
    room = Path(sys.argv[1]).resolve()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(room))
    for name, kind, place, aim, watts, color in LAMPS:
        lamp = bpy.data.objects.new(name, bpy.data.lights.new(name, kind))
        lamp.location = _blender(place)
        lamp.data.energy, lamp.data.color, lamp.data.shadow_soft_size = watts, color, 0.0
        if kind == "SPOT":
            lamp.data.spot_size, lamp.data.spot_blend = 0.9, 0.5
            way = Vector(_blender(aim)) - Vector(_blender(place))
            lamp.rotation_euler = way.to_track_quat("-Z", "Y").to_euler()
        bpy.context.scene.collection.objects.link(lamp)
    cameras = [x for x in bpy.data.objects if x.type == "CAMERA"]
    bpy.context.scene.camera = cameras[0]
    _render(bpy, room.with_name("blender.png"))
    lit = room.with_name("lit.glb")
    bpy.ops.export_scene.gltf(filepath=str(lit), export_format="GLB", export_cameras=True, export_lights=True)
    print(f"Blender {bpy.app.version_string}: {lit}, seen by {cameras[0].name}")
    return 0


def _blender(place: tuple[float, ...]) -> tuple[float, float, float]:
    """A glTF place (Y up) as Blender has it (Z up)."""
    x, y, z = place
    return x, -z, y


def _render(bpy: Any, path: Path) -> None:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = SAMPLES, True
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = *SIZE, 100
    scene.view_settings.view_transform = "Standard"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    sys.exit(main())
