"""Suffixes that tell what a file is before it is opened; a reader looks at its content."""

from __future__ import annotations

GLTF = (".glb", ".gltf")
USD = (".usd", ".usda", ".usdc", ".usdz")
SCENES = (*GLTF, *USD)  # of meshes, lights and cameras in a world of their own, perhaps splats too
MESHES = (*SCENES, ".ply", ".obj", ".stl")
CONVERTED = (".lcc", ".lcc2")  # splats that splat-transform reads
CHECKPOINTS = (".pt", ".ckpt")  # of trainings
SPLATS = (
    ".ply",
    ".spz",
    ".sog",
    ".splat",
    ".ksplat",
    *CHECKPOINTS,
    *SCENES,
    *CONVERTED,
)  # .json may be a SOG's, and cameras as well
