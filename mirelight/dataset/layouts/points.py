"""The points that trainers start from."""

from __future__ import annotations

import numpy as np

from mirelight.base import colour
from mirelight.base.conventions import Matrix
from mirelight.io.cameras.colmap_write import Points
from mirelight.model import SplatCloud
from mirelight.model.scene import holds_light

_MOST = 100_000
_SH0 = 0.28209479177387814  # 1 / (2 sqrt(pi))


def points_of(splats: SplatCloud, most: int = _MOST) -> Points:
    """Splat centres with their mean colour, at most `most` of them, in the splats' world.

    Args:
        splats: in mirelight's world.
        most: every so manyth splat is taken, so that no more come out.
    """
    chosen = slice(None, None, max(1, -(-len(splats) // most)))
    shown = 0.5 + _SH0 * splats.sh[chosen, 0]
    colors = np.clip(colour.srgb_encode(splats.light(shown)) if holds_light(splats.color_space) else shown, 0, 1)
    return Points(splats.means[chosen].astype(np.float64), np.rint(255 * colors).astype(np.uint8))


def moved(points: Points, world: Matrix) -> Points:
    """The points carried through a matrix (4, 4)."""
    return Points(points.positions @ world[:3, :3].T + world[:3, 3], points.colors)


def ply_bytes(points: Points) -> bytes:
    """A binary PLY of the points: x y z float32, red green blue uint8."""
    fields = [(name, "<f4") for name in "xyz"] + [(name, "u1") for name in ("red", "green", "blue")]
    rows = np.empty(len(points.positions), dtype=fields)
    for i, name in enumerate("xyz"):
        rows[name] = points.positions[:, i]
    for i, name in enumerate(("red", "green", "blue")):
        rows[name] = points.colors[:, i]
    kinds = [f"property float {name}" for name in "xyz"] + [f"property uchar {n}" for n in ("red", "green", "blue")]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}", *kinds, "end_header\n"]
    return "\n".join(head).encode("ascii") + rows.tobytes()
