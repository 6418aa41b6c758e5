"""What decides where things stand on a ground, and where a ground is that no picture tells, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ThingTuning:
    """Decided on photographs of a mouse on a white table; held against a trained street, a park and a white table, on
    which none of these was tuned (`docs/benchmarks/proxies.md`).
    """

    # grounds that no picture tells (`foot`)
    foot_unknown: float = 0.3  # of the opaque pixels below the horizon: a white table 0.73, gravel before a house 0.59
    foot_below: float = 0.01  # of what is sure lies below it: mirrored in the table, or noise
    foot_on: float = 2.0  # spacings: what lies so near to it stands on it
    foot_steps: tuple[float, float] = (0.03, 0.01)  # by which it is leant, radians, and then around the best,
    foot_tried: int = 5  # so many times each way: cameras' up is off by 5 degrees about a thing on a table
    foot_reach: tuple[float, float] = (0.002, 0.998)  # of what views show, along either side
    foot_through: float = 0.3  # trust, in the mean, of what is seen through it: that of fog is up to 0.2
    # things on a ground that are as plain as it (`things`)
    thing_height: float = 4.0  # tolerances: what is higher stands on it
    thing_gap: int = 6  # cells, half the gaps in what stands there that are closed
    thing_top: float = 0.95  # of its cells are no higher than it is: what hangs above it is sure, too, now and then
    thing_foot: float = 0.5  # of its height: what has no sure point below hangs in the air
    thing_heights: int = 12  # up to the highest, at which a ray is asked for
    thing_around: int = 2  # cells beside what is sure of it, and
    thing_over: float = 1.1  # times its height: there its pixels may be
    thing_spot: float = 0.1  # of a thing's pixels, at most: an unsure hole in it is what shines


THINGS = ThingTuning()
