#!/usr/bin/env python3
"""Opens a Cryptomatte of ours in Blender's compositor, without a window, and holds its matte against the file's own.

    pip install bpy OpenEXR    # Blender as a Python package: GPL, a tool for this script and no part of mirelight
    python tests/blender/cryptomatte.py FRAME.exr NODE

FRAME.exr has the layer `cryptomatte_node`, and NODE is one of its names. Exits 1 where Blender's matte differs from the
sum of the coverages that the file holds for that name. Without bpy it says so and ends with 0.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR


def main() -> int:
    """Compare both mattes."""
    if len(sys.argv) != 3:
        print("usage: cryptomatte.py FRAME.exr NODE", file=sys.stderr)
        return 2
    try:
        import bpy
    except ImportError:
        print("bpy is not installed (pip install bpy): nothing opened")
        return 0
    path, name = Path(sys.argv[1]).resolve(), sys.argv[2]
    ours = _held(path, name)
    theirs = _shown(bpy, path, name, ours.shape)
    soft = int(((ours > 0.01) & (ours < 0.99)).sum())
    worst = float(np.abs(ours - theirs).max())
    print(f"Blender {bpy.app.version_string}: {name} covers {ours.sum():.1f} pixels, {soft} of them in part; ", end="")
    print(f"largest difference {worst:g}")
    return 0 if ours.any() and worst < 1e-6 else 1


def _held(path: Path, name: str) -> Any:
    """(H, W) coverage by the standard's own rules."""
    with OpenEXR.File(str(path)) as file:
        header = file.header()
        (group,) = (k.rsplit("/", 1)[0] for k, v in header.items() if k.endswith("/name") and v == "CryptoObject")
        wanted = np.uint32(int(json.loads(header[f"{group}/manifest"])[name], 16))
        ranks = [file.channels()[f"CryptoObject{i:02d}"].pixels for i in range(3)]
    pairs = [(rank[..., k], rank[..., k + 1]) for rank in ranks for k in (0, 2)]
    return sum(np.where(np.ascontiguousarray(ids).view(np.uint32) == wanted, share, 0) for ids, share in pairs)


def _shown(bpy: Any, path: Path, name: str, size: tuple[int, int]) -> Any:
    """(H, W) what the Cryptomatte node gives."""
    scene = bpy.context.scene
    tree = scene.compositing_node_group = bpy.data.node_groups.new("matte", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    node, out = tree.nodes.new("CompositorNodeCryptomatteV2"), tree.nodes.new("NodeGroupOutput")
    node.source, node.image, node.matte_id = "IMAGE", bpy.data.images.load(str(path)), name
    tree.links.new(node.outputs["Matte"], out.inputs[0])
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    scene.collection.objects.link(eye)
    scene.camera = eye
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.render.resolution_y, scene.render.resolution_x = size
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "matte.exr")
        bpy.ops.render.render(write_still=True)
        values = np.array(bpy.data.images.load(scene.render.filepath).pixels)
    return values.reshape(*size, 4)[::-1, :, 0]


if __name__ == "__main__":
    sys.exit(main())
