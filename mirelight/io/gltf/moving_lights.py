"""Lights that an animation moves, aims or dims: nodes over time, and KHR_animation_pointer to a light's own fields."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.io.gltf import blender
from mirelight.io.gltf.animation import (
    Track,
    animated_nodes,
    line_of,
    read_track,
    read_tracks,
    sample_times,
    tracks_above,
    world_at,
)
from mirelight.io.gltf.document import Document, read_document
from mirelight.io.gltf.fields import Fields
from mirelight.io.gltf.lights import EXTENSION, read_node_lights
from mirelight.io.gltf.nodes import Node, place_nodes
from mirelight.io.gltf.scene import GltfLights

_POINTER = re.compile(r"/extensions/KHR_lights_punctual/lights/(\d+)/(\w+(?:/\w+)?)")
_WIDTHS = {"color": 3, "intensity": 1, "range": 1, "spot/innerConeAngle": 1, "spot/outerConeAngle": 1}


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """An open glTF file and what moves its lights. All animations play together; before the first key and after the
    last one values stay."""

    document: Document
    nodes: dict[int, Node]
    moving: dict[int, list[Track]]  # by the node of a light: the tracks that move it
    changing: list[tuple[int, str, Track]]  # light, field of it

    @staticmethod
    def of(path: str | Path) -> Shot:
        """Open a .glb or .gltf file. Raises InputError: a damaged animation."""
        document = read_document(path)
        nodes = place_nodes(document)
        carriers = [index for index, node in nodes.items() if node.fields.extension(EXTENSION) is not None]
        tracks = read_tracks(document, {x for index in carriers for x in line_of(nodes, index)})
        found = {index: tracks_above(nodes, index, tracks) for index in carriers}
        return Shot(document, nodes, {k: v for k, v in found.items() if v}, _pointed(document))

    @property
    def tracks(self) -> list[Track]:
        """All that change a light."""
        return [t for tracks in self.moving.values() for t in tracks] + [t for *_, t in self.changing]

    def at(self, time: float) -> GltfLights:
        """The lights of a moment (s); what nothing moves is the very same at all of them.

        Raises:
            InputError: a value outside the specification.
        """
        placed = [
            replace(node, world=world_at(self.nodes, index, self.moving[index], time)) if index in self.moving else node
            for index, node in self.nodes.items()
        ]
        values: dict[int, dict[str, object]] = {}
        for light, field, track in self.changing:
            value = track.at(time)
            values.setdefault(light, {})[field] = value.tolist() if len(value) > 1 else float(value[0])
        lights = read_node_lights(self.document, placed, values)
        return GltfLights(lights=lights, blender=blender.exporter(self.document))


def moving_lights(path: str | Path) -> tuple[bool, ...]:
    """Of each light of a file, in node order, whether an animation moves or changes it; no animation is read.

    Raises:
        InputError: a file that cannot be read.
    """
    document = read_document(path)
    nodes = place_nodes(document)
    moved, changed = animated_nodes(document, nodes), {light for light, *_ in _pointers(document)}
    carriers = [(k, user) for k, node in nodes.items() if (user := node.fields.extension(EXTENSION)) is not None]
    return tuple(index in moved or user.integer("light") in changed for index, user in carriers)


def light_times(path: str | Path, *, fps: float | None = None, count: int | None = None) -> NDArray[np.float64]:
    """(N,) moments (s) from the first key to the last one that changes a light, as `sample_cameras` has them for
    cameras.

    Raises:
        InputError: nothing moves or changes a light, or a damaged animation.
    """
    shot = Shot.of(path)
    if not shot.tracks:
        raise InputError(path, "nothing moves or changes a light", "leave fps and frames out, or animate one")
    start = min(float(t.times[0]) for t in shot.tracks)
    end = max(float(t.times[-1]) for t in shot.tracks)
    return sample_times(shot.document, start, end, fps, count)


def _pointers(document: Document) -> Iterator[tuple[int, str, Fields, Fields]]:
    """Channels that change a light: its index, the field, the animation and the channel; other pointers change none."""
    for animation in document.top.children("animations"):
        for channel in animation.children("channels"):
            extension = channel.child("target").extension("KHR_animation_pointer")
            match = None if extension is None else _POINTER.fullmatch(extension.text("pointer"))
            if match is not None and match[2] in _WIDTHS:
                yield int(match[1]), match[2], animation, channel


def _pointed(document: Document) -> list[tuple[int, str, Track]]:
    found: dict[tuple[int, str], Track] = {}
    for light, field, animation, channel in _pointers(document):
        samplers, index = animation.children("samplers"), channel.integer("sampler")
        if index >= len(samplers):
            raise channel.fail("sampler", f"there is no sampler {index}")
        if (light, field) in found:
            raise channel.fail("target", f"lights[{light}] {field} is animated twice", "keep one animation of it")
        found[light, field] = read_track(document, samplers[index], -1, field, _WIDTHS[field])
    return [(light, field, track) for (light, field), track in found.items()]
