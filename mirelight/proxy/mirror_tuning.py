"""What decides which openings of a wall are mirrors, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class MirrorTuning:
    """Lengths are in spacings of the splats (the median distance between neighbours) where nothing else is said.

    Decided on a trained room with a mirror, with and without its cameras, and on others without one:
    `docs/benchmarks/proxies.md` has the figures.
    """

    mirror_step: int = 3  # px between the points among which it is sought what a mirror shows
    mirror_before: float = 2.0  # how far what stands before a wall lies before it
    mirror_behind: float = 4.0  # and what is seen through it, behind it
    mirror_seen: int = 3  # views that must see a cell
    mirror_through: float = 0.5  # share of them that see what lies behind
    mirror_cells: int = 12  # cells of a plane, at least
    mirror_framed: float = 0.3  # share of the rim of what is looked through that lies on the plane
    mirror_facing: float = 0.3  # cosine between a plane and what tells: floors go on behind any door
    mirror_near: float = 3.0  # how near to what is seen before the plane, turned over
    mirror_color: float = 0.2  # display values, of any channel: 0.15 to 0.3 tell as well
    mirror_shift: float = 12.0  # how far off a plane is at which that agrees by chance; nearer to it nothing tells
    mirror_alike: float = 0.3  # share that agrees, less that by chance: 0.4 to 0.6 in a mirror, else below 0.1
    mirror_asked: float = 40.0  # pixels that tell, by their trust
    mirror_turn: int = 3  # degrees between the rectangles that are tried
    mirror_inside: float = 0.96  # share of the cells that lie in a rectangle: of a round mirror 0.92
    mirror_filled: float = 0.85  # share of both that is in both
    mirror_changes: float = 0.045  # display values, deviation from picture to picture: 0.006 to 0.03 on walls


MIRRORS = MirrorTuning()
