"""What a stage holds, by number."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mirelight.io.usd.process import ask
from mirelight.io.usd.rows import Request


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """How many of each kind are seen."""

    splats: int  # of all fields
    meshes: int  # point instancers too
    cameras: int
    lamps: int
    domes: int


def contents(path: Path) -> Contents:
    """Count what is in a stage. Raises InputError."""
    with ask(path, Request(path=str(path), part="head")) as read:
        found = read.answer
        splats = sum(row.count for row in found.splats)
        meshes, cameras, lamps, domes = found.counts or [0, 0, 0, 0]
        return Contents(splats=splats, meshes=meshes, cameras=cameras, lamps=lamps, domes=domes)
