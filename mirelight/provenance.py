"""What made a frame: versions, settings, and a fingerprint of everything that decides its pixels."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import mirelight
from mirelight.model import Job, Provenance, digest

__all__ = ["digest", "of_frame", "pixel_settings", "versions"]

_PACKAGES = ("mitsuba", "drjit", "numpy")


@cache
def versions() -> dict[str, str]:
    """Installed versions of the packages that decide pixels, read without importing them."""
    found = {"mirelight": mirelight.__version__}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def pixel_settings(job: Job) -> dict[str, Any]:
    """The job's settings that shape pixels or decide what a frame's files hold, as JSON values by section.

    Left out, because the same pixels come out of every value: threads, the memory limit, the output folder.
    """
    output = asdict(job.output)
    del output["directory"]
    compositor = asdict(replace(job.compositor, max_memory=None))
    render = asdict(replace(job.render, threads=None))
    del compositor["max_memory"], render["threads"]
    return {
        "render": render,
        "compositor": compositor,
        "proxy": {"albedo_from_splats": job.colors_proxy},
        "relight": asdict(job.relight),
        "display": asdict(job.display),
        "output": output,
    }


def of_frame(job: Job, lighting: str, fingerprint: str) -> Provenance:
    """The provenance of one frame of a job."""
    return Provenance(
        mirelight=mirelight.__version__,
        versions={k: v for k, v in versions().items() if k != "mirelight"},
        job=job.source.name,
        inputs=dict(job.inputs),
        settings=pixel_settings(job),
        lighting=lighting,
        fingerprint=fingerprint,
    )
