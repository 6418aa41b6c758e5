"""Streamed SOG (PlayCanvas): lod-meta.json, a tree whose leaves name ranges of SOG folders for each level of detail.

One level is read whole: an offline frame needs no streaming. The environment splats that the format keeps apart (a sky)
belong to every level. Format: developer.playcanvas.com, "The Streamed SOG Format", version 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mirelight.base.sh import COEFFICIENTS
from mirelight.io.gltf.fields import Fields
from mirelight.io.safety import neighbour, read_bytes
from mirelight.io.splats.archive import parse_json
from mirelight.io.splats.builder import CloudBuilder
from mirelight.io.splats.info import SplatFileInfo
from mirelight.io.splats.sog import SogHead, SogImages, check_range, open_bundle, open_folder
from mirelight.io.splats.sog import summary_of as sog_summary
from mirelight.model import SplatCloud

_LARGEST_META = 1 << 28  # bytes; a tree of a million leaves has some 100 MB


@dataclass(frozen=True, slots=True)
class _Part:
    """The splats that one SOG file of a streamed capture holds."""

    head: SogHead
    degree: int
    ranges: tuple[tuple[int, int], ...]  # start, stop; ascending

    @property
    def count(self) -> int:
        return sum(stop - start for start, stop in self.ranges)


def summary(path: Path, lod: int | None) -> SplatFileInfo:
    """The head of a streamed SOG. Raises InputError."""
    meta = _open(path)
    level = _level(meta, lod)
    parts = _parts(meta, level)
    counts = [0] * meta.integer("lodLevels", low=1, high=64)
    for leaf in _leaves(meta):
        for index in range(len(counts)):
            counts[index] += leaf.child(str(index)).integer("count", 0)
    return SplatFileInfo(
        path=path,
        format="streamed SOG",
        count=sum(part.count for part in parts),
        sh_degree=max(part.degree for part in parts),
        antialiased=any(part.head.antialiased for part in parts),
        levels=tuple(counts),
        notes=(f"level of detail {level} of {len(counts)}",),
    )


def read(path: Path, lod: int | None) -> SplatCloud:
    """The splats of one level of detail (None: 0, the finest), in PLY's axes. Raises InputError."""
    meta = _open(path)
    parts = _parts(meta, _level(meta, lod))
    coefficients = COEFFICIENTS[max(part.degree for part in parts)]
    builder = CloudBuilder(path, sum(part.count for part in parts), coefficients)
    for part in parts:
        images = SogImages(part.head)
        for start, stop in part.ranges:
            images.emit(builder, start, stop)
    return builder.cloud(antialiased=any(part.head.antialiased for part in parts))


def _open(path: Path) -> Fields:
    meta = parse_json(path, read_bytes(path, _LARGEST_META))
    version = meta.integer("version", 1)
    if version != 1:
        raise meta.fail("version", f"{version}", "version 1 is read")
    return meta


def _level(meta: Fields, lod: int | None) -> int:
    levels = meta.integer("lodLevels", low=1, high=64)
    if lod is not None and not 0 <= lod < levels:
        raise meta.fail("lodLevels", f"no level of detail {lod}", f"0 (finest) to {levels - 1} are there")
    return lod or 0


def _leaves(meta: Fields) -> list[Fields]:
    """The `lods` objects of every leaf of the tree."""
    found, open_nodes = [], [meta.child("tree")]
    while open_nodes:
        node = open_nodes.pop()
        if "children" in node:
            open_nodes += reversed(node.children("children"))
        elif "lods" in node:
            found.append(node.child("lods"))
    return found


def _parts(meta: Fields, level: int) -> list[_Part]:
    """The SOGs of one level with the ranges that its leaves name, and the environment."""
    names = meta.texts("filenames")
    ranges: dict[int, list[tuple[int, int]]] = {}
    for leaf in _leaves(meta):
        entry = leaf.child(str(level))
        count = entry.integer("count", 0)
        if count:
            start = entry.integer("offset")
            ranges.setdefault(entry.integer("file", high=len(names) - 1), []).append((start, start + count))
    parts = []
    for index, spans in sorted(ranges.items()):
        field = f"filenames[{index}]"
        head = _open_sog(meta, names[index], field)
        last = 0
        for start, stop in sorted(spans):
            if start < last:
                raise meta.fail(field, f"its splat {start:,} is named by two leaves", "the file is damaged")
            check_range(head, start, stop - start, meta.file, field)
            last = stop
        parts.append(_Part(head, _degree(head), tuple(sorted(spans))))
    if "environment" in meta:
        head = _open_sog(meta, meta.text("environment"), "environment")
        parts.append(_Part(head, _degree(head), ((0, head.count),)))
    if not parts:
        raise meta.fail("tree", f"no splats of level {level}", "choose another level of detail")
    return parts


def _open_sog(meta: Fields, name: str, field: str) -> SogHead:
    target = neighbour(name, meta.file, field)
    return open_bundle(target) if target.suffix.lower() == ".sog" else open_folder(target)


def _degree(head: SogHead) -> int:
    return sog_summary(head, head.files.path).sh_degree
