"""Views of OpenColorIO: from linear Rec.709 to display values; the only place that touches PyOpenColorIO.

A view is named as in the config: "ACES 2.0 - SDR 100 nits (Rec.709)" on "sRGB - Display". The config is a file, a
built-in one ("ocio://…"), what $OCIO names, or the built-in one that OpenColorIO recommends.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mirelight.base import extras
from mirelight.base.errors import InputError
from mirelight.model import F32, DisplaySettings, DisplayView

if TYPE_CHECKING:
    from collections.abc import Iterator

Curve = Callable[[F32], F32]  # (..., 3) light to display values

BUILT_IN = "ocio://"
_DEFAULT = "ocio://default"  # the ACES config that the installed OpenColorIO recommends
# What configs call linear Rec.709; else its place is found by the interchange roles.
_REC709 = ("lin_rec709_scene", "lin_rec709", "Linear Rec.709 (sRGB)", "lin_srgb", "Utility - Linear - sRGB")


def resolve(
    file: str | Path, view: str, *, config: str | None, display: str | None, folder: Path = Path()
) -> DisplayView:
    """A view by its names, checked.

    Args:
        file: whom to name in an error: the job.
        view: as the config calls it.
        config: a file, relative to the folder, or a built-in name; None: $OCIO, or else the built-in ACES config.
        display: as the config calls it; None: its default.
        folder: of the job.

    Raises:
        BackendError: OpenColorIO is not installed.
        InputError: the config cannot be read, or has no such display or view, or no linear Rec.709.
    """
    extras.require("ocio")
    place = config or os.environ.get("OCIO") or _DEFAULT
    if not place.startswith(BUILT_IN):
        place = str(folder / place)
    found = _config(file, place, "display.config" if config else "$OCIO")
    displays = list(found.getDisplays())
    display = display or found.getDefaultDisplay()
    if display not in displays:
        raise _unknown(file, "display", display, displays, "display.display")
    views = list(found.getViews(display))
    if view not in views:
        elsewhere = [x for x in displays if view in found.getViews(x)]
        if elsewhere:
            remedy = f"set display.display to {_listed(elsewhere)}"
            raise InputError(file, f"no view {view[:80]!r} on the display {display!r}", remedy, field="display.view")
        raise _unknown(file, "view", view, views, "display.view")
    with _refused(file, "display.view"):
        identity = _processor(file, found, display, view).getCacheID()
    return DisplayView(config=place, display=display, view=view, identity=identity)


def located(view: DisplayView, picture: Path) -> DisplayView:
    """The view that a picture names, with its config's path: headers hold a config's name alone. The file is what $OCIO
    names, or lies beside the picture or in the folder above.

    Raises:
        BackendError: OpenColorIO is not installed.
        InputError: there is none of that name that computes the same.
    """
    if view.config.startswith(BUILT_IN):
        return view
    extras.require("ocio")
    name = view.config_name
    places = [Path(os.environ.get("OCIO", "")), picture.absolute().parent / name, picture.absolute().parents[1] / name]
    for place in places:
        if place.name == name and place.is_file():
            with suppress(InputError):
                found = resolve(picture, view.view, config=str(place.absolute()), display=view.display)
                if found.identity == view.identity:
                    return found
    remedy = "set OCIO to that config, or put it beside the picture"
    raise InputError(picture, f"shown by a view of {name!r}, which is not found as it was", remedy)


def curve_of(settings: DisplaySettings) -> Curve | None:
    """What turns linear Rec.709 into display values; None: the settings name no view, so tone and transfer curve do.

    Raises:
        BackendError: OpenColorIO is not installed.
        InputError: its config is not there any more.
    """
    return None if settings.view is None else _curve(settings.view)


@lru_cache(maxsize=4)
def _curve(view: DisplayView) -> Curve:
    extras.require("ocio")
    with _refused(view.config, "display.view"):
        processor = _processor(view.config, _config(view.config, view.config, ""), view.display, view.view)
        cpu = processor.getDefaultCPUProcessor()

    def shown(light: F32) -> F32:
        out = np.array(light, dtype=np.float32, order="C")  # it is turned in place
        np.nan_to_num(out, copy=False, nan=0.0, posinf=65504.0, neginf=0.0)
        cpu.applyRGB(out.reshape(-1, 3))
        return out

    return shown


@lru_cache(maxsize=4)
def _read(place: str, changed: int) -> Any:
    import PyOpenColorIO

    return PyOpenColorIO.Config.CreateFromFile(place)


def _config(file: str | Path, place: str, field: str) -> Any:
    if not place.startswith(BUILT_IN) and not Path(place).is_file():
        raise InputError(file, f"no OpenColorIO config {Path(place).name!r}", "check the path", field=field)
    with _refused(file, field):
        changed = 0 if place.startswith(BUILT_IN) else Path(place).stat().st_mtime_ns
        return _read(place, changed)


def _processor(file: str | Path, config: Any, display: str, view: str) -> Any:
    """From linear Rec.709 to a view."""
    import PyOpenColorIO

    source = next((name for name in _REC709 if config.getColorSpace(name) is not None), None)
    if source is None:
        try:
            source = PyOpenColorIO.Config.IdentifyBuiltinColorSpace(
                config, PyOpenColorIO.Config.CreateFromBuiltinConfig("cg-config-latest"), "Linear Rec.709 (sRGB)"
            )
        except PyOpenColorIO.Exception:
            remedy = 'give its linear Rec.709 space the alias "lin_rec709", or use a built-in config'
            raise InputError(
                file, "an OpenColorIO config without linear Rec.709", remedy, field="display.config"
            ) from None
    transform = PyOpenColorIO.DisplayViewTransform(src=source, display=display, view=view)
    return config.getProcessor(transform)


@contextmanager
def _refused(file: str | Path, field: str) -> Iterator[None]:
    """What the library cannot do, as one line."""
    import PyOpenColorIO

    try:
        yield
    except (PyOpenColorIO.Exception, OSError) as e:
        said = " ".join(str(e).split())[:200]
        remedy = "check the config, e.g. with ociocheck"
        raise InputError(file, f"OpenColorIO refuses it: {said}", remedy, field=field) from None


def _unknown(file: str | Path, what: str, name: str, known: Sequence[str], field: str) -> InputError:
    near = get_close_matches(name, known, n=3, cutoff=0.4) or list(known)[:6]
    return InputError(
        file, f"no {what} {name[:80]!r} in the OpenColorIO config", f"there is {_listed(near)}", field=field
    )


def _listed(names: Sequence[str]) -> str:
    return ", ".join(repr(x) for x in names[:-1]) + (" or " if len(names) > 1 else "") + repr(names[-1])
