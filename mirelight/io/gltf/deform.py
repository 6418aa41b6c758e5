"""Morph targets and skins in their rest pose: the shape before any animation plays (glTF §3.7.2 and §3.7.3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.io.gltf.accessors import read_accessor
from mirelight.io.gltf.document import Document
from mirelight.io.gltf.fields import Fields
from mirelight.io.gltf.geometry import Piece
from mirelight.io.gltf.nodes import Matrix, Node
from mirelight.model import F32, F64


def morphed(piece: Piece, mesh: Fields, node: Node) -> Piece:
    """The piece with its morph targets added by the node's weights, else the mesh's, else not at all.

    Raises:
        InputError: another number of weights than targets, or weights that overflow.
    """
    owner = node.fields if "weights" in node.fields else mesh
    if not piece.targets or "weights" not in owner:
        return piece
    weights = owner.vector("weights", len(piece.targets))
    positions = _summed(piece.positions, [t[0] for t in piece.targets], weights)
    normals = None if piece.normals is None else _summed(piece.normals, [t[1] for t in piece.targets], weights)
    if not np.all(np.isfinite(positions)) or (normals is not None and not np.all(np.isfinite(normals))):
        largest = float(np.abs(weights).max())
        raise owner.fail("weights", f"weights up to {largest:g} move vertices to infinity", "give smaller weights")
    return replace(piece, positions=positions, normals=normals)


def _summed(base: F32, offsets: list[F32 | None], weights: F64) -> F32:
    out = base.astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        for offset, weight in zip(offsets, weights, strict=True):
            if offset is not None and weight != 0:
                out += weight * offset
        return out.astype(np.float32)


def joint_matrices(document: Document, nodes: dict[int, Node], node: Node) -> Matrix | None:
    """(J, 4, 4) world_from_bind matrices of a node's skin, or None without one.

    A skinned mesh stands where its joints are; its own node's transform does not count (glTF §3.7.3.3).

    Raises:
        InputError: joints outside the scene, or fewer inverse bind matrices than joints.
    """
    if "skin" not in node.fields:
        return None
    skin = document.entry("skins", node.fields.integer("skin"), node.fields, "skin")
    joints = skin.integers("joints")
    missing = [joint for joint in joints if joint not in nodes]
    if missing or not joints:
        raise skin.fail("joints", f"node {missing[0]} is not in the scene" if missing else "no joints")
    worlds = np.stack([nodes[joint].world for joint in joints])
    if "inverseBindMatrices" not in skin:
        return worlds
    inverse = read_accessor(document, skin.integer("inverseBindMatrices"), skin).astype(np.float64)
    if inverse.shape[1] != 16 or len(inverse) < len(joints) or not np.all(np.isfinite(inverse)):
        raise skin.fail("inverseBindMatrices", f"shape {inverse.shape}", "expected one finite MAT4 per joint")
    return np.asarray(worlds @ inverse[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1))


def vertex_matrices(piece: Piece, joints: Matrix) -> Matrix:
    """(V, 4, 4) linear blend skinning matrices; weights are made to sum to 1.

    Raises:
        InputError: a joint index outside the skin, or vertices without weights.
    """
    if piece.joints is None or piece.weights is None or piece.joints.shape != piece.weights.shape:
        raise piece.fields.fail("attributes", "a skin without matching JOINTS_0 and WEIGHTS_0", "apply the skin")
    used = piece.weights > 0
    if int(piece.joints.max(where=used, initial=0)) >= len(joints):
        raise piece.fields.fail("attributes.JOINTS_0", f"a joint beyond the skin's {len(joints)}")
    total = piece.weights.sum(axis=1)
    if not bool(np.all(total > 0)):
        raise piece.fields.fail("attributes.WEIGHTS_0", "vertices whose weights sum to zero", "apply the skin")
    out = np.zeros((len(piece.positions), 4, 4))
    for joint, weight in zip(piece.joints.T, (piece.weights / total[:, None]).T, strict=True):
        out += weight[:, None, None] * joints[np.where(weight > 0, joint, 0)]
    return out
