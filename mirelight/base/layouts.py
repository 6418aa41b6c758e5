"""Names of the layouts of data sets, in a module that loads nothing heavy: the command line lists them."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

Layout: TypeAlias = Literal["nerf", "colmap", "tensoir", "olat", "hub", "coco", "tum"]
LAYOUTS: tuple[Layout, ...] = get_args(Layout)
