"""Materials that a job gives to parts of a proxy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.model.arrays import F32, F64
from mirelight.model.cameras import Camera
from mirelight.model.deferred import Deferred
from mirelight.model.scene import Material, ProxyMesh

_INNER = np.concatenate([np.full((1, 3), 1 / 3), 0.2 + 0.4 * np.eye(3)])  # points of a face, by its corners
Box = tuple[tuple[float, float, float], tuple[float, float, float]]  # lowest and highest corner, world units


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mask:
    """What is painted over a camera's picture."""

    camera: Camera
    painted: Deferred[F32]  # (h, w) 0 to 1, more than a half where something is meant; any number of pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class Dress:
    """What a job says of the surface of some faces; None: as the proxy's file has it."""

    name: str | None = None  # of the material that they have in the file; None: any
    box: Box | None = None  # that their middles lie in; None: anywhere
    mask: Mask | None = None  # that they are seen and painted in; None: it is not painted
    metallic: float | None = None
    roughness: float | None = None
    emission: tuple[float, float, float] | None = None  # linear radiance

    def of(self, material: Material) -> Material:
        """A material with what is said in place of the file's values."""
        texture = material.finish_texture
        if texture is not None and not (self.metallic is None and self.roughness is None):
            texture = texture.copy()
            texture[..., 1] = texture[..., 1] if self.roughness is None else 1
            texture[..., 2] = texture[..., 2] if self.metallic is None else 1
        if self.emission is not None:
            material = replace(material, emissive=np.asarray(self.emission), emissive_texture=None)
        return replace(
            material,
            metallic=material.metallic if self.metallic is None else self.metallic,
            roughness=material.roughness if self.roughness is None else self.roughness,
            finish_texture=texture,
        )

    def faces(self, mesh: ProxyMesh, painted: Painted | None = None) -> NDArray[np.bool_]:
        """(F,) which faces are meant; `painted` tells which points are seen in a mask's paint."""
        chosen = np.ones(len(mesh.faces), np.bool_)
        if self.name is None and mesh.mirrors is not None:  # what is said of a room is not said of its mirror
            chosen &= ~mesh.mirrors
        if self.name is not None:
            named = np.array([x.name == self.name for x in mesh.materials])
            chosen &= named[mesh.owners]
        corners = mesh.vertices[mesh.faces]
        if self.mask is not None:
            assert painted is not None
            inner = np.einsum("pc,fck->fpk", _INNER, corners.astype(np.float64))
            seen = painted(self.mask, inner.reshape(-1, 3)).reshape(-1, len(_INNER))
            chosen &= seen.sum(axis=1) >= len(_INNER) / 2  # one may lie behind a crumb of the mesh
        if self.box is not None:
            middles = corners.mean(axis=1)
            chosen &= ((middles >= self.box[0]) & (middles <= self.box[1])).all(axis=1)
        return chosen


Painted: TypeAlias = Callable[[Mask, F64], NDArray[np.bool_]]


def dressed(
    mesh: ProxyMesh, dresses: Sequence[Dress], source: str = "the proxy", painted: Painted | None = None
) -> ProxyMesh:
    """A mesh whose faces have what is said of them; where several speak of a face the last one counts.

    Args:
        mesh: a proxy.
        dresses: what is said.
        source: its file, for messages.
        painted: tells which points (N, 3) are seen in a mask's paint, (N,); needed where there are masks.

    Raises:
        InputError: one speaks of no face of the mesh, whose file is `source`.
    """
    materials = list(mesh.materials)
    owner = mesh.owners.copy()
    for dress in dresses:
        chosen = dress.faces(mesh, painted)
        if not chosen.any():
            names = ", ".join(dict.fromkeys(x.name for x in mesh.materials))
            what = (
                "seen in the paint of its mask"
                if dress.mask is not None
                else "in that box"
                if dress.name is None
                else f"of a material {dress.name!r}" + (dress.box is not None) * " in that box"
            )
            raise InputError(source, f"no faces {what}", f"its materials are {names}"[:300], field="materials")
        for index in np.unique(owner[chosen]):
            owner[chosen & (owner == index)] = len(materials)
            materials.append(dress.of(materials[index]))
    return replace(mesh, materials=tuple(materials), face_materials=owner) if dresses else mesh
