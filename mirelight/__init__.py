"""mirelight: offline, physically based relighting of Gaussian-splat captures.

A frame, from the job file to the picture (nothing heavy is imported before it is needed)::

    import mirelight

    job = mirelight.load("room.toml")
    scene = mirelight.prepare(job)
    camera, lighting = job.cameras[0], job.lightings[0]

    splats = mirelight.composite(scene, camera)
    light = mirelight.light(scene, camera, lighting)
    frame = mirelight.relight(scene, splats, light)
    mirelight.write(frame, "frame.exr", job)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mirelight.base.version import __version__

if TYPE_CHECKING:
    from mirelight.io.job import load
    from mirelight.pipeline.scene import prepare
    from mirelight.pipeline.stages import composite, light, relight
    from mirelight.store import write

_HOMES = {
    "load": "mirelight.io.job",
    "prepare": "mirelight.pipeline.scene",
    "composite": "mirelight.pipeline.stages",
    "light": "mirelight.pipeline.stages",
    "relight": "mirelight.pipeline.stages",
    "write": "mirelight.store",
}

__all__ = ["__version__", "composite", "light", "load", "prepare", "relight", "write"]


def __getattr__(name: str) -> Any:
    """Import the module behind one of the calls on first use."""
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """The calls, before they are imported too."""
    return sorted(__all__)
