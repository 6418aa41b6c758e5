"""What decides a surface made of depth maps, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """Lengths are in spacings of the splats (the median distance between neighbours) where nothing else is said.

    Decided on captures that an optimiser made of pictures of a room and a courtyard, whose true surface is known:
    `docs/benchmarks/truth.md` and `proxies.md` have the figures.
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
    # share of the surface: smaller ones are left to what is free, as slices of a biker are, of 0.004 to 0.02
    plane_least: float = 0.02
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

    # windows and skies (`openings`)
    opening_away: float = 4.0  # of the capture's radius: where a sky is put
    opening_fine: float = 0.3  # spacings: side of the cells that bars are cut out in
    opening_deepest: float = 6.0  # spacings behind the wall's face: where bars may be
    opening_depth: float = 0.25  # spacings: step between those that are tried
    # spacings around what is white, that shut out light, too: frames, and walls behind their face
    opening_rim: float = 2.0
    opening_before: float = 2.0  # spacings: what lies farther before a plane hides it
    opening_far: float = 6.0  # spacings: what lies farther off counts as this far
    opening_bars: int = 2  # cells of a plane: what is narrower between panes is a bar
    opening_seen: int = 3  # views that must show a cell
    opening_dark: float = 0.5  # display value at which a pixel is no sky at all; in between it is so in part
    opening_white: float = 0.8  # of a sky, at least
    opening_even: float = 0.1  # a sky's cells differ by less, where no bar is among them

    # depth maps (`depth`)
    depth_opaque: float = 0.5  # alpha from which a pixel shows a surface
    depth_sharper: int = 3  # layers of a splat that stand for it, where fog is told from surfaces
    # of a splat's optical depth: what is left of it, so that splats in front hide none behind them
    depth_thinner: float = 0.1
    depth_rounds: int = 3  # of telling what lies behind the surface; each knows it better
    # middle axes of a splat: how far from the surface it may lie and be part of it
    depth_reach: float = 3.0
    # standard deviations of what a pixel blends, from its mean: a depth so far off is a quotient of nothing
    depth_astray: float = 4.0
    depth_noise: float = 2.0  # spacings of the splats: pixels whose blend spreads that far in depth count half
    depth_finest: float = 10.0  # times finer than the median: splats that are smaller count no more
    depth_typical: float = 2.0  # the same in middle axes of the median splat, added
    # of the longest axis: flatter splats are taken as that flat, which their plane does not notice
    depth_thinnest: float = 1e-3
    depth_behind: float = 1e-6  # cosine to the view: planes that are looked along have no depth there
    depth_least: float = 1e-8  # of what is blended, below which a pixel shows nothing
    depth_few: int = 20_000  # points that tell a pixel's size
    depth_clip: float = 1e-4  # alpha below which thinned splats add nothing

    # maps fused in a grid (`fusion`)
    fused_truncation: int = 4  # cells
    fused_band: int = 2  # cells to either side of what views see, in which distances are kept
    fused_sheet: int = 3  # cells: what is thinner and seen from both sides is a sheet
    sheet_around: float = 8.0  # such sheets: how far around a point it is told which side was looked at
    # of the points there, above which the side away from the origin was: floors seen from both sides hold 0.5
    sheet_outside: float = 0.75
    fused_opposite: float = -0.5  # cosine between normals of two sides of one sheet
    fused_facing: float = 0.05  # cosine to the view, as a weight: what is seen more aslant counts as this
    fused_few: float = 0.02  # of the other side's normals: fewer do no harm

    # beyond the pictures (`beyond`)
    beyond_least_area: float = 0.02  # of the surface: smaller planes are parts of things, and end where those end
    beyond_small: float = 0.004  # of the surface: parts of things that go on behind what stands before them
    beyond_gap: int = 3  # cells between the last surface of a row and where pictures end
    beyond_least_row: int = 6  # cells of surface, that a row must have to go on
    beyond_enough: float = 0.2  # of the rows: if so many are seen to end, a side does not go on
    beyond_spacings: float = 2.5  # of the splats, to a cell at least: its surface has no gaps then
    beyond_across: float = 0.7  # cosine between normals of planes that end where they meet
    beyond_near: float = 0.4  # cells before the surface, where nothing counts as looked through
    beyond_marks: int = 8  # of the surface, to an area of a cell
    beyond_cells: int = 200  # along the box's longest side


TUNING = Tuning()
