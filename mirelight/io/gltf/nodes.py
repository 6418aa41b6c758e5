"""The node hierarchy: where each node of the scene stands in the world (glTF §3.5)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base import conventions
from mirelight.base.errors import printable
from mirelight.io.gltf.accessors import accessor_count, read_accessor
from mirelight.io.gltf.document import Document
from mirelight.io.gltf.fields import Fields

Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """One node of the scene, placed."""

    index: int
    fields: Fields
    parent: int | None  # index of the parent node
    world: Matrix  # (4, 4) world_from_node

    @property
    def name(self) -> str:
        """The node's name, or an empty string."""
        return self.fields.text("name", "")


@dataclass(frozen=True, slots=True)
class Pose:
    """A node's local transform in the parts that animation changes; `matrix` replaces them where it is given."""

    translation: Matrix  # (3,)
    rotation: Matrix  # (4,) xyzw, as in the file
    scale: Matrix  # (3,)
    matrix: Matrix | None = None  # (4, 4)

    def local(self, fields: Fields) -> Matrix:
        """(4, 4) matrix from the node to its parent."""
        if self.matrix is not None:
            return self.matrix
        x, y, z, w = self.rotation
        if not np.linalg.norm(self.rotation) > 1e-8:
            raise fields.fail("rotation", "a quaternion of length zero")
        return conventions.compose(self.translation, conventions.rotation_from_quaternion((w, x, y, z)), self.scale)


def pose_of(fields: Fields) -> Pose:
    """A node's rest pose, from `matrix` or from translation, rotation and scale.

    Raises:
        InputError: a field of the wrong length or not finite.
    """
    matrix = fields.vector("matrix", 16).reshape(4, 4).T.copy() if "matrix" in fields else None
    if matrix is not None and not np.allclose(matrix[3], (0, 0, 0, 1)):
        raise fields.fail("matrix", "its last row is not 0 0 0 1")
    return Pose(
        fields.vector("translation", 3, (0, 0, 0)),
        fields.vector("rotation", 4, (0, 0, 0, 1)),
        fields.vector("scale", 3, (1, 1, 1)),
        matrix,
    )


def place_nodes(document: Document) -> dict[int, Node]:
    """Every node of the default scene by index, parents before children.

    Raises:
        InputError: a node that is missing, its own ancestor, or has two parents.
    """
    placed: dict[int, Node] = {}
    pending: list[tuple[int, int | None, Fields, str]]
    pending = [(i, None, user, name) for i, user, name in reversed(_roots(document))]
    while pending:
        index, parent, user, name = pending.pop()
        fields = document.entry("nodes", index, user, name)
        if index in placed:
            raise user.fail(name, f"nodes[{index}] appears twice in the hierarchy", "the nodes must form trees")
        local = pose_of(fields).local(fields)
        with np.errstate(over="ignore", invalid="ignore"):
            world = local if parent is None else placed[parent].world @ local
        if not np.all(np.isfinite(world)):
            raise fields.fail("", "its world matrix is not finite", "give a smaller scale")
        placed[index] = Node(index, fields, parent, world)
        children = fields.integers("children")
        pending += [(child, index, fields, f"children[{i}]") for i, child in reversed(list(enumerate(children)))]
    return placed


def called(document: Document, node: Node) -> str:
    """What people call a node: by its own name, else by its mesh's, else where it stands in the file."""
    fields = node.fields
    mesh = document.entry("meshes", fields.integer("mesh"), fields, "mesh").text("name", "") if "mesh" in fields else ""
    return printable(node.name) or printable(mesh) or fields.where


def moved_to_origin(nodes: Mapping[int, Node], top: Node) -> dict[int, Node]:
    """All nodes, moved so that one has its origin at the world's; it keeps the turn and the size that it has there.

    A mesh with a skin stands where its joints stand, whatever its own node says (glTF §3.7.3.3): the origin is that of
    what it hangs on.
    """
    there = np.eye(4)
    origin = top if "skin" not in top.fields else None if top.parent is None else nodes[top.parent]
    if origin is not None:
        there[:3, 3] = -origin.world[:3, 3]
    return {i: replace(x, world=there @ x.world) for i, x in nodes.items()}


def below(nodes: Mapping[int, Node], top: Node) -> frozenset[int]:
    """A node, and all that hang on it."""
    found = {top.index}
    for node in nodes.values():  # parents before children
        if node.parent in found:
            found.add(node.index)
    return frozenset(found)


def instance_worlds(document: Document, node: Node) -> Matrix:
    """(N, 4, 4) world matrices of a node's mesh: its own, or one per instance of EXT_mesh_gpu_instancing."""
    instancing = node.fields.extension("EXT_mesh_gpu_instancing")
    if instancing is None:
        return node.world[None]
    attributes = instancing.indices("attributes")
    user = instancing.child("attributes")
    counts = {accessor_count(document, i, user) for i in attributes.values()}
    if len(counts) != 1:
        raise instancing.fail("attributes", f"{len(counts)} different counts", "all must have the same count")
    count = counts.pop()
    if count > _MAX_INSTANCES:
        raise instancing.fail("attributes", f"{count} instances", f"at most {_MAX_INSTANCES} are read")
    parts = {
        name: np.broadcast_to(np.asarray(default, dtype=np.float64), (count, len(default)))
        for name, default in (("TRANSLATION", (0, 0, 0)), ("ROTATION", (0, 0, 0, 1)), ("SCALE", (1, 1, 1)))
    }
    for name in parts.keys() & attributes.keys():
        values = read_accessor(document, attributes[name], user).astype(np.float64)
        if values.shape != parts[name].shape or not np.all(np.isfinite(values)):
            raise user.fail(name, f"values of shape {values.shape}", f"expected finite values {parts[name].shape}")
        parts[name] = values
    if not np.all(np.linalg.norm(parts["ROTATION"], axis=1) > 1e-8):
        raise user.fail("ROTATION", "a quaternion of length zero")
    locals_ = np.zeros((count, 4, 4))
    locals_[:, :3, :3] = conventions.rotation_from_quaternion(parts["ROTATION"][:, [3, 0, 1, 2]])
    locals_[:, :3, :3] *= parts["SCALE"][:, None, :]
    locals_[:, :3, 3], locals_[:, 3, 3] = parts["TRANSLATION"], 1
    with np.errstate(over="ignore", invalid="ignore"):
        worlds = np.asarray(node.world @ locals_)
    if not np.all(np.isfinite(worlds)):
        raise instancing.fail("attributes", "world matrices that are not finite", "give a smaller scale")
    return worlds


_MAX_INSTANCES = 1 << 20


def _roots(document: Document) -> list[tuple[int, Fields, str]]:
    """Root nodes of the default scene, each with who names it; without scenes, all nodes that are nobody's child."""
    top = document.top
    if "scenes" in top or "scene" in top:
        scene = document.entry("scenes", top.integer("scene", 0), top, "scene")
        return [(node, scene, f"nodes[{i}]") for i, node in enumerate(scene.integers("nodes"))]
    nodes = top.children("nodes")
    children = {child for node in nodes for child in node.integers("children")}
    return [(i, top, f"nodes[{i}]") for i in range(len(nodes)) if i not in children]
