"""The optional packages: which extra of the installation holds them, and what it unlocks.

What needs one asks for it before it begins, so that nobody waits for a line that says what to install.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal, TypeAlias

from mirelight.base.errors import BackendError

Name: TypeAlias = Literal["compare", "dask", "denoise", "film", "formats", "ocio", "scenes", "usd"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Extra:
    """One extra: `pip install 'mirelight[NAME]'`."""

    name: Name
    packages: tuple[tuple[str, str], ...]  # (module, package that has it)
    unlocks: str
    what: str  # needs it: the start of a sentence
    instead: str = ""  # what else can be done


EXTRAS: tuple[Extra, ...] = (
    Extra(
        name="compare",
        packages=(("flip_evaluator", "flip-evaluator"), ("colour", "colour-science")),
        unlocks="mirelight compare, mirelight explain",
        what="comparing pictures",
    ),
    Extra(
        name="dask",
        packages=(("distributed", "distributed"),),
        unlocks="mirelight render --scheduler",
        what="a scheduler",
        instead="use --workers or --shard",
    ),
    Extra(
        name="denoise",
        packages=(("pyoidn", "pyoidn"),),
        unlocks="render.denoise (Open Image Denoise)",
        what="denoising",
        instead="set render.denoise = false",
    ),
    Extra(
        name="film",
        packages=(("av", "av"),),
        unlocks="mirelight film: .mp4 where ffmpeg is not on the PATH",
        what="writing H.264",
        instead="put ffmpeg on the PATH, or write .gif or .webp",
    ),
    Extra(
        name="formats",
        packages=(("meshopt", "meshopt"),),
        unlocks="glTF files with EXT_meshopt_compression",
        what="meshopt compression",
        instead="export without it (gltfpack without -c, gltf-transform without meshopt)",
    ),
    Extra(
        name="ocio",
        packages=(("PyOpenColorIO", "opencolorio"),),
        unlocks="[display] view (OpenColorIO)",
        what="a view of OpenColorIO",
        instead="leave view out of [display]",
    ),
    Extra(
        name="scenes",
        packages=(("numba", "numba"), ("pyfqmr", "pyfqmr"), ("skimage", "scikit-image"), ("pyoidn", "pyoidn")),
        unlocks="scripts/make_scenes.py, which makes the shipped scenes again",
        what="making the scenes",
    ),
    Extra(
        name="usd",
        packages=(("pxr", "usd-core"),),
        unlocks="OpenUSD stages (.usd, .usda, .usdc, .usdz)",
        what="reading or writing OpenUSD",
    ),
)
_BY_NAME = {extra.name: extra for extra in EXTRAS}


def missing(name: Name, module: str | None = None) -> tuple[str, ...]:
    """Packages of an extra, or of one of its modules, that are not installed. None is imported."""
    return tuple(package for own, package in _BY_NAME[name].packages if module in (None, own) and not _there(own))


def require(name: Name, module: str | None = None) -> None:
    """Make sure of an extra, or of one of its modules, before any work is done; nothing is imported.

    Raises:
        BackendError: a package of it is missing.
    """
    if missing(name, module):
        raise needed(name, module)


def needed(name: Name, module: str | None = None) -> BackendError:
    """The error about an extra, or one of its modules, that is not there or cannot be imported."""
    extra = _BY_NAME[name]
    lacks = missing(name, module) or tuple(package for own, package in extra.packages if module in (None, own))
    return BackendError(f"{extra.what} needs the package {lacks[0]}: {remedy(name)}")


def remedy(name: Name) -> str:
    """What to do about a missing extra."""
    instead = _BY_NAME[name].instead
    return install(name) + (f", or {instead}" if instead else "")


def install(name: Name) -> str:
    """The command that installs an extra."""
    return f"pip install 'mirelight[{name}]'"


def _there(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except (ImportError, ValueError):  # half loaded
        return False
