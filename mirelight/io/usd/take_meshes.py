"""Meshes of an open stage, in one piece and in our world, with instances and point instancers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.usd.piece import Piece, cut, flat, is_smooth, joined
from mirelight.io.usd.rows import Answer, Request
from mirelight.io.usd.stage import RefusedError, Stage
from mirelight.io.usd.take_materials import Materials

_MOST_VERTICES = 400_000_000  # placed
_NOT_READ = ("Sphere", "Cube", "Cylinder", "Cone", "Capsule", "Plane", "BasisCurves", "NurbsPatch", "TetMesh", "Points")
_IDENTITY = np.eye(4)


@dataclass(slots=True)
class _Carrier:
    """A mesh prim and where it stands."""

    prim: Any
    worlds: list[NDArray[np.float64]]
    name: str
    is_proxy: bool


def mesh(stage: Stage, request: Request) -> Answer:
    """Every mesh that is drawn; where some have the purpose proxy, those alone. Guides are left out."""
    carriers = _carriers(stage)
    if not carriers:
        return Answer()
    _check_size(stage, carriers)
    materials = Materials(stage, request.textures)
    shapes: dict[str, list[Piece]] = {}
    pieces, owners = list[Piece](), list[int]()
    names = list(dict.fromkeys(one.name for one in carriers))
    numbers = {name: number for number, name in enumerate(names)}
    for one in carriers:
        shape = one.prim.GetPrimInPrototype() if one.prim.IsInstanceProxy() else one.prim
        key = str(shape.GetPath())
        if key not in shapes:
            found = cut(stage, one.prim, materials)
            shapes[key] = [] if found is None else [found]
        for piece in shapes[key]:
            placed = [_placed(piece, world, key) for world in one.worlds]
            pieces += placed
            owners += [numbers[one.name]] * len(placed)
    if pieces:
        _save(stage, pieces, owners)
    return Answer(materials=materials.rows, nodes=names if pieces else [])


def remarks(stage: Stage) -> None:
    """Note what of the meshes is not followed, without reading their arrays."""
    materials = Materials(stage, textures=False)
    for one in _carriers(stage):
        materials.of(one.prim)
        is_smooth(stage, one.prim)


def _carriers(stage: Stage) -> list[_Carrier]:
    from pxr import UsdGeom

    carriers: list[_Carrier] = []
    for prim in stage.prims():
        if prim.IsA(UsdGeom.PointInstancer):
            carriers += _instances(stage, prim)
        elif prim.IsA(UsdGeom.Mesh):
            carriers.append(_Carrier(prim, [stage.world(prim)], prim.GetName(), False))
        elif str(prim.GetTypeName()) in _NOT_READ:
            stage.note(f"{prim.GetPath()}: a {prim.GetTypeName()}, which is not read; save it as a mesh")
    return _of_purpose(carriers)


def _of_purpose(carriers: list[_Carrier]) -> list[_Carrier]:
    from pxr import UsdGeom

    kept = list[_Carrier]()
    for one in carriers:
        purpose = str(UsdGeom.Imageable(one.prim).ComputePurpose())
        if purpose != "guide":
            kept.append(replace(one, is_proxy=purpose == "proxy"))
    return [one for one in kept if one.is_proxy] or kept


def _instances(stage: Stage, prim: Any) -> Iterator[_Carrier]:
    """The meshes of a point instancer's prototypes, each with all of its places."""
    from pxr import Usd, UsdGeom

    instancer = UsdGeom.PointInstancer(prim)
    where = str(prim.GetPath())
    which = np.array(instancer.GetProtoIndicesAttr().Get(stage.code) or [], dtype=np.int64)
    roots = instancer.GetPrototypesRel().GetForwardedTargets()
    if not len(which):
        return
    if which.min() < 0 or which.max() >= len(roots):
        raise RefusedError(
            f"protoIndices up to {which.max()}, and {len(roots)} prototypes", "the stage is damaged", where
        )
    include, ignore = UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
    matrices = instancer.ComputeInstanceTransformsAtTime(stage.code, stage.code, include, ignore)
    if matrices is None or len(matrices) != len(which):
        raise RefusedError("positions and protoIndices of other lengths", "the stage is damaged", where)
    places = np.array(matrices, dtype=np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)
    mask = list(instancer.ComputeMaskAtTime(stage.code) or [])
    shown = np.array(mask, dtype=bool) if len(mask) == len(which) else np.ones(len(which), bool)
    own = stage.world(prim)
    cache = UsdGeom.XformCache(stage.code)
    for number, path in enumerate(roots):
        root = stage.stage.GetPrimAtPath(path)
        worlds = [own @ place for place in places[shown & (which == number)]]
        if not root or not worlds:
            continue
        for child in Usd.PrimRange(root, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)):
            if child != prim and child.IsA(UsdGeom.PointInstancer):
                stage.note(f"{child.GetPath()}: a point instancer in another one, which is not followed")
            if child.IsA(UsdGeom.Mesh):
                relative = np.array(cache.ComputeRelativeTransform(child, root)[0], dtype=np.float64).T
                inner = _IDENTITY if child == root else relative
                yield _Carrier(child, [world @ inner for world in worlds], child.GetName(), False)


def _check_size(stage: Stage, carriers: list[_Carrier]) -> None:
    total = 0
    for one in carriers:
        indices = one.prim.GetAttribute("faceVertexIndices").Get(stage.code)
        total += len(one.worlds) * (0 if indices is None else len(indices))
    if total > _MOST_VERTICES:
        raise RefusedError(f"{total:,} corners of faces with all instances", "give a smaller stage")


def _placed(piece: Piece, world: NDArray[np.float64], where: str) -> Piece:
    """The piece in our world; a mirrored one's winding is turned."""
    if np.array_equal(world, _IDENTITY):
        return piece
    linear = world[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        points = (np.einsum("ij,kj->ki", linear, piece.points.astype(np.float64)) + world[:3, 3]).astype(np.float32)
    if not np.isfinite(points).all():
        raise RefusedError("points that are not finite in the world", "repair the mesh", where)
    faces = piece.faces[:, ::-1] if np.linalg.det(linear) < 0 else piece.faces
    normals = piece.normals
    if normals is not None:
        a, b, c = linear
        cofactor = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)]) * (-1 if np.linalg.det(linear) < 0 else 1)
        turned = np.einsum("ij,kj->ki", cofactor, normals.astype(np.float64))
        length = np.linalg.norm(turned, axis=1, keepdims=True)
        normals = (turned / np.where(length > 0, length, 1)).astype(np.float32)
    return replace(piece, points=points, faces=faces, normals=normals)


def _save(stage: Stage, pieces: list[Piece], owners: list[int]) -> None:
    if any(x.normals is not None for x in pieces):
        pieces = [x if x.normals is not None else flat(x) for x in pieces]
    offsets = np.cumsum([0] + [len(x.points) for x in pieces])
    stage.save("vertices", np.concatenate([x.points for x in pieces]))
    faces = [x.faces + at for x, at in zip(pieces, offsets, strict=False)]
    stage.save("faces", np.concatenate(faces).astype(np.int32))
    stage.save("face_materials", np.concatenate([x.materials for x in pieces]).astype(np.int32))
    counts = [len(x.faces) for x in pieces]
    stage.save("face_nodes", np.repeat(np.array(owners, np.int32), counts))
    for name, width, fill in (("normals", 3, 0.0), ("uvs", 2, 0.0), ("colors", 3, 1.0)):
        whole = joined([getattr(x, name) for x in pieces], [len(x.points) for x in pieces], width, fill)
        if whole is not None:
            stage.save(name, whole)
