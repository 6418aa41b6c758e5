"""What decides a surface made of cells, polygons around discs, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CellTuning:
    """Lengths are in spacings of the splats (the median distance between neighbours) where nothing else is said; local
    ones are those around a disc.

    Decided on captures whose splats are discs on their surface: the scenes of this repository and others of their kind,
    whose true mesh is known, and toys that have one thing alone (`tests/proxy`). `docs/benchmarks/proxies.md` has the
    figures.
    """

    # polygons around discs (`cells`)
    cell_neighbours: int = 20  # that cut a cell
    cell_grown: float = 1.9  # radius of a cell before cutting, in local spacings
    cell_smallest: float = 2.2  # radius, in the capture's spacing
    cell_largest: float = 8.0  # radius, in the capture's spacing
    cell_overlap: float = 1.1  # how far past the bisector a cell reaches: no cracks for light to leak through
    cell_weld: float = 0.2  # of the spacing: corners nearer than that become one
    cell_narrow: float = 0.6  # middle over longest axis, below which a disc lies at an edge or on something thin
    cell_half: float = 1.15  # standard deviations from the middle of an opaque disc, where its alpha passes one half
    # spacings: in the midst of a plane one disc in a voxel of this size stands for the others
    cell_flat_cell: float = 2.5
    cell_flat_neighbours: int = 12  # that must lie on a disc's plane, all around it, for it to be in the midst of one
    # standard deviations that a cell reaches where a sheet of many discs ends: each adds to the alpha
    cell_reach: float = 1.5
    cell_beside: float = 2.5  # local spacings: neighbours nearer than that carry a surface on
    # neighbours that carry it on: a disc with no more lies on a leaf, a slat, a corner, and ends by its own alpha
    cell_few: int = 6
    cell_sector: float = 0.7  # cosine between a direction and that to a neighbour that lies there
    # times the area that is left of a cell when creases cut all across it: by so much more wedges must cover
    cell_split: float = 1.003
    cell_straight: float = 0.05  # spacings: corners of cells that near to the line between those beside them go
    cell_sliver: float = 5e-4  # of the weld's square: triangles of less area go

    # where planes meet (`creases`)
    crease_meets: float = 1.2  # local spacings: how far around its middle a disc ends cells of other planes
    crease_convex: float = 1.5  # times as far, where the crease is an edge: a cell that goes on past it casts shadows
    # local spacings that a cell goes on behind the other where the crease is a corner: nobody sees that
    crease_behind: float = 0.3
    # of the way to the mean of a disc's sheet: where it is asked which side of a line is the disc's own
    crease_inwards: float = 0.3
    crease_on_line: float = 1e-3  # of the spacing: discs that near a neighbour's plane have no side
    crease_wedge_corners: int = 10  # at most

    # what is slender (`slender`)
    slender_wide: float = 1.2  # local spacings: standard deviation of the weights of neighbours
    slender_sheet: float = 0.8  # cosine between normals of discs of one side
    slender_level: float = 0.15  # local spacings: so much may discs of one side lie over each other
    slender_few: int = 3  # discs of one side that a slender rod may have around each
    slender_around: float = 1.5  # local spacings around a disc in which those count
    # local spacings: radius about a line in which the discs of a rod lie, and of the thickest rods
    slender_tube: float = 0.4
    slender_apart: float = 0.25  # local spacings: discs nearer than that do not tell a direction
    slender_fewest: int = 5  # discs that tell a rod
    slender_fit: float = 1.5  # local spacings: as `slender_wide`, where an axis that bends is found
    slender_thickest: float = 0.42  # local spacings: radius of rods that bend
    slender_fewest_bent: int = 6  # discs that tell one
    slender_bent: float = 0.25  # in one over local spacings: bends that are less are those of straight rods
    # share of the normals' squares that must lie across on either side, or the discs are those of a sheet
    slender_turned: float = 0.2
    slender_hardly: float = 0.15  # the same about any axis, by which discs are not asked for
    slender_long: float = 5.0  # radii that a rod goes on at least among a disc's neighbours
    slender_rounds: int = 4  # in which the axis is found, each with less weight on what lies off it
    slender_off: float = 0.5  # of the radius: how far beside the axis a normal's line halves what its disc weighs
    # of the radius: lines farther beside the axis, or planes that much farther out, lie on something else
    slender_astray: float = 0.75
    # local spacings from the axis, and along it either way: only discs of the rod lie there
    slender_free: tuple[float, float] = (1.0, 0.8)
    slender_others: float = 0.15  # share of the weight there that may be others
    slender_open: float = 6.0  # local spacings around a disc, in which no plane is that tells of a free rod
    slender_steps: int = 2  # by which rods go on from where they stand free, each as far as neighbours are
    slender_mates: int = 2  # discs that tell of the same rod, by which a further one is found to lie on it

    # rods (`rods`)
    rod_near: float = 0.6  # local spacings: standard deviation of the weights by which neighbours tell the axis
    rod_along_axis: float = 0.06  # share of the normals' squares that may lie along the axis
    rod_turned: float = 0.12  # share that must lie across it on either side, or the discs are those of a sheet
    rod_round: float = 0.8  # of the discs' spread along the axis: how far from it they may lie
    rod_upright: float = 0.3  # cosine between a disc's normal and the axis, above which it closes the rod's end
    rod_facing: float = 0.7  # cosine, from which a neighbour's plane tells how far out a side is
    rod_heard: float = 0.02  # of the largest weight: neighbours below it do not
    rod_sheet: float = 0.8  # cosine between normals of discs of one side
    # local spacings: a disc of the same side that near across the axis means that it is no bar
    rod_beside: float = 1.5
    rod_agreed: float = 0.6  # of what is around a disc on a rod: how much must be on one, too
    # of a rod's width: it is no flatter, but was seen from one side alone, and is as deep as wide
    rod_one_sided: float = 0.2
    rod_stray: float = 3.0  # times the discs' distance from the axis: neighbours farther off lie on something else
    rod_sides: int = 8  # of a slender rod
    rod_faces: float = 0.6  # cosine, from which a plane tells how far out a corner of it is
    rod_sharp: int = 8  # power of that cosine that planes weigh by
    rod_ahead: float = 0.25  # local spacings: a disc that much farther along carries the rod on
    # of the way to it: how far a prism goes, so that they meet, and do not stick out where the rod bends
    rod_half_way: float = 0.6

    # rods that bend (`bent`)
    bent_ways: int = 12  # of the axis that are tried, over half a turn
    bent_depths: tuple[float, ...] = (0.12, 0.2, 0.3, 0.4)  # local spacings: radii that are tried
    bent_reach: float = 2.5  # local spacings along the axis in which discs count
    bent_tightest: float = 2.0  # local spacings: about the radius of the tightest bend
    bent_lax: float = 0.15  # local spacings from a tried axis that are granted, besides its bend
    bent_turn: float = 0.15  # cosine between a normal and a tried axis that is granted, besides its bend
    # cosine between a normal and the axis, above which a disc does not lie on the rod's sides
    bent_upright: float = 0.3
    # of the neighbours' weight that must lie about the best way, or there is no rod to be fitted
    bent_agreeing: float = 0.5
    bent_rounds: int = 6  # of the fit, each with less weight on what lies off the axis
    bent_off: float = 0.5  # of the radius: how far from the axis a moved disc counts half
    bent_slack: float = 0.1  # local spacings that are granted besides
    # of the unknowns, in local spacings
    bent_damping: tuple[float, ...] = (1e-6, 1e-6, 1e-3, 1e-3, 3e-3, 3e-3, 1e-4)

    # which discs lie on one surface (`discs`)
    disc_same_plane: float = 0.8  # cosine between their normals
    # rise over run to a disc of the same normal, above which it lies on another level: in a groove, on a step
    disc_steep: float = 0.1
    disc_level: float = 0.1  # of the spacing: so much more must it rise

    # discs that are turned out of their surface (`turned`), in five rounds of fitting
    turned_sample: int = 20_000  # discs by which it is told whether most are
    # degrees in the median between their planes and those of their neighbours: 0.2 to 1.7 of true ones, 5.4 to 6.5 of
    # trained ones
    turned_least: float = 3.0
    turned_wide: float = 1.8  # local spacings: standard deviation of the weights of neighbours
    turned_off: tuple[float, ...] = (0.5, 0.35, 0.25, 0.15, 0.15)  # local spacings off a plane: weighs a quarter
    turned_sine: tuple[float, ...] = (0.6, 0.5, 0.4, 0.3, 0.3)  # of the angle between normals: weighs a quarter
    turned_own: float = 0.32  # local spacings off its plane that weigh as much as a normal at right angles to it


CELLS = CellTuning()
