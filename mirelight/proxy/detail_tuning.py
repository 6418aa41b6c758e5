"""The limits by which a thing amid its surroundings is looked at closer (`detail`)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class DetailTuning:
    """Decided on a bicycle in a park, a table in a kitchen and photographs of a table in an office
    (`docs/benchmarks/proxies.md`).
    """

    # what most pictures show (`detail`)
    detail_seen: float = 0.5  # of the cameras
    # of the capture's spacing, at most, are its splats apart: else it is as fine as all else
    detail_finer: float = 0.5
    detail_share: float = 0.6  # of that spacing: 1 loses 0.25 dB on a table in a kitchen, 0.1 on a bicycle in a park
    detail_fewest: int = 500  # splats
    detail_near: float = 1.5  # as far as what cameras are turned to: 1 and 2 give the same box
    detail_turned: float = 0.02  # mean square sine between the lines along which they look, that cross at a point
    # tangent: how far beside that point they look (things to 0.13, a hall 0.19, a street 0.6)
    detail_aside: float = 0.15
    detail_past: float = 2.0  # cells, deviation: over which what is seen of a plane and seen past it are compared
    detail_rim: float = 0.002  # of its splats, that lie beyond each side: 0.01 cuts off ears and a tree's top
    detail_lid: float = 6.0  # of that spacing, by which it is grown: few splats tell of a lid
    detail_looked: int = 4  # every so many-th triangle tells whether a part is fog
    detail_sure: float = 0.05  # of a part that is sure at the least: of fog 0.02 and less, of things 0.12 and more
    detail_margin: float = 3.0  # spacings of the capture around it, that are looked at, too


DETAIL = DetailTuning()
