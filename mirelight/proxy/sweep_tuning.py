"""What decides how far planes are moved to where pictures agree, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepTuning:
    """Lengths are in spacings of the splats (the median distance between neighbours) where nothing else is said.

    Decided on a trained hall and a yard, whose true planes are known: `docs/benchmarks/proxies.md` has the figures,
    which hardly depend on any of these.
    """

    sweep_step: float = 0.5  # between the places that are tried
    sweep_most: int = 9  # steps, to both sides
    sweep_points: int = 20_000  # of a plane: three times as many move planes by a tenth of a spacing
    sweep_wide: float = 4.0  # px: what is drawn on a surface is lighter or darker than the mean over so far: 1.2 to 8
    sweep_narrow: float = 0.7  # px: and no finer than this
    sweep_near: float = 3.0  # how far from the plane what is seen of it may lie: 1.5 to 5
    sweep_aslant: float = 0.25  # cosine between a ray and the plane, below which it tells nothing: 0.15 to 0.4
    sweep_share: float = 0.05  # of a plane's points, that a view must show
    sweep_views: int = 24  # at most: all of 70 tell the same
    sweep_fewest: int = 3  # views
    sweep_alike: float = 0.6  # how much of what views show is the same to all, at best: on statues seen by guess 0.5
    sweep_gain: float = 0.025  # more than where the plane is: to 0.018 where that is right, else 0.027 to 0.36
    sweep_even: float = 0.15  # more than 4.5 spacings off: less tells nothing, as 0.09 and 0.10 do; else 0.3 to 0.7
    sweep_reach: float = 2.0  # from a plane, and its fog, to what is moved along with it
    sweep_facing: float = 0.7  # cosine between its normal and theirs


SWEEP = SweepTuning()
