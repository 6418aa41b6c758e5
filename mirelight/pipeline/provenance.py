"""What made a frame: versions and settings, written into every file."""

from __future__ import annotations

from dataclasses import asdict
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from mirelight.base.version import __version__
from mirelight.model import DisplaySettings, Job, Provenance

_PACKAGES = ("mitsuba", "drjit", "numpy", "scipy", "OpenEXR", "pyoidn")


@cache
def versions() -> dict[str, str]:
    """Versions of what decides pixels and files: packages, read without importing them, and libLLVM."""
    from mirelight.base import backend

    found = {"mirelight": __version__}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    library = backend.choose()
    if library is not None and library.version is not None:
        found["llvm"] = ".".join(map(str, library.version))
    return found


def pixel_settings(job: Job) -> dict[str, Any]:
    """The job's settings, as JSON values by section, for a person who wonders how a file came to be.

    Left out, because the same pixels come out of every value: threads, the memory limits, the output folder.
    """
    every = {
        "render": asdict(job.render),
        "compositor": asdict(job.compositor),
        "proxy": {"albedo_from_splats": job.albedo_from_splats},
        "relight": asdict(job.relight),
        "display": _display(job.display),
        "output": asdict(job.output),
    }
    del every["output"]["directory"], every["compositor"]["max_memory"]
    del every["render"]["max_memory"], every["render"]["threads"]
    return every


def _display(settings: DisplaySettings) -> dict[str, Any]:
    """As JSON values; of a config's path the name: what the view computes is told by its identity."""
    found = asdict(settings)
    if settings.view is not None:
        found["view"]["config"] = settings.view.config_name
    return found


def of_frame(job: Job, lighting: str, fingerprint: str) -> Provenance:
    """The provenance of one frame of a job."""
    return Provenance(
        mirelight=__version__,
        versions={k: v for k, v in versions().items() if k != "mirelight"},
        job=job.source.name,
        inputs=dict(job.inputs),
        settings=pixel_settings(job),
        lighting=lighting,
        fingerprint=fingerprint,
    )
