"""What is put into a capture that was not in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from mirelight.model.arrays import F64, ArrayHolder, freeze
from mirelight.model.deferred import Deferred
from mirelight.model.scene import ProxyMesh


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scatter(ArrayHolder):
    """Where an object is put at random, on the ground and where it fits."""

    center: F64  # (3,) world units: of the disc that its foot comes to stand in
    radius: float  # world units
    seed: int
    turn: bool = True  # about the vertical, too

    def __post_init__(self) -> None:
        freeze(self, "center", (3,), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inserted:
    """An object: lit by the scene, shadowed, mirrored and mirroring, by glTF's metallic-roughness model."""

    name: str
    mesh: Deferred[ProxyMesh]  # in world space, with its own materials, where the job places it
    drop: bool | Literal["tilt"] = False  # it is moved down, or up, until it stands on the proxy; "tilt": along it
    scatter: Scatter | None = None  # it is put, and dropped, at a random place instead of where the mesh lies
    source: str = ""  # the file that messages name
    category: str = ""  # what kind of thing it is, for detectors; "": that of its name
    world_from_object: F64 = field(default_factory=lambda: np.eye(4))  # (4, 4): along its axes boxes are laid round it
