"""Objects of a first job: set down where the first picture looks, on free ground, in a size that shows."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

import numpy as np

from mirelight.apps.first_job import view
from mirelight.apps.first_job.free_ground import OVER, FreeGround
from mirelight.apps.first_job.toml_text import Names, position
from mirelight.base.errors import printable
from mirelight.io import mesh
from mirelight.io.gltf.document import read_document
from mirelight.io.gltf.scene import name_groups
from mirelight.io.suffixes import GLTF
from mirelight.model import F64, I32, ProxyMesh, shown

_LEAST = 0.02  # of how far away it is: the size of an object that is kept as its file has it
_MOST = 0.25  # and at most so much, as few captures are in metres
_MOST_IN_ROOM = 0.5  # where what is looked at is nearer
_SIZES = (0.15, 0.1, 0.07)  # of any other: the first that finds free ground
_WIDEST = 1.0  # and at most so much for a file of several things
_NEARER = 0.25  # of the way from what the picture looks at to the camera
_APART = 0.25  # of that way, from one to the next
_JOINED = 0.01  # of a file's size: parts that are so near each other are one thing


@dataclass(frozen=True, slots=True, eq=False)
class _Thing:
    """Parts of a file that touch each other, by their boxes."""

    name: str  # of its largest part, or of what all of them hang on
    parts: frozenset[str]  # names of them
    low: F64  # (3,)
    high: F64  # (3,)

    @property
    def size(self) -> float:
        """Its longest side."""
        return float((self.high - self.low).max())

    def near(self, other: _Thing, gap: float) -> bool:
        """Whether both are one."""
        return bool(np.all(self.low - gap <= other.high) and np.all(other.low - gap <= self.high))

    def joined(self, other: _Thing) -> _Thing:
        """Both as one."""
        name = max(self, other, key=lambda x: x.size).name
        low, high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
        return _Thing(name, self.parts | other.parts, low, high)


@dataclass(frozen=True, slots=True)
class MeshFile:
    """A mesh that is put into a capture."""

    path: Path
    node: str | None  # that is put there alone; None: all
    things: tuple[_Thing, ...]  # that it holds, the largest first; its whole box is theirs

    @staticmethod
    def read(path: Path, node: str | None = None) -> MeshFile:
        """Raises InputError where it is no mesh, or has no such node."""
        document = read_document(path) if path.suffix.lower() in GLTF else None
        found = mesh.read_mesh(path, node=node, document=document)
        owners = np.zeros(len(found.faces), np.int32) if found.face_nodes is None else found.face_nodes
        parts = (_part(found, name, found.faces[owners == i]) for i, name in enumerate(found.nodes) if i in owners)
        gap = _JOINED * float(np.ptp(found.bounds, axis=0).max())
        things: list[_Thing] = []
        for thing in parts:
            while near := [x for x in things if x.near(thing, gap)]:  # what is joined may be near to more
                things = [x for x in things if x not in near]
                thing = reduce(_Thing.joined, near, thing)
            things.append(thing)
        if document is not None:
            named = zip(things, name_groups(document, [x.parts for x in things]), strict=True)
            things = [x if name is None else replace(x, name=name) for x, name in named]
        return MeshFile(path, node, tuple(sorted(things, key=lambda x: -x.size)))

    @property
    def whole(self) -> _Thing:
        """All of it."""
        return reduce(_Thing.joined, self.things)

    @property
    def said(self) -> str:
        """What it holds, for people; empty where it is one thing."""
        if len(self.things) == 1:
            return ""
        each = shown.names([f"{x.name} ({x.size:.2g})" for x in self.things])
        of = self.path.name if self.node is None else f"{self.node} of {self.path.name}"
        held = f"{of} holds {len(self.things)} things, {self.whole.size:.2g} units across: {each}"
        first = self.things[0].name
        alone = f"; --object {self.path.name}#{first} takes that alone" if self.path.suffix.lower() in GLTF else ""
        return printable(f"{held}; they stay as they stand to each other, in the size of {first}{alone}")


def _part(of: ProxyMesh, name: str, faces: I32) -> _Thing:
    corners = of.vertices[np.unique(faces)].astype(np.float64)
    return _Thing(name, frozenset([name]), corners.min(axis=0), corners.max(axis=0))


def objects(files: Sequence[MeshFile], seen: view.FirstView, named: Names) -> Iterator[str]:
    """The tables of objects."""
    eye, target = seen.camera.position, np.asarray(seen.target)
    way = np.asarray(eye - target)
    away = float(np.linalg.norm(way))
    ground = FreeGround(seen.picture)
    for i, file in enumerate(files):
        beside = (i - (len(files) - 1) / 2) * _APART * away * seen.camera.world_from_camera[:3, 0]
        near = target + _NEARER * way + beside
        near[1] = max(float(eye[1]), float(target[1]))
        foot, scale = _stood(file.whole, _scales(file, away, seen.room), near, ground)
        low, high = file.whole.low, file.whole.high
        place = foot - scale * np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
        yield ""
        if i == 0:
            yield "# They stand on whatever of the proxy lies under them; move them by x and z."
        if file.said:
            yield f"# {file.said}."
        yield "[[objects]]"
        yield f"path = {named(file.path)}"
        if file.node is not None:
            yield f"node = {json.dumps(file.node, ensure_ascii=False)}"
        yield "drop = true"
        scaled = "" if scale == 1 else f", scale = {scale:g}"
        yield f"transform = {{ translation = {position(place, seen)}, rotation_euler = [0, 0, 0]{scaled} }}"


def _scales(file: MeshFile, away: float, room: bool) -> list[float]:
    """What it may be scaled by, the best first: 1 where it has a size that shows; in a room, where that may well be its
    true one, no other."""
    whole, size = file.whole.size, file.things[0].size
    if not size > 0:
        return [1.0]
    fitting = [float(f"{min(x * away / size, _WIDEST * away / whole):.2g}") for x in _SIZES]
    most = _MOST_IN_ROOM if room else _MOST
    if not (_LEAST * away <= size <= most * away and whole <= _WIDEST * away):
        return fitting
    return [1.0] if room else [1.0, *(x for x in fitting if x < 1)]


def _stood(whole: _Thing, scales: Sequence[float], near: F64, ground: FreeGround) -> tuple[F64, float]:
    """Where the middle of its foot is (3,), and its scale: a little over free ground with the first that finds some;
    else its top is near a place (3,)."""
    for scale in scales:
        size = scale * (whole.high - whole.low)
        free = ground.take(near, float(max(size[0], size[2])) / 2, float(size[1]))
        if free is not None:
            free[1] += (OVER - 1) / 2 * size[1]  # its top still below all that may hang over that ground
            return free, scale
    return near - np.array([0, scales[0] * (whole.high - whole.low)[1], 0]), scales[0]
