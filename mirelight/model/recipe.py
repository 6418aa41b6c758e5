"""What a mesh is to be made of, for a job whose proxy is in no file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NoReturn

from mirelight.base.backend import Variant
from mirelight.model.cameras import Camera
from mirelight.model.deferred import Deferred
from mirelight.model.scene import ProxyMesh, SplatCloud


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProxyRecipe:
    """A proxy that is made from a job's splats: `mirelight.proxy.mesh_of` follows it."""

    mesh: Deferred[ProxyMesh]  # without the job's albedo; there once it was made, or supplied from an earlier time
    splats: Deferred[SplatCloud]  # in world space
    cameras: tuple[Camera, ...] = ()  # of the capture's pictures, where they are known
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
