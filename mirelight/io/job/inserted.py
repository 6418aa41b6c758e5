"""From a job's table of an object to the model's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.base.names import FreeNames
from mirelight.io.job import placing
from mirelight.io.job.scene_tables import KeyTable, ObjectTable, ScatterTable, Transform
from mirelight.model import Deferred, Inserted, Material, ProxyMesh, Scatter, digest
from mirelight.model.inserted import Motion


@dataclass(frozen=True, slots=True)
class _Look:
    """What a job says of an object's surface; None: as its file has it."""

    base_color: tuple[float, ...] | None
    metallic: float | None
    roughness: float | None

    def of(self, material: Material) -> Material:
        """A material with what the job sets in place of the file's values."""
        if self.base_color is not None:
            material = replace(material, base_color=np.asarray(self.base_color), base_color_texture=None)
        texture = None if material.finish_texture is None else material.finish_texture.copy()
        if self.roughness is not None:
            material = replace(material, roughness=self.roughness)
        if self.metallic is not None:
            material = replace(material, metallic=self.metallic)
        if texture is not None:
            texture[..., 1] = texture[..., 1] if self.roughness is None else 1
            texture[..., 2] = texture[..., 2] if self.metallic is None else 1
        return replace(material, finish_texture=texture)


def of_table(table: ObjectTable, path: Path, sha256: str) -> Inserted:
    """An object in world space, before it is dropped; its file, of that digest, is read when it is needed."""
    m = placing.matrix(table.transform)
    motion = None if table.keys is None else _motion(table.keys, m)
    base = None if table.base_color is None else tuple(table.base_color)
    look = _Look(base, table.metallic, table.roughness)
    known = digest("object", sha256, m, look, *([] if table.node is None else [table.node]))
    name = table.name or table.node or path.stem
    return Inserted(
        name=name,
        mesh=Deferred(known, partial(_mesh, path, table.node, m, look)),
        drop=table.drop,
        scatter=None if table.scatter is None else _scatter(table.scatter),
        source=str(path),
        category=table.category or name,
        world_from_object=m,
        motion=motion,
    )


def _motion(keys: Sequence[KeyTable], m: Matrix) -> Motion:
    """Of an object that its transform puts where `m` says."""
    first = conventions.rigid_part(m)
    back = np.linalg.inv(first)
    poses = []
    for one in keys:
        turned = one.rotation_euler is not None or one.rotation_quaternion is not None
        own = Transform(rotation_euler=one.rotation_euler, rotation_quaternion=one.rotation_quaternion)
        turn = placing.matrix(own)[:3, :3] if turned else first[:3, :3]
        place = first[:3, 3] if one.translation is None else np.asarray(one.translation)
        poses.append(conventions.compose(place, turn) @ back)
    return Motion(frames=np.array([x.frame for x in keys], np.float64), poses=np.stack(poses))


def _scatter(table: ScatterTable) -> Scatter:
    return Scatter(center=np.asarray(table.center), radius=table.radius, seed=table.seed, turn=table.turn)


def named_apart(objects: Sequence[Inserted]) -> tuple[Inserted, ...]:
    """Objects, of which a later one of the same name has a number behind it."""
    names = FreeNames(separator=" ")
    return tuple(replace(one, name=names.take(one.name)) for one in objects)


def _mesh(path: Path, node: str | None, m: Matrix, look: _Look) -> ProxyMesh:
    from mirelight.io import mesh

    found = mesh.transform(mesh.read_mesh(path, finish=True, node=node), m)
    colors = found.vertex_colors if look.base_color is None else None
    return replace(found, albedo=None, vertex_colors=colors, materials=tuple(look.of(x) for x in found.materials))
