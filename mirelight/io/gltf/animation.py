"""Camera animation: the poses of a camera's node over time (glTF §3.11, appendix C)."""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.base.conventions import slerp
from mirelight.base.errors import InputError
from mirelight.io.gltf.accessors import read_accessor
from mirelight.io.gltf.cameras import read_node_cameras
from mirelight.io.gltf.document import Document, read_document
from mirelight.io.gltf.fields import Fields
from mirelight.io.gltf.nodes import Matrix, Node, Pose, place_nodes, pose_of

_PATHS = {"translation": 3, "rotation": 4, "scale": 3}
_INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")
_MAX_SAMPLES = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One animated property of one node."""

    node: int
    path: str  # translation, rotation (xyzw) or scale
    interpolation: str
    times: NDArray[np.float64]  # (K,) s, increasing
    values: NDArray[np.float64]  # (K, n), or (K, 3, n) in-tangent, value, out-tangent for CUBICSPLINE

    def at(self, time: float) -> NDArray[np.float64]:
        """The value (n,) at a time, held constant before the first key and after the last."""
        keys = self.values[:, 1] if self.interpolation == "CUBICSPLINE" else self.values
        k = int(np.searchsorted(self.times, time, side="right")) - 1
        if k < 0:
            value = keys[0]
        elif k >= len(self.times) - 1 or self.interpolation == "STEP":
            value = keys[min(k, len(keys) - 1)]
        else:
            value = self._between(k, time, keys)
        return np.asarray(value / np.linalg.norm(value) if self.path == "rotation" else value)

    def _between(self, k: int, time: float, keys: NDArray[np.float64]) -> NDArray[np.float64]:
        span = self.times[k + 1] - self.times[k]
        t = (time - self.times[k]) / span
        if self.interpolation == "CUBICSPLINE":
            out_tangent, in_tangent = self.values[k, 2] * span, self.values[k + 1, 0] * span
            t2, t3 = t * t, t * t * t
            return np.asarray(
                (2 * t3 - 3 * t2 + 1) * keys[k]
                + (t3 - 2 * t2 + t) * out_tangent
                + (3 * t2 - 2 * t3) * keys[k + 1]
                + (t3 - t2) * in_tangent
            )
        if self.path == "rotation":
            return slerp(keys[k], keys[k + 1], t)
        return np.asarray((1 - t) * keys[k] + t * keys[k + 1])


def sample_cameras(
    path: str | Path,
    name: str | None = None,
    *,
    fps: float | None = None,
    count: int | None = None,
    time: float | None = None,
) -> tuple[tuple[float, Matrix], ...]:
    """The path of an animated camera.

    All animations of the file play together from their first key to the last key that moves the camera.

    Args:
        path: a .glb or .gltf file.
        name: which camera, as `read_scene` names it; None: the first one that moves.
        fps: samples per second from the first key on, or
        count: this many samples, evenly from the first key to the last, or
        time: one sample, at that moment in s (exactly one of the three).

    Returns:
        (time in s, world_from_camera (4, 4) with whatever scale the hierarchy has) each; `GltfCamera.to_camera` takes
        the matrix.

    Raises:
        InputError: no such camera, one that nothing moves, or a damaged animation.
        ValueError: none or several of fps, count and time, or one that is not positive.
    """
    if (
        sum(x is not None for x in (fps, count, time)) != 1
        or (fps is not None and fps <= 0)
        or (count is not None and count < 1)
    ):
        raise ValueError("give either fps > 0, count >= 1, or time")
    document = read_document(path)
    nodes = place_nodes(document)
    cameras = {camera.name: camera.node for camera in read_node_cameras(document, nodes.values())}
    tracks = read_tracks(document)
    moving = {x: tracks_above(nodes, node, tracks) for x, node in cameras.items()}
    name = name if name is not None else next((x for x, found in moving.items() if found), None)
    if name is None or name not in cameras:
        known = ", ".join(cameras) or "none"
        raise InputError(path, f"no camera {name!r}" if name else "no animated camera", f"its cameras: {known}")
    if not moving[name]:
        raise InputError(path, f"nothing moves the camera {name!r}", "name an animated one or use it as a still")
    start = min(float(t.times[0]) for t in moving[name])
    end = max(float(t.times[-1]) for t in moving[name])
    times = sample_times(document, start, end, fps, count) if time is None else [time]
    return tuple((float(t), world_at(nodes, cameras[name], moving[name], float(t))) for t in times)


def animated_nodes(document: Document, nodes: dict[int, Node]) -> set[int]:
    """The nodes that an animation moves, themselves or by an ancestor."""
    targets = {
        channel.child("target").integer("node", None)
        for animation in document.top.children("animations")
        for channel in animation.children("channels")
        if channel.child("target").text("path", "") in _PATHS
    }
    moving: set[int] = set()
    for index, node in nodes.items():  # parents come first
        if index in targets or node.parent in moving:
            moving.add(index)
    return moving


def sample_times(
    document: Document, start: float, end: float, fps: float | None, count: int | None
) -> NDArray[np.float64]:
    """(N,) moments (s) from `start` to `end`: so many a second, or so many in all."""
    wanted = count if count is not None else (end - start) * (fps or 1.0) + 1
    if wanted > _MAX_SAMPLES:
        raise InputError(document.path, f"{wanted:.0f} samples", f"at most {_MAX_SAMPLES}")
    if count is not None:
        return np.linspace(start, end, count)
    assert fps is not None
    return start + np.arange(int(np.floor((end - start) * fps + 1e-6)) + 1) / fps


def tracks_above(nodes: dict[int, Node], node: int, tracks: list[Track]) -> list[Track]:
    """The tracks that move a node: its own and its ancestors'."""
    line = set(line_of(nodes, node))
    return [track for track in tracks if track.node in line]


