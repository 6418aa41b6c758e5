"""What made a frame: versions, settings, and a fingerprint of everything that decides its pixels."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, fields, is_dataclass, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

import mirelight
from mirelight.model import Job, Provenance

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


def digest(*values: object) -> str:
    """SHA-256 (hex) over values of the model: dataclasses by field, arrays by type, shape and bytes.

    A new field of a type counts without a line being added here. Equal digests mean equal values.

    Raises:
        TypeError: a value of a type that the model does not use.
    """
    sha = hashlib.sha256()
    _feed(sha, values)
    return sha.hexdigest()


def _feed(sha: hashlib._Hash, value: object) -> None:
    if value is None or isinstance(value, str | bool | int | float | Path):
        _atom(sha, type(value).__name__, repr(str(value) if isinstance(value, Path) else value).encode())
    elif isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        _atom(sha, f"array {array.dtype.str} {array.shape}", array.data.cast("B") if array.size else b"")
    elif is_dataclass(value) and not isinstance(value, type):
        names = [f.name for f in fields(value)]
        _atom(sha, "type", type(value).__name__.encode())
        _feed(sha, {name: getattr(value, name) for name in names})
    elif isinstance(value, dict):
        _atom(sha, "dict", str(len(value)).encode())
        for key in sorted(value):
            _feed(sha, key)
            _feed(sha, value[key])
    elif isinstance(value, tuple | list):
        _atom(sha, "list", str(len(value)).encode())
        for item in value:
            _feed(sha, item)
    else:
        raise TypeError(f"no digest for {type(value).__name__}")


def _atom(sha: hashlib._Hash, kind: str, content: bytes | memoryview) -> None:
    """Kind and length go first, so that no two sequences of atoms give the same bytes."""
    sha.update(f"{kind} {len(content)}:".encode())
    sha.update(content)
