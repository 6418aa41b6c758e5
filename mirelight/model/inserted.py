"""What is put into a capture that was not in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Literal

import numpy as np

from mirelight.base import conventions
from mirelight.model.arrays import F64, ArrayHolder, freeze
from mirelight.model.deferred import Deferred
from mirelight.model.digests import digest
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
class Motion(ArrayHolder):
    """How an object goes along: straight on and turning evenly from key to key; before the first and after the last it
    stands still."""

    frames: F64  # (n,) of a camera's path, rising: when it is where `poses` say
    poses: F64  # (n, 4, 4) rigid: takes it there from where its mesh lies

    def __post_init__(self) -> None:
        freeze(self, "frames", (None,), np.float64)
        freeze(self, "poses", (len(self.frames), 4, 4), np.float64)

    def at(self, frame: float) -> F64:
        """(4, 4) rigid: takes the mesh to where it is then."""
        last = len(self.frames) - 1
        place = float(np.interp(frame, self.frames, np.arange(last + 1)))
        return self.poses[0].copy() if last == 0 else np.asarray(conventions.pose_at(self.poses, place))

    def along(self, most: int) -> list[F64]:
        """(4, 4) each: at so many moments of it at most, evenly taken, the first and the last among them."""
        count = min(most, 2 * len(self.frames) - 1)
        return [
            self.at(x) for x in np.interp(np.linspace(0, 1, count), np.linspace(0, 1, len(self.frames)), self.frames)
        ]


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
    motion: Motion | None = None  # None: it stands still
    resting: Inserted | None = None  # of one that :func:`standing` has moved: where its mesh lies without its motion

    def at(self, frame: float) -> Inserted:
        """Where it is at a frame of a camera's path; itself where it stands still."""
        if self.motion is None:
            return self
        pose = self.motion.at(frame)
        return replace(
            self,
            mesh=Deferred(digest("moved", self.mesh.digest, pose), partial(_moved, self.mesh, pose)),
            world_from_object=pose @ self.world_from_object,
            motion=None,
            resting=self,
        )


@lru_cache(maxsize=8)
def standing(objects: tuple[Inserted, ...], frame: float | None) -> tuple[Inserted, ...]:
    """Objects where they are at a frame of a camera's path, None: the first; themselves where all stand still. The same
    ones for the same frame, as long as others do not come between."""
    if not moves(objects):
        return objects
    return tuple(x.at(1.0 if frame is None else frame) for x in objects)


def moves(objects: Sequence[Inserted]) -> bool:
    """Whether one of them has other places at other frames."""
    return any(x.motion is not None for x in objects)


def _moved(mesh: Deferred[ProxyMesh], pose: F64) -> ProxyMesh:
    there, turn = mesh.value, pose[:3, :3]
    return there.turned(turn, there.vertices @ turn.T + pose[:3, 3])
