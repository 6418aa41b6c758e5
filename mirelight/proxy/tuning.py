"""What decides a surface made of depth maps, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """Lengths are in spacings of the splats (the median distance between neighbours) where nothing else is said; "of"
    something is a share of it.

    Decided on captures that an optimiser made of pictures of a room and a courtyard, whose true surface is known:
    `docs/benchmarks/truth.md` and `proxies.md` have the figures.
    """

    # pixels' own planes (`slanted`)
    window: float = 2.5  # radius; 4 gave normals better by 1.5 degrees, edges worse, and rounds what is round
    window_step: int = 2  # px between those looked at; each one gives the same and takes four times as long
    window_color: float = 0.12  # display values, summed over channels: 0.08 to 0.3 differ by a degree
    window_rounds: tuple[float, ...] = (4, 2, 1, 1)  # noises: what lies so far off a plane counts a quarter
    window_least: float = 0.05  # summed weight of a window that tells a plane

    # what neighbouring views tell of depth (`stereo`), px of the depth maps where nothing else is said
    stereo_step: int = 2  # between the pixels that are sought: each one takes four times as long
    stereo_window: int = 6  # radius of what is compared, every second pixel; 3 leaves a fifth more pixels off by 3
    stereo_color: float = 0.1  # display values, summed over channels: pixels of another colour count less
    stereo_noise: float = 0.01  # display values: contrast of this much tells nothing
    stereo_points: int = 400  # of a view, by which others are chosen
    stereo_beside: int = 8  # others that a view is compared with; 6 leave a tenth more pixels off by 3
    stereo_best: int = 4  # of them those that count: the others may have something before it
    stereo_angles: tuple[float, float] = (3.0, 25.0)  # degrees between them: below and above these they tell less
    stereo_common: float = 0.02  # share of the points that another must show
    stereo_hidden: float = 0.03  # of the depth: what lies so far behind the other's surface is hidden there
    stereo_rounds: int = 4  # eight gain nothing
    stereo_beside_px: tuple[int, ...] = (1, 3, 7, 2)  # of the grid: how far off the planes are that a round tries
    stereo_moves: tuple[float, ...] = (8.0, 4.0, 2.0, 1.0)  # sides of a pixel: by about how much it tries others
    stereo_turns: float = 0.25  # radians, of their normals
    stereo_gain: float = 0.005  # of correlation: less is chance
    stereo_alike: float = 0.3  # correlation of what is found
    stereo_sure: float = 0.5  # of what looks through other surfaces
    stereo_agree: int = 3  # other views that find it in the same place; 2 make leaves swell
    stereo_apart: float = 1.0  # px: the same place
    stereo_behind: float = 6.0  # px of depth: no longer the same surface
    stereo_least: float = 0.1  # share of the pixels: of blurred splats fewer are found (0.01), of sharp ones 0.3
    stereo_through: int = 2  # views that are sure of something behind a pixel that is not found: it shows nothing
    stereo_doubt: float = 0.3  # how much pixels count that are not found: 1 leaves what hangs in the sky, 0.1 the same
    stereo_around: tuple[float, ...] = (40.0, 16.0, 6.0)  # how far what is found moves depths beside it
    stereo_enough: float = 4.0  # px that are found, to be followed by half

    # planes of the whole surface (`flats`)
    plane_tolerance: float = 1.0  # from the plane to what lies on it
    plane_band: float = 2.5  # tolerances: what lies nearer and faces alike is the same surface, and no second plane
    plane_cosine: float = 0.85  # between the normals of points and their plane
    # share of the surface: smaller ones are left to what is free, as slices of a biker are, of 0.004 to 0.02
    plane_least: float = 0.02
    # radians from middle to rim: what turns more is round (a ball's caps 0.17 and more, walls 0.05, blurred ones 0.16)
    plane_turn: float = 0.165
    # tolerances, by which a piece of a plane is bent, as a deviation: slices of statues 0.35 to 0.41, all else to 0.26
    plane_bent: float = 0.3
    plane_sags: float = 0.002  # of its width, by which it may be: a round table 0.0015, slices of statues 0.003 to 0.01
    # of the rim of a small piece, past which the surface goes on near its plane: a beard, a chest and a bust's sides
    # 0.81 to 0.97, tables and walls 0.1 to 0.75
    plane_fades: float = 0.78
    plane_fades_to: float = 4.0  # tolerances off it, and
    plane_goes_on: float = 0.5  # cosine between normals: it goes on
    plane_few: int = 50  # points: pieces of fewer are not asked, as they move a plane hardly
    plane_large: int = 600  # cells: what is larger and lies in a plane is one, as a ceiling, of which 0.87 goes on
    plane_beside: float = 3.0  # tolerances: how far from a plane its points have little beside them
    plane_alone: float = 0.25  # of the points there: walls and tops hold 0.25 to 0.9, slices of bushes 0.1 to 0.24
    # of what is near its cells, that surely lies off it and faces as it does: walls and floors to 0.2, a blanket 0.27
    # to 0.31, grass that rises and falls 0.22
    plane_uneven: float = 0.245
    plane_near: float = 4.0  # tolerances
    plane_facing: float = 0.8  # cosine
    plane_most: int = 24  # planes
    plane_square: float = 5.0  # degrees off a right angle, or off parallel: walls that lean by 1.7 stand upright
    plane_square_held: float = 0.5  # of a plane, that must lie on it when it is turned: else it does lean
    plane_cell: float = 2.0  # side of the cells that tell where a plane is

    # plain walls of what is no room (`plain`)
    plain_thick: float = 4.0  # spacings: splats of stucco lie off it by 3, in the median
    plain_beside: float = 1.5  # such planes that lie so many of that beside a finer one are the same surface
    plain_trust: float = 0.05  # of a pixel, at least: where all hangs all counts
    plain_window: int = 7  # px, in which a pixel has one colour around if that varies by less than
    plain_even: float = 0.06  # display values, a standard deviation over all channels
    plain_places: int = 4  # of a cell, along each side, that are asked for
    plain_views: int = 3  # that show a place, to tell
    plain_aslant: float = 0.2  # cosine to the view, below which it does not
    plain_share: float = 0.65  # of what is shown on a wall has one colour around: 0.72 to 0.9, hedges 0.06 to 0.59
    # of its places differ by less between pictures than the next (display values): 0.02 to 0.034, hedges 0.05 to 0.16
    plain_most: float = 0.8
    plain_apart: float = 0.04

    # windows (`openings`)
    clipped: float = 0.9  # display value of the least channel: of a room's windows 97 % lie above, of all else 3 %
    # behind the wall, mean of what is white: a room's windows lie 0.5 to 2.3 behind, a patch of sun on it -0.2
    window_depth: float = 0.2
    window_bars: float = 0.5  # behind the wall, where its pictures agree best: 0.9 of a window, -0.25 of a patch of sun
    window_cells: int = 12  # cells of a plane, at least

    # points that a view is sure of (`depth`)
    sure: float = 0.5  # trust
    sure_step: int = 3  # every third pixel, both ways
    # walls that nothing tells of (`walls`)
    wall_level: float = 0.95  # cosine between a plane and what is up, above which it is level, and
    wall_upright: float = 0.3  # below which it is a wall
    wall_step: int = 3  # every third pixel, both ways
    wall_far: float = 0.98  # of what is sure on a side lies before its wall
    wall_floor: float = 0.003  # of all that is sure lies below the floor
    wall_views: int = 3  # that show a wall above eyes, and
    wall_round: float = 0.9  # of the ways round a room, in which they do: 1 of rooms, 0.01 of one looked down in
    wall_on: float = 0.05  # of its way, by which a pixel may miss a ceiling that it shows
    wall_ceiling: float = 0.33  # of what is sure above walls is on the ceiling: in halls 0.7, in a street 0.17
    wall_cells: int = 1000  # of a box's longest side, at most
    wall_square: float = 0.999  # cosine between a plane and what is up, above which it may be the floor, if it lies
    wall_beside: float = 0.02  # of the room's height from what is seen lowest
    wall_eyes: float = 1.1  # times as far as a camera stood, at least
    # of the pixels, unsure and above the horizon: 0.006 in a room looked at from above, 0.05 to 0.11 beneath a sky
    wall_sky: float = 0.02
    # of unsure pixels, that others show alike in their place rather than in their direction: above the horizon 0.81 to
    # 0.93 in rooms, beneath skies 0.58 to 0.7; of all that rays leave for past the floor 0.7 to 0.93 in rooms
    wall_nearer: tuple[float, float] = (0.75, 0.6)
    # of all of those, from which it is a room whatever is above the horizon: 0.78 and 0.81 before plain walls that few
    # pictures show high up, 0.68 and 0.69 beneath skies
    wall_nearest: float = 0.74
    wall_degrees: float = 3.0  # of the solid angles that are compared
    wall_alike: float = 0.2  # display values, summed over channels: what differs less from a wall is on it
    wall_white: tuple[float, float] = (0.7, 1.05)  # of the way to a wall: what is white from here to there is behind it

    # which pixels lie on planes (`labels`)
    label_window: int = 6  # px, radius
    label_step: int = 2  # px
    label_color: float = 0.12  # display values, summed over channels
    label_free: float = 0.45  # cost of lying on none; one off by two tolerances costs 1
    # skies (`labels`)
    sky_trust: float = 0.02  # of pixels that hang anywhere
    sky_share: float = 0.03  # of pixels, from which there is a sky: 0.17 with one, 0.0006 in a room, 0.005 in a yard
    fog: float = 0.1  # trust of pixels that are left out then: a third, off by 3 to 30 spacings in the median
    sky_white: float = 3.0  # times that of what is white above the horizon, or looks as fog does around
    sky_around: float = 0.04  # of a picture's width, by which that is blurred
    sky_alike: float = 0.08  # display values, in any channel
    sky_known: float = 0.05  # of what is around is fog, in pieces of
    sky_piece: float = 0.02  # of all pixels
    sky_sure: float = 0.9  # trust of what is a surface, however it looks
    sky_rim: int = 2  # pixels beside a sky that are none
    # grounds that go on beneath a sky's fog (`ground`)
    ground_cameras: float = 0.95  # of the cameras, that stand before it
    ground_upright: float = 0.7  # cosine between its normal and what is up for the cameras
    ground_below: float = 4.0  # tolerances: what lies lower is below it
    ground_behind: float = 0.03  # of what is seen, at most, that lies there: 0.0001 of a yard's paving, 0.7 of a table
    ground_step: int = 4  # every fourth pixel of a map, both ways, is a point
    # how such grounds rise and fall: flat, they lose 0.6 dB where paving lies higher than the lawn around it
    ground_sure: float = 0.9  # trust of what tells it
    ground_near: float = 4.0  # tolerances: what lies farther from the plane is no ground
    ground_facing: float = 0.8  # cosine between the plane's normal and its own
    ground_most: float = 6.0  # points of a cell that count
    ground_smooth: float = 6.0  # cells, deviation: 3 and 10 lose 0.2
    ground_fewest: float = 2e-3  # points a cell, below which the plane is the guess
    ground_even: float = 0.5  # tolerances: what rises less is flat; 0 loses 0.15
    ground_fades: float = 12.0  # tolerances from a box's sides, over which it becomes what was seen closer

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
    # of the way from the darkest to the whitest around: from there it is white, as a sky brighter than white is blurred
    # over the edges of bars; half of it makes them thinner by a quarter
    opening_part: float = 0.75
    opening_even: float = 0.1  # a sky's cells differ by less, where no bar is among them
    opening_usual: float = 0.05  # or to the middle one of the views by less: 0.1 takes thin bars from a skylight

    # dark doorways (`lids`)
    lid_dark: float = 0.25  # display value of the greatest channel: a dark room's are 0.02 to 0.2
    lid_masked: float = 0.05  # of the pixels, dark and transparent, from which masks made them so: 0.005 in a room
    lid_held: float = 0.5  # of an opening's rim that is wall

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
    fused_marks: int = 32  # of one pixel, at most, that a view sees along a surface
    fused_foot: float = 0.125  # of the truncation: so near to what lies over it a node seen aslant has its foot, which
    fused_alike: float = 0.95  # (cosine) faces as its pixel does
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
    # ceilings above all pictures (`ceiling`)
    ceiling_over: float = 4 / 3  # of the highest camera's height over the floor
    ceiling_most: float = 2.0  # of that height: what is seen to be higher is no room without one
    ceiling_seen: float = 0.999  # of the surface, that lies lower
    ceiling_upright: float = 0.7  # of the cameras' up, on the mean, that is the floor's
    ceiling_top: float = 0.98  # of a wall, that lies lower: its top is above a quarter of the cameras
    ceiling_across: float = 0.2  # cosine between the normals of floor and walls
    ceiling_ways: int = 72  # in which walls are looked for
    ceiling_steps: int = 16  # up a wall, and over the floor
    # of the ways, at most, in which a wall ends in pictures, or has a window: a kitchen has 0.15, by guessed views 0.4
    ceiling_ended: float = 0.45
    ceiling_shown: float = 0.05  # of what is between the walls up there, at most, that a picture shows
    beyond_cells: int = 200  # along the box's longest side

    # views of a capture (`views`)
    view_yfov: float = 40.0  # degrees, of views from around
    view_inside_yfov: float = 95.0  # degrees, of the six views from a point inside: a cube's faces with some overlap
    view_orbit: int = 33  # views from around
    view_pixels: int = 448  # along the longer side of a view
    view_most: int = 96  # of a capture's cameras that are looked through
    view_least_pixels: int = 160  # along the longer side of one
    view_all_pixels: int = 5_000_000  # of their pictures: what a minute and a half goes over on two cores
    view_upright: float = 0.5  # length of the mean of cameras' ups, below which they are held in all ways
    view_rolled: float = 0.05  # mean square of their rights' cosine with up, above which they are rolled about
    view_one_way: float = 0.97  # length of the mean of where cameras look, above which all look one way (drones: 0.999)
    # of how far away what they show is, from a drone's first strip to its last: 1.1 in one survey; pictures of a thing
    # from the front have 0.3
    view_survey: float = 0.7
    view_border: float = 0.02  # of the longer side, kept free around the splats' centres

    # places inside (`inside`)
    # of the splats, that no view from around shows, from which it is looked at from inside too
    inside_hidden: float = 0.06
    inside_places: int = 5  # to look from
    inside_grid: int = 14  # candidates along each axis
    inside_sample: int = 20_000  # splats that tell what is hidden
    inside_apart: float = 0.6  # of the clearance: the more, the farther places lie from each other
    inside_inner: float = 0.8  # of the box: where places may be

    # what a capture is (`capture`)
    capture_surfel: float = 0.12  # smallest over middle axis, below which splats are discs (fitted scenes 0.02-0.08)
    # of the splats, that are as thin as that: real captures have medians of 0.04 to 0.3, three quarters 0.2
    capture_alike: float = 0.75
    # sine between a disc and the way to its neighbours, above which they lie about a surface: where discs are given
    # 0.00 to 0.12, where an optimiser flattened splats 0.4
    capture_aslant: float = 0.2
    capture_points: float = 1e-4  # of the spacing: splats that are smaller leave no surface between them
    capture_flat: float = 0.5  # smallest over middle axis, below which a splat has a normal of its own
    capture_stray: float = 0.002  # of the splats at either end of an axis, that may be strays
    capture_margin: float = 0.25  # of the box that holds the rest: how far the capture reaches beyond it
    capture_most_splats: int = 1_200_000  # beyond, neighbours are joined
    capture_mixed: int = 16  # a splat and its neighbours, whose mixture tells a blob's normal
    capture_sample: int = 20_000  # splats whose neighbours tell the density

    # pictures of a capture (`capture_views`)
    picture_opaque: float = 0.9  # alpha of pixels by which a picture's exposure is told
    # quantile of the light from which it is: what is dark shows in composites what lies beside it
    picture_bright: float = 0.7
    picture_white: float = 0.955  # linear, display value 0.98: a pixel may have been any brighter
    picture_counts: float = 0.99  # of a pixel of a picture, from which it is taken
    picture_fewest: int = 100  # pixels that tell an exposure
    # of the logarithm: half of the pixels are off by more, if a picture is not of the splats
    picture_unlike: float = 0.35
    # of the logarithm: exposures of half of the pictures lie farther apart, if each has its own
    picture_varied: float = 0.04
    # of the logarithm: all pictures are brighter or darker than the splats by more, if they were changed
    picture_developed: float = 0.2

    # which side of a disc was seen (`sides`)
    side_around: int = 40  # places around a capture
    side_away: float = 3.0  # radii of the capture: how far those are
    side_inside: int = 12  # places inside it
    side_sample: int = 6_000  # discs by which places are chosen
    side_edge_on: float = 0.1  # cosine, below which a place does not tell the sides apart
    # of the discs, that a place may see from the other side than those chosen before: leaves, bars
    side_conflict: float = 0.3
    side_least_new: float = 0.002  # of the discs, that a further place must add
    # of what is seen from inside: where as much is seen from around, it was seen from around
    side_outside_first: float = 0.97
    side_nearest: int = 8  # discs that were seen tell the side of one that was not

    # second sheets (`backs`)
    back_deep: float = 3.0  # how far behind the surface its second sheet stands
    # squares of spacings: less of a second sheet is hidden by chance, as behind the bars of a lantern's cage
    back_crumb: float = 5.0
    back_behind: float = 0.25  # behind the surface, that still counts as seen
    back_level: float = 3.0  # faces of one plane that lie within so much have one second sheet
    back_least: float = 100.0  # squares of spacings: smaller pieces of planes have theirs as things do
    back_cell: float = 0.75  # side of the cells behind planes
    back_voxel: float = 1.5  # corners behind things that share one become one

    # fewer triangles (`decimate`)
    fewer_rim: float = 4.0  # weight of the plane that holds a rim's edge, against that of a square face beside it
    fewer_flipped: float = 0.2  # cosine to its old normal below which a face would have turned over
    fewer_ahead: int = 2  # times as many edges as must go are looked at in a round, the cheapest ones,
    # but no more than one in so many: those between dear ones should not go before cheaper ones elsewhere,
    fewer_divided: int = 4
    fewer_fewest: int = 64  # and no fewer than so many
    fewer_idle: int = 10  # rounds in which next to nothing goes, after which nothing more will
    fewer_rested: int = 4  # rounds after which what was refused is tried again

    # what is looked at (`make`)
    make_pixel: float = 0.66  # smaller pixels see nothing more
    make_fewest_pixels: int = 96  # along the longer side of a view
    # pixels: nothing is told finer, as splats of real captures lie closer and deeper than pictures tell
    make_grain: float = 2.0
    make_least_opaque: float = 0.005  # of the pixels around a capture; less is no surface
    make_least_seen: float = 0.5  # of the splats, that the cameras of their own capture have in their pictures
    make_fog: float = 0.12  # of the capture's radius: splats that blend over such a depth, as a median, are fog
    make_fog_shown: float = 0.19  # the same by its own cameras: white rooms and tables 0.12, which these tell
    make_fog_views: int = 8  # that are asked for that

    # how planes of the whole surface are found (`flats`)
    flat_seeds: int = 200  # points whose own planes are tried, for each plane that is found
    flat_sample: int = 6_000  # points that planes are tried on
    flat_fewest: int = 200  # points, of which planes are made
    flat_step: int = 3  # every third pixel of a map, both ways, is a point
    flat_voxel: float = 0.7  # points in one voxel become one
    flat_rounds: int = 6  # of fitting a plane to what lies on it
    flat_longest: float = 6.0  # cells: how long what of a plane sticks out past another may be
    flat_past: float = 0.1  # cells: how far past the line where it meets another a plane may go
    flat_corner: int = 4  # cells: half of how far from its surface a plane goes on to another

    # what lying on a plane costs (`labels`)
    label_out: float = 1.6  # of a plane where it has no cell
    label_turned: float = 0.3  # 1 - cosine between a pixel's normal and the plane's that costs in full
    # of how deep it blends and the tolerance: what lies farther before a plane is not on it, though little tells where
    # it is, as cars without a pattern
    label_before: float = 1.0
    # of cost, by which a plane must beat none to have a pixel wholly: what rises from it slowly has no step there
    label_sure: float = 0.1
    label_apart: float = 3.0  # tolerances between a pixel and the plane: fog, of which nobody knows where it hangs
    label_dent: float = 6.0  # tolerances behind a plane: what few views see so far behind it is a dent, and none
    label_rounds: int = 3  # of finding where a ray meets a ground that is not flat
    label_facing: float = 0.015  # cosine to the ray below which a plane is not seen

    # what planes look like (`looks`): what looks otherwise is not on them, if depth does not surely say so
    look_places: int = 200_000  # of a plane, at most about so many
    look_fine: int = 4  # along each side of a cell, at most
    look_sure: float = 0.5  # trust of a pixel whose surface lies before a place, by
    look_before: float = 2.5  # times what it may lie off the plane: it does not look at the place
    look_aslant: float = 0.15  # cosine to the view, below which it does not, either
    look_views: int = 4  # that look at a place, to tell
    look_apart: float = 0.12  # display values, summed over channels: half of them differ by less from the median
    # the same, of a pixel from the plane: on it up to here, not on it from twice that
    look_other: float = 0.25
    look_rim: int = 4  # cells around what hides a plane, which may look as that does

    # what cameras saw of a surface (`pictures`)
    seen_cameras: int = 96  # that are looked from; of more, evenly taken ones
    seen_pixels: int = 480  # along the longer side of their pictures
    seen_crack: int = 5  # pixels: gaps of the surface that are narrower are cracks, and nothing was seen through them

    # planes of a mesh (`planes`)
    mesh_planes: int = 24  # at most
    mesh_directions: int = 1500  # tried for normals, over the whole sphere
    mesh_alike: float = 0.985  # cosine between normals of one plane
    mesh_sample: int = 5_000  # faces by which directions are chosen
    mesh_looked_at: int = 100_000  # faces by which planes are

    # parts, holes and smoothing (`tidy`)
    tidy_fewest_faces: int = 200  # of a part that is kept
    tidy_longest_rim: int = 32  # edges around a hole that is closed
    tidy_rounds: int = 8  # of smoothing


TUNING = Tuning()
