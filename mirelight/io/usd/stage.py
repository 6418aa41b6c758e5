"""A stage, opened in the child process: what it may read, where its prims stand, and their pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.usd.rows import Rows4

_MOST_PRIMS = 300_000  # with those in instances, once for each place
_MOST_FILES = 10_000
_LAYERS = (".usd", ".usda", ".usdc", ".usdz")
_PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".exr", ".hdr", ".ies")


class RefusedError(Exception):
    """A stage that cannot be used, with the prim."""

    def __init__(self, found: str, remedy: str = "", prim: str = "") -> None:
        super().__init__(found)
        self.found, self.remedy, self.prim = found, remedy, prim


@dataclass(slots=True)
class Stage:
    """An open stage and where to put what is taken from it."""

    stage: Any  # Usd.Stage
    code: Any  # Usd.TimeCode
    folder: Path  # for arrays and pictures
    base: Path  # the stage's own folder, resolved
    files: set[Path]  # that the stage is read from
    turn: NDArray[np.float64]  # (4, 4) our world from the stage's: metres, Y up
    notes: dict[str, None] = field(default_factory=dict)
    _worlds: Any = None
    _copied: dict[str, str] = field(default_factory=dict)

    @property
    def rate(self) -> float:
        """How many time codes a second has."""
        return float(self.stage.GetTimeCodesPerSecond()) or 24.0

    @property
    def unit(self) -> float:
        """Metres of one unit of the stage."""
        return float(np.linalg.norm(self.turn[:3, 0]))

    def at(self, seconds: float | None) -> Any:
        """The time code of a moment; None: the defaults."""
        return _code(self.stage, seconds)

    def prims(self) -> Iterator[Any]:
        """Every prim that is defined, active and visible, with those in instances, once for each place.

        Prims below a point instancer are its prototypes and are left to it.
        """
        from pxr import Usd, UsdGeom

        count = 0
        prims = iter(Usd.PrimRange.Stage(self.stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)))
        for prim in prims:
            count += 1
            if count > _MOST_PRIMS:
                raise RefusedError(f"more than {_MOST_PRIMS:,} prims", "give a smaller stage")
            if prim.IsA(UsdGeom.Imageable):
                image = UsdGeom.Imageable(prim)
                seen = image.GetVisibilityAttr().Get(self.code)
                if seen == "invisible":
                    prims.PruneChildren()
                    continue
            if prim.IsA(UsdGeom.PointInstancer):
                prims.PruneChildren()
            yield prim

    def world(self, prim: Any, code: Any = None) -> NDArray[np.float64]:
        """(4, 4) our world from a prim's own space, acting on columns."""
        from pxr import UsdGeom

        if code is not None:
            found = UsdGeom.XformCache(code).GetLocalToWorldTransform(prim)
        else:
            if self._worlds is None:
                self._worlds = UsdGeom.XformCache(self.code)
            found = self._worlds.GetLocalToWorldTransform(prim)
        own = np.array(found, dtype=np.float64).T
        if not np.isfinite(own).all():
            raise RefusedError("a transform that is not finite", "repair it", str(prim.GetPath()))
        return own if np.array_equal(self.turn, np.eye(4)) else self.turn @ own

    def save(self, name: str, array: NDArray[Any]) -> None:
        """Hand an array of any shape over."""
        np.save(self.folder / f"{name}.npy", np.ascontiguousarray(array), allow_pickle=False)

    def note(self, line: str) -> None:
        """A line on what is not followed, said once."""
        self.notes[line] = None

    def asset(self, value: Any, prim: Any) -> str:
        """Copy a picture or profile into the answer's folder; its name there, "" where none is named.

        Raises:
            RefusedError: it is missing, or of no kind that is read.
        """
        from pxr import Ar

        if value is None or not str(value.path):
            return ""
        where = str(prim.GetPath())
        resolved = str(value.resolvedPath)
        if not resolved:
            raise RefusedError(f"there is no file {_shown(value.path)}", "the stage is incomplete", where)
        if resolved in self._copied:
            return self._copied[resolved]
        self.files.add(_reached(resolved, self.base, value.path, where, self.notes))
        suffix = Path(resolved.rstrip("]")).suffix.lower()
        if suffix not in _PICTURES:
            found = f"{_shown(value.path)} is of no kind that is read"
            raise RefusedError(found, "read are PNG, JPEG, WebP, OpenEXR, Radiance HDR and IES", where)
        asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(resolved))
        data = None if asset is None else asset.GetBuffer()
        if data is None:
            raise RefusedError(f"{_shown(value.path)} cannot be read", "check the file", where)
        name = f"asset{len(self._copied)}{suffix}"
        (self.folder / name).write_bytes(bytes(data))
        self._copied[resolved] = name
        return name


