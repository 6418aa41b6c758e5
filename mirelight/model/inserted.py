"""What is put into a capture that was not in it."""

from __future__ import annotations

from dataclasses import dataclass

from mirelight.model.deferred import Deferred
from mirelight.model.scene import ProxyMesh


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inserted:
    """An object: lit by the scene, shadowed, mirrored and mirroring, by glTF's metallic-roughness model."""

    name: str
    mesh: Deferred[ProxyMesh]  # in world space, with its own materials, where the job places it
    drop: bool = False  # it is moved down, or up, until it stands on the proxy
    source: str = ""  # the file that messages name
