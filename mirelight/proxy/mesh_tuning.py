"""What decides how a mesh is judged, and moved onto splats, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshTuning:
    """Lengths are in spacings of the splats (the median distance between neighbours) where nothing else is said; "of"
    something is a share of it.

    Decided on meshes of captures whose true surface is known: true ones, swollen ones, ones that were moved, and
    proxies. `docs/benchmarks/proxies.md` has the figures.
    """

    # what a mesh is judged by (`judge`)
    judge_views: int = 12  # looked from, without cameras
    judge_waves: int = 6  # of these, by which planes are told
    judge_pixels: int = 256  # along a view's longer side, at most
    judge_empty: float = 0.1  # alpha below which a pixel shows no splats
    # trust in a pixel's depth, from which it shows a surface: else an exact mesh under a sky misses 21, not 4 %
    judge_sure: float = 0.2
    judge_near: float = 3.0  # along the view: where mesh and splats are so near to each other normals compare
    judge_fewest: int = 50  # pixels on a plane
    # of the pixels, that a plane has: slices of a biker have up to 0.02, walls of a room from 0.05 on
    judge_large: float = 0.04
    judge_even: float = 0.05  # deviation from a plane: less is flat, however it bends
    # of the variance about a plane, that a quadric leaves: with less it is the cap of something round
    judge_bent: float = 0.5

    # when a mesh is said to misfit (`advice`)
    # of the splats' pixels, that a right proxy may leave off (right ones 3-13 %, wrong ones 24 % up)
    advice_uncovered: float = 0.18
    advice_gap: float = 0.004  # of the capture's size, as a median: 1 % of error costs relighting 11 dB
    # of the mesh's pixels, past the splats: a right one may have what no camera saw (measured: 28 %)
    advice_leaks: float = 0.5
    advice_waves: float = 5.0  # degrees, median (exact proxies 0.3 to 0.6, with noise of 0.2 % of the size 11)
    advice_apart: float = 1.5  # of how far the splats' own surface is from where pictures agree,
    advice_least_apart: float = 1e-3  # and of the capture's size
    # share of the splats, more of which float if they lie so far off the mesh, in sizes of the capture: 1 to 4 % of
    # those of trained captures do, and 79 % of a room's in a cloud of four times as many
    advice_floating: float = 0.5
    advice_float: float = 0.02
    advice_surface: int = 100_000  # points of the mesh that tell it
    advice_points: int = 6_000  # on each side of a comparison
    advice_better: float = 0.5  # a guess must lower the distance to this share to be worth saying

    # whether pictures agree on a mesh (`agreement`)
    agree_views: int = 6  # that others are compared with, evenly taken
    agree_beside: int = 2  # nearest others that each is compared with
    agree_pixels: int = 192  # along the longer side of a picture
    agree_window: int = 7  # px, side of what is compared
    # of the capture's size: ways along the view that are tried
    agree_steps: tuple[float, ...] = (-0.02, -0.01, -0.005, 0.0, 0.005, 0.01, 0.02)
    agree_fewest: int = 300  # pixels that tell something, below which nothing is said
    agree_contrast: float = 0.02  # standard deviation of display values in a window that tells a place
    agree_whole: float = 0.8  # of a window, that both views must show
    agree_clear: float = 0.6  # how well views agree where they do best (correlation),
    agree_peak: float = 0.3  # and how much better than where they do worst
    # of the capture's size: what lies so far behind the mesh in another view is hidden there
    agree_hidden: float = 0.01
    # of a distance: what views that look at right angles to each other are taken as farther apart by
    agree_ahead: float = 4.0

    # a mesh moved onto discs (`register`)
    register_rounds: int = 5  # of moving vertices
    register_widest: float = 6.0  # how far around a vertex splats count in the first round,
    register_narrowest: float = 1.2  # and in the last
    register_steps: int = 40  # of the alignment as a whole, at most
    register_enough: float = 3e-4  # of the misfit: steps that take less away end it
    # of the misfit, which moving vertices must take away: less is the splats' noise, and things no mesh has
    register_gain: float = 0.3
    # of the misfit, which a swelling must take away: splats that were trained are off by as much anyway
    register_swollen: float = 0.02
    register_splats: int = 30_000  # that the whole is aligned by
    register_points: int = 60_000  # of the mesh that they are compared with
    register_planes: int = 24  # nearest splats that move a vertex
    # how much vertices resist, relative to the planes: keeps them from sliding where only one plane pulls
    register_stay: float = 0.02
    register_spread: int = 30  # rounds in which vertices without splats take their neighbours' way

    # a mesh moved onto depth maps (`sighted`)
    sighted_most_rays: int = 120_000  # pixels that are looked along, evenly taken
    sighted_rounds: int = 10  # of looking and moving, at most
    sighted_sharp: float = 0.5  # what lies as far off counts half, in the end
    sighted_better: float = 0.05  # of the misfit, which a way to move must take away for each that is simpler


MESH = MeshTuning()
