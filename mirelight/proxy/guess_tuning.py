"""What decides from where a capture without cameras is looked at, and which way is up in it, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class GuessTuning:
    """Lengths are in spacings of the splats (the median distance between neighbours) where nothing else is said; "of"
    something is a share of it.

    Decided on trained captures, whose cameras are known, and on real ones, of which it was looked at what came of it:
    `docs/benchmarks/proxies.md` has the figures.
    """

    # where a capture was taken from (`guessed`)
    guess_opaque: float = 0.2  # opacity of splats that tell
    guess_fewest: int = 500  # of them
    guess_sample: int = 4_000  # of them that are asked
    guess_grid: int = 20  # candidates along the box's longest side
    guess_stray: float = 0.005  # of the splats at either end of the capture's axes, that its box leaves out
    guess_flat: float = 0.25  # of the longest side: a flat box is asked that far above and below
    guess_around: int = 150  # around the box, at each distance
    guess_away: tuple[float, ...] = (1.1, 1.8)  # of the radius
    guess_clear: float = 1.3  # times the median of all that the best has: real ones 3, even noise 1.1
    guess_worth: float = 0.8  # of the best, that others have
    guess_near: float = 0.9  # of the best, that the best of a distance has, past which none is sought
    # of the best, that the best of the last distance has round a thing alone: 0.96 to 1 there, to 0.9 elsewhere. Seen
    # from 1.5 radii or 2.2 four such things gain 1.2 dB over places as near as they come; from 3.2 one loses 0.3
    guess_alone: float = 0.93
    guess_room: float = 0.4  # of how far off things usually are: a tenth of a view may be nearer
    guess_small: float = 0.2  # of a view's size, in which that is told
    guess_tried: int = 96  # places of which it is told whether they have room
    guess_places: int = 24  # that are looked from
    guess_ways: int = 100  # directions that are tried
    guess_views: int = 64  # that are taken
    guess_sides: int = 8  # directions in which it is told whether a place has room
    guess_yfov: float = 60.0  # degrees
    guess_pixels: int = 280  # along a side

    # how clear a capture looks (`clear`)
    # that neighbours are joined down to: of a flat with eight rooms, places in them have 0.74 (the median) and places
    # outside 0.12; with 200,000 0.79 and 0.15 in 1.6 times the time, with 40,000 0.58 and 0.1
    clear_splats: int = 100_000
    clear_pixels: int = 40  # along a side of the six pictures of all directions
    clear_noise: float = 0.15  # of the logarithm of distances: what a clear layer blends
    clear_least: float = 0.3  # clear enough to have been seen: it blends one and a half times that
    clear_grid: int = 10  # candidates along the box's longest side
    clear_fewest: int = 500  # of them, in the box
    clear_far: float = 0.02  # of the finer half of the splats, that a box about what people stood near leaves out
    # of the box about all, that it has where it is asked first: a square among towers 0.59, others 0.8 to 0.97
    clear_near: float = 0.75
    clear_around: int = 12  # around the box, at each distance
    clear_worth: float = 0.6  # of the best, that others have
    clear_judged: int = 16  # views, whose surfaces are held against those of as many from around
    # times the trust from around, that they have, where those hide much, as walls do, and where they show nearly all: a
    # toy's inside 0.83, that of a ball of even splats 1.04, rooms 1.16; a tall bust from close by 1.21, others 1.28
    clear_surer: tuple[float, float] = (1.1, 1.25)
    clear_amid: float = 0.1  # of the splats, that is much: rooms 0.15 to 0.35, things and gardens 0.08 and less
    clear_most: float = 0.8  # that views ever have: where those from around have nearly as much, none are sought
    # of the splats, that they do not see, more than views from around: from inside of hollow plinths 0.27 to 0.68, from
    # one side of a tall thing 0.11, in rooms and gardens 0.07 and less
    clear_hidden: float = 0.085
    # what views from around are sure of, and hide, where they show all and no others are sought: a robot over a lawn,
    # 0.51 and 0.01; a floor of fuzz 0.48 and 0, a bust 0.42 and 0.07, rooms 0.34 and 0.1, a garden 0.1
    clear_alone: tuple[float, float] = (0.5, 0.02)
    clear_size: int = 140  # along the longer side of one

    # which way is up in what views see (upright.py)
    upright_views: int = 32  # that are looked through
    upright_pixels: int = 96  # along the longer side of one
    # of these pixels, to the finest that tells a normal: by 0.75 rough grass is no ground (a robot's lawn), by two
    # pixels a man is a block that stands on his head, and a guitar lies on its side
    upright_grain: float = 3.0
    upright_sample: int = 15_000  # points of the surface
    upright_ways: int = 3_000  # directions that are tried
    upright_cone: float = 8.0  # degrees by which what faces a direction, or stands along it, may be off
    upright_apart: float = 25.0  # degrees between axes
    upright_usual: float = 45.0  # degrees from the axis that a format mostly has as up
    # what speaks for directions near it, and near Z, times this: the flattest thing of a guitar is its front
    upright_habit: tuple[float, float] = (1.5, 1.2)
    upright_level: float = 0.5  # by which more speaks for a direction along which all eyes are as high
    upright_clear: float = 2.6  # times the median direction's, that the best has: a ball 1.1, a man 2.3, others 3.6
    upright_surer: float = 1.05  # times another axis' that it has, or it is a guess
    upright_ceiling: float = 0.5  # of what faces one side of a floor, that faces the other: a closed room
    upright_thin: float = 0.05  # of the height: what lies closer to a floor is on it
    upright_wall: float = 0.2  # cosine between up and what is a wall at the most
    upright_floor: float = 0.01  # of the surface, that a floor has
    upright_beside: float = 0.15  # of a room's height: what is closer to its floor or ceiling may be part of it
    upright_things: float = 0.01  # of the surface: things by which floor and ceiling are told apart
    upright_rounds: int = 8  # times that it is levelled
    upright_told: float = 0.2  # of the surface, that lies level or stands upright where it tells better than cameras
    upright_leaning: float = 20.0  # degrees: surface and cameras that tell ways farther apart do not agree

    # whether splats were made of one picture (`one_picture`)
    taker_fewest: int = 20_000  # fewer are no pixels
    taker_before: float = 0.995  # of the splats, that lie before the origin
    taker_stray: float = 0.002  # of them at either end, that may lie past the picture's rim
    taker_widest: float = 6.0  # tangents across the picture: 143 degrees
    taker_cells: int = 16  # of the picture, along each side
    taker_most: int = 2000  # pixels along its longer side
    taker_near: float = 0.25  # of what a picture shows, by whose depth it is told what is far behind
    taker_far: float = 15.0  # times that depth
    # deviation of how many lie in a cell, by their mean: pixels 0.01, without the hidden ones of some parts 0.3, where
    # splats were trained 1 and more; a ball has 0.45 all round
    taker_even: float = 0.5
    taker_round: float = 0.3

    # whether a dome of sky stands around a capture (`dome`)
    dome_stray: float = 0.005  # of the splats, that may lie beyond it
    dome_thick: float = 0.75  # of its radius, beyond which splats are the dome's
    dome_between: float = 0.4  # of its radius: between that and the dome is hardly anything
    dome_empty: float = 0.1  # of the dome's splats: what may be there
    dome_things: float = 0.02  # of all splats, that things within it have at the least
    dome_far: float = 4.0  # times as far off as the median splat within it
    dome_cells: int = 12  # of the sphere from pole to pole
    dome_covered: float = 0.6  # of the directions of one half of the sphere


GUESS = GuessTuning()