def open_stage(path: Path, folder: Path, seconds: float | None) -> Stage:
    """Open a stage, after every file that it names was looked up.

    Raises:
        RefusedError: no stage, or one that names files outside of its folder which are no layers and no pictures.
    """
    from pxr import Sdf, Usd, UsdGeom

    base = path.parent.resolve()
    notes: dict[str, None] = {}
    files = _named(path.resolve(), base, notes)
    layer = Sdf.Layer.FindOrOpen(str(path.resolve()))
    stage = None if layer is None else Usd.Stage.Open(layer)
    if stage is None:
        raise RefusedError("not a USD stage", "give a .usd, .usda, .usdc or .usdz file")
    unit = float(UsdGeom.GetStageMetersPerUnit(stage))
    if not 1e-12 < unit < 1e12:
        raise RefusedError(f"metersPerUnit is {unit:g}", "expected a length in metres")
    turn = np.diag([unit, unit, unit, 1.0])
    if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z:
        turn = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]]) @ turn
    return Stage(stage, _code(stage, seconds), folder, base, files, turn, notes)


def _code(stage: Any, seconds: float | None) -> Any:
    from pxr import Usd

    if seconds is None:  # a value with keys and no default has its first key's
        return (
            Usd.TimeCode(stage.GetStartTimeCode()) if stage.HasAuthoredTimeCodeRange() else Usd.TimeCode.EarliestTime()
        )
    return Usd.TimeCode(seconds * (stage.GetTimeCodesPerSecond() or 24.0))


def _named(path: Path, base: Path, notes: dict[str, None]) -> set[Path]:
    """All files that a layer leads to, itself too, before any is composed; what lies elsewhere is noted."""
    from pxr import Sdf, UsdUtils

    seen: set[Path] = set()
    pending = [path]
    while pending:
        at = pending.pop()
        if at in seen:
            continue
        if len(seen) == _MOST_FILES:
            raise RefusedError(f"more than {_MOST_FILES:,} files", "give a smaller stage")
        seen.add(at)
        if at.suffix.lower() not in _LAYERS:
            continue  # a picture, or what the library cannot compose
        layer = Sdf.Layer.FindOrOpen(str(at))
        if layer is None:
            if at == path:
                raise RefusedError("not a USD stage", "the file is damaged, or of another kind")
            continue  # the library says so where it composes
        for name in (x for found in UsdUtils.ExtractExternalReferences(str(at)) for x in found):
            if not name or "<UDIM>" in name:
                continue
            target = str(at.parent / layer.ComputeAbsolutePath(name))  # a bare name comes back as it is
            if "[" not in target or not target.startswith(str(at)):  # else in the same package
                file = _reached(target, base, name, "", notes)
                if file.is_file():
                    pending.append(file)
    return seen


def _reached(target: str, base: Path, name: str, prim: str, notes: dict[str, None]) -> Path:
    """The file of an absolute path; of a file in a package, the package. One that is not in the stage's folder or
    below, as published assets are, is noted, and has to be a plain file of a kind that is read."""
    file = Path(target.partition("[")[0])
    try:
        file = file.resolve()
    except (OSError, RuntimeError, ValueError):
        raise RefusedError(f"{_shown(name)} cannot be followed", "the stage is damaged", prim) from None
    if file.is_relative_to(base):
        return file
    if file.suffix.lower() not in (*_LAYERS, *_PICTURES):
        found = f"it names {_shown(name)}, outside of its folder and of no kind that is read"
        raise RefusedError(found, "take it out of the stage", prim)
    if not file.is_file():
        raise RefusedError(f"there is no file {_shown(name)}", "the stage is incomplete", prim)
    notes[f"it is read from outside of its folder, too: {file}"] = None
    return file


def rows(matrix: NDArray[np.float64]) -> Rows4:
    """A matrix (4, 4) for JSON."""
    return [[float(x) for x in row] for row in matrix]


def _shown(name: Any) -> str:
    text = str(name)
    return repr(text if len(text) <= 60 else text[:57] + "...")
