"""What a mesh is to be made of, for a job whose proxy is in no file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from mirelight.base.backend import Variant
from mirelight.model.arrays import F64
from mirelight.model.cameras import Camera
from mirelight.model.deferred import Deferred
from mirelight.model.scene import ProxyMesh, SplatCloud


@dataclass(frozen=True, slots=True, eq=False)
class OwnSplats:
    """A capture in the axes of its file: what is found in those holds wherever a job places it."""

    splats: Deferred[SplatCloud]
    world_from_own: F64  # (4, 4) similarity

    @staticmethod
    def of_world(splats: Deferred[SplatCloud]) -> OwnSplats:
        """Splats of several files, or of none: the world's axes are their own."""
        return OwnSplats(splats, np.eye(4))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProxyRecipe:
    """A proxy that is made from a job's splats: `mirelight.proxy.mesh_of` follows it."""

    mesh: Deferred[ProxyMesh]  # without the job's albedo; there once it was made, or supplied from an earlier time
    splats: Deferred[SplatCloud]  # in world space
    cameras: tuple[Camera, ...] = ()  # of the capture's pictures, where they are known
    ceiling: bool = True  # whether one is guessed in a room whose pictures end below it
    variant: Variant = "llvm_ad_rgb"
    threads: int | None = None
    source: str = ""  # the file that messages name

    @property
    def digest(self) -> str:
        """SHA-256 (hex) over all that decides the mesh."""
        return self.mesh.digest


def not_made_yet() -> NoReturn:
    """Stands where a file would be read."""
    raise RuntimeError("the proxy is made from the splats: take Scene.mesh, or mirelight.proxy.mesh_of(job)")
