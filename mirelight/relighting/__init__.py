"""Light meets splats: one factor per pixel and channel, by which the finished composite is multiplied.

The factor is the same for every splat under a pixel, and blending is linear, so multiplying the composite is the same
as multiplying each splat before blending: one composite serves every lighting of its camera. Modes differ only in the
factor; each is one object (`mode`) in a module of its own (`tint`, `ratio`), found by its name (`modes`). See
docs/explanation/relighting.md.
"""

from __future__ import annotations

from mirelight.relighting.backdrop import without_leaks
from mirelight.relighting.far import Far, FarMaps
from mirelight.relighting.frame import Relighter, apply, lighting_camera, relighter, unlit_rgba
from mirelight.relighting.inserted import shadow, shadow_of, with_objects
from mirelight.relighting.lobes import with_lobes
from mirelight.relighting.mode import Lit, Mode, Task
from mirelight.relighting.modes import MODES, adds_lobes, gloss_of, mode_of, per_splat, reads, repairs
from mirelight.relighting.repair import Sun, repaired
from mirelight.relighting.resample import upsample
from mirelight.relighting.splats import captured_color, frame_of_splats, relit_colors, splat_relighter

__all__ = [
    "MODES",
    "Far",
    "FarMaps",
    "Lit",
    "Mode",
    "Relighter",
    "Sun",
    "Task",
    "adds_lobes",
    "apply",
    "captured_color",
    "frame_of_splats",
    "gloss_of",
    "lighting_camera",
    "mode_of",
    "per_splat",
    "reads",
    "relighter",
    "relit_colors",
    "repaired",
    "repairs",
    "shadow",
    "shadow_of",
    "splat_relighter",
    "unlit_rgba",
    "upsample",
    "with_lobes",
    "with_objects",
    "without_leaks",
]
