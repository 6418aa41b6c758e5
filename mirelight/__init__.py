"""mirelight: offline, physically based relighting of Gaussian-splat captures.

The frame, as five calls (nothing heavy is imported before the first of them)::

    job      = mirelight.load("courtyard.toml")
    splats   = mirelight.composite(job.scene.splats, camera, job.compositor)
    lighting = mirelight.trace(job.scene.proxy, lights, camera, job.render)
    frame    = mirelight.apply(splats, lighting, job.relight)
    mirelight.write(frame, "frame.exr")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from mirelight.compositor import composite
    from mirelight.io.image import write
    from mirelight.io.job import load
    from mirelight.lighting.profiles import trace
    from mirelight.relight import apply

_HOMES = {
    "load": "mirelight.io.job",
    "composite": "mirelight.compositor",
    "trace": "mirelight.lighting.profiles",
    "apply": "mirelight.relight",
    "write": "mirelight.io.image",
}

__all__ = ["__version__", "apply", "composite", "load", "trace", "write"]


def __getattr__(name: str) -> Any:
    """Import the module behind one of the five calls on first use."""
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'mirelight' has no attribute {name!r}")
