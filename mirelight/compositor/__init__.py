"""The splat compositor: front-to-back EWA splatting in Dr.Jit, in two profiles.

`reference` is the slow NumPy oracle. See docs/explanation/compositor.md for the design and what was measured.
"""

from __future__ import annotations

from mirelight.compositor.compositor import Compositor, composite

__all__ = ["Compositor", "composite"]
