"""What decides a surface made of depth maps, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """Lengths are in spacings of the splats (the median distance between neighbours) where nothing else is said.

    Decided on captures that an optimiser made of pictures of a room and a courtyard, whose true surface is known:
    `docs/guides/proxy.md` has the figures.
    """

    # pixels' own planes (`slanted`)
    window: float = 2.5  # radius; 4 gave normals better by 1.5 degrees, edges worse, and rounds what is round
    window_step: int = 2  # px between those looked at; each one gives the same and takes four times as long
    window_color: float = 0.12  # display values, summed over channels: 0.08 to 0.3 differ by a degree
    window_rounds: tuple[float, ...] = (4, 2, 1, 1)  # noises: what lies so far off a plane counts a quarter

    # planes of the whole surface (`flats`)
    plane_tolerance: float = 1.0  # from the plane to what lies on it
    plane_band: float = 2.5  # tolerances: what lies nearer and faces alike is the same surface, and no second plane
    plane_cosine: float = 0.85  # between the normals of points and their plane
    plane_least: float = 0.004  # share of the surface: smaller ones are left to what is free
    plane_turn: float = (
        0.15  # radians from middle to rim: what turns more is round (a ball's caps 0.3, a room's walls 0.05)
    )
    plane_beside: float = 3.0  # tolerances: how far from a plane its points have little beside them
    plane_alone: float = 0.25  # of the points there: walls and tops hold 0.25 to 0.9, slices of bushes 0.1 to 0.24
    plane_most: int = 24  # planes
    plane_cell: float = 2.0  # side of the cells that tell where a plane is

    # windows (`openings`)
    clipped: float = 0.9  # display value of the least channel: of a room's windows 97 % lie above, of all else 3 %
    window_depth: float = (
        0.2  # behind the wall, mean of what is white: a room's windows lie 0.5 to 2.3 behind, a patch of sun on it -0.2
    )
    window_bars: float = 0.5  # behind the wall, where its pictures agree best: 0.9 of a window, -0.25 of a patch of sun
    window_cells: int = 12  # cells of a plane, at least

    # which pixels lie on planes (`labels`)
    label_window: int = 6  # px, radius
    label_step: int = 2  # px
    label_color: float = 0.12  # display values, summed over channels
    label_free: float = 0.45  # cost of lying on none; one off by two tolerances costs 1
    # skies (`labels`)
    sky_trust: float = 0.02  # of pixels that hang anywhere
    sky_share: float = 0.03  # of pixels, from which there is a sky: 0.17 with one, 0.0006 in a room, 0.005 in a yard
    fog: float = 0.1  # trust of pixels that are left out then: a third, off by 3 to 30 spacings in the median
    # grounds that go on beneath a sky's fog (`ground`)
    ground_cameras: float = 0.95  # of the cameras, that stand before it
    ground_below: float = 4.0  # tolerances: what lies lower is below it
    ground_behind: float = 0.03  # of what is seen, at most, that lies there: 0.0001 of a yard's paving, 0.7 of a table

    cell: float = 0.6  # of the grid that maps are fused in


TUNING = Tuning()
