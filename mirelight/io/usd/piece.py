"""One mesh prim as triangles: corners of their own where a value differs from face to face."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.usd.stage import RefusedError, Stage

if TYPE_CHECKING:
    from mirelight.io.usd.take_materials import Materials

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Piece:
    """Triangles in the prim's own space."""

    points: Floats  # (V, 3)
    faces: Ints  # (F, 3)
    materials: Ints  # (F,)
    normals: Floats | None = None
    uvs: Floats | None = None
    colors: Floats | None = None


@dataclass(frozen=True, slots=True)
class _Faces:
    """How triangles are cut out of a mesh's faces."""

    corners: Ints  # (F, 3) places in faceVertexIndices
    face: Ints  # (F,) which face each is of
    indices: Ints  # faceVertexIndices
    points: int


def cut(stage: Stage, prim: Any, materials: Materials) -> Piece | None:
    """The triangles of a mesh; None where it has none. Raises RefusedError: arrays that do not fit."""
    from pxr import UsdGeom

    mesh = UsdGeom.Mesh(prim)
    where = str(prim.GetPath())
    points = np.array(mesh.GetPointsAttr().Get(stage.code) or [], dtype=np.float32).reshape(-1, 3)
    faces = _faces(stage, mesh, len(points), where)
    if not len(faces.corners):
        return None
    if not np.isfinite(points).all():
        raise RefusedError("points that are NaN or infinite", "repair the mesh", where)
    bound = materials.of(prim)
    parts = {"uvs": _primvar(stage, prim, materials.uv_name(bound), faces, 2)}
    colours = materials.colour_name(bound)
    parts["colors"] = None if colours is None else _primvar(stage, prim, colours, faces, 3)
    parts["normals"] = None if is_smooth(stage, prim) else _normals(stage, mesh, faces)
    if mesh.GetOrientationAttr().Get() == "leftHanded":
        faces = replace(faces, corners=faces.corners[:, ::-1])
    own = materials.of_faces(prim, bound)[faces.face] if len(faces.face) else np.zeros(0, np.int64)
    # A value is by corner (F, 3, n) or by point (V, n).
    if any(x is not None and x.ndim == 3 for x in parts.values()):
        at = faces.indices[faces.corners]
        whole = {name: None if x is None else (x if x.ndim == 3 else x[at]) for name, x in parts.items()}
        if mesh.GetOrientationAttr().Get() == "leftHanded":
            whole = {name: x if x is None or parts[name].ndim == 2 else x[:, ::-1] for name, x in whole.items()}  # type: ignore[union-attr]
        own_corners = np.arange(at.size).reshape(-1, 3)
        flatten = {name: None if x is None else x.reshape(-1, x.shape[-1]) for name, x in whole.items()}
        return Piece(points[at.reshape(-1)], own_corners, own, **flatten)
    return Piece(points, faces.indices[faces.corners], own, **parts)


def is_smooth(stage: Stage, prim: Any) -> bool:
    """Whether a mesh is a subdivision surface, which is noted."""
    from pxr import UsdGeom

    smooth = UsdGeom.Mesh(prim).GetSubdivisionSchemeAttr().Get() not in ("none", None)
    if smooth:
        stage.note(f"{prim.GetPath()}: a subdivision surface, of which the cage is taken")
    return smooth


def _faces(stage: Stage, mesh: Any, points: int, where: str) -> _Faces:
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(stage.code) or [], dtype=np.int64)
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get(stage.code) or [], dtype=np.int64)
    if (len(counts) and counts.min() < 0) or counts.sum() != len(indices):
        raise RefusedError(
            f"faceVertexCounts add up to {counts.sum():,}, faceVertexIndices are {len(indices):,}", "", where
        )
    if len(indices) and not 0 <= indices.min() <= indices.max() < points:
        raise RefusedError(f"faceVertexIndices outside of the {points:,} points", "the stage is damaged", where)
    starts = np.cumsum(counts) - counts
    holes = mesh.GetHoleIndicesAttr().Get(stage.code)
    triangles = np.maximum(counts - 2, 0)
    if holes is not None and len(holes):
        some = np.array(holes, dtype=np.int64)
        triangles[some[(some >= 0) & (some < len(triangles))]] = 0
    face = np.repeat(np.arange(len(counts)), triangles)
    within = np.arange(len(face)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    first = starts[face]
    corners = np.stack([first, first + within + 1, first + within + 2], axis=1) if len(face) else np.zeros((0, 3), int)
    return _Faces(corners, face, indices, points)


def _normals(stage: Stage, mesh: Any, faces: _Faces) -> Floats | None:
    found = _primvar(stage, mesh.GetPrim(), "normals", faces, 3)
    if found is not None:
        return found
    value = mesh.GetNormalsAttr().Get(stage.code)
    return None if value is None else _spread(np.array(value), str(mesh.GetNormalsInterpolation()), faces, 3)


def _primvar(stage: Stage, prim: Any, name: str, faces: _Faces, width: int) -> Floats | None:
    """(V, width) by point or (F, 3, width) by corner; None where there is none, or of another length."""
    from pxr import UsdGeom

    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    if not primvar or not primvar.HasValue():
        return None
    value = primvar.ComputeFlattened(stage.code)
    return None if value is None else _spread(np.array(value), str(primvar.GetInterpolation()), faces, width)


def _spread(value: NDArray[Any], interpolation: str, faces: _Faces, width: int) -> Floats | None:
    if value.ndim != 2 or value.shape[1] < width or value.dtype.kind != "f" or not np.isfinite(value).all():
        return None
    values = np.asarray(value[:, :width], dtype=np.float32)
    if interpolation in ("vertex", "varying") and len(values) == faces.points:
        return values
    if interpolation == "constant" and len(values):
        return np.repeat(values[:1], faces.points, axis=0)
    if interpolation == "faceVarying" and len(values) == len(faces.indices):
        return np.asarray(values[faces.corners])
    if interpolation == "uniform" and len(faces.face) and len(values) > int(faces.face.max()):
        return np.repeat(values[faces.face][:, None], 3, axis=1)
    return None


def flat(piece: Piece) -> Piece:
    """The piece with three points of its own for each face, and the face's normal on them."""
    at = piece.faces.reshape(-1)
    a, b, c = piece.points[piece.faces].astype(np.float64).transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    unit = np.where(length > 0, across / np.where(length > 0, length, 1), (0.0, 1.0, 0.0))
    return replace(
        piece,
        points=piece.points[at],
        faces=np.arange(len(at)).reshape(-1, 3),
        normals=np.repeat(unit, 3, axis=0).astype(np.float32),
        uvs=None if piece.uvs is None else piece.uvs[at],
        colors=None if piece.colors is None else piece.colors[at],
    )


def joined(parts: list[Floats | None], counts: list[int], width: int, fill: float) -> Floats | None:
    """Values of all pieces; those that have none are filled; None where nobody has any."""
    if all(x is None for x in parts):
        return None
    blanks = [np.full((count, width), fill, np.float32) for count in counts]
    return np.concatenate([blank if x is None else x for x, blank in zip(parts, blanks, strict=True)])
