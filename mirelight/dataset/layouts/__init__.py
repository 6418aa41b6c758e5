"""Layouts of data sets, written from arrays: one module each, with the traps of its loaders.

Pictures are PNG with 8-bit sRGB and straight alpha, since the loaders lay them over a background of their own. File
names have no dot but the suffix's, and no space: loaders cut them there.
"""

from __future__ import annotations

from mirelight.dataset.layouts.colmap import write_colmap
from mirelight.dataset.layouts.nerf import write_nerf
from mirelight.dataset.layouts.pictures import Picture, straight_rgba
from mirelight.dataset.layouts.points import points_of
from mirelight.dataset.layouts.world import world_of

__all__ = ["Picture", "points_of", "straight_rgba", "world_of", "write_colmap", "write_nerf"]