def line_of(nodes: dict[int, Node], node: int) -> Iterator[int]:
    """A node and its ancestors."""
    at: int | None = node
    while at is not None:
        yield at
        at = nodes[at].parent


def world_at(nodes: dict[int, Node], node: int, tracks: list[Track], time: float) -> Matrix:
    """world_from_node (4, 4) at a time (s), of a node that these tracks move."""
    poses: dict[int, Pose] = {}
    for track in tracks:
        pose = poses.get(track.node) or pose_of(nodes[track.node].fields)
        if pose.matrix is not None:
            raise nodes[track.node].fields.fail("matrix", "an animated node with a matrix", "give it TRS properties")
        poses[track.node] = replace(pose, **{track.path: track.at(time)})
    world = np.eye(4)
    for at in line_of(nodes, node):
        fields = nodes[at].fields
        world = (poses.get(at) or pose_of(fields)).local(fields) @ world
    return world


def read_tracks(document: Document, only: Container[int] | None = None) -> list[Track]:
    """The tracks of nodes in all animations: exporters split one shot into an animation per object. `only`: of these
    nodes."""
    tracks: dict[tuple[int, str], Track] = {}
    for animation in document.top.children("animations"):
        samplers = animation.children("samplers")
        for channel in animation.children("channels"):
            target = channel.child("target")
            node, path = target.integer("node", None), target.text("path", "")
            if node is None or path not in _PATHS or (only is not None and node not in only):
                continue  # morph weights and extensions move no camera
            index = channel.integer("sampler")
            if index >= len(samplers):
                raise channel.fail("sampler", f"there is no sampler {index}")
            if (node, path) in tracks:
                found = f"nodes[{node}].{path} is animated twice"
                raise channel.fail("target", found, "keep one animation of the camera or light in the file")
            tracks[node, path] = read_track(document, samplers[index], node, path, _PATHS[path])
    return list(tracks.values())


def read_track(document: Document, sampler: Fields, node: int, path: str, width: int) -> Track:
    """One sampler as the track of a property of `width` numbers. Raises InputError."""
    kind = sampler.text("interpolation", "LINEAR")
    if kind not in _INTERPOLATIONS:
        raise sampler.fail("interpolation", f"{kind[:20]!r}", "expected " + ", ".join(_INTERPOLATIONS))
    times = read_accessor(document, sampler.integer("input"), sampler).astype(np.float64)
    values = read_accessor(document, sampler.integer("output"), sampler).astype(np.float64)
    per_key = 3 if kind == "CUBICSPLINE" else 1
    if times.shape[1] != 1 or values.shape != (len(times) * per_key, width):
        raise sampler.fail("output", f"{values.shape} values for {len(times)} keys of {path}", "the file is damaged")
    times = times[:, 0]
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(values)) and np.all(np.diff(times) > 0)):
        raise sampler.fail("input", "times that do not increase, or values that are not finite", "the file is damaged")
    keys = values.reshape(len(times), per_key, width)
    if path == "rotation" and not np.all(np.linalg.norm(keys[:, per_key // 2], axis=1) > 1e-8):
        raise sampler.fail("output", "a rotation key of length zero", "the file is damaged")
    return Track(node, path, kind, times, keys if per_key == 3 else keys[:, 0])
