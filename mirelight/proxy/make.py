"""A proxy from splats alone."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from mirelight.base.errors import InputError
from mirelight.base.progress import ShareProgress, part, passed, quiet
from mirelight.base.together import each
from mirelight.lighting.sight import Sight
from mirelight.model import F64, Camera, ProxyMesh, SplatCloud
from mirelight.proxy.capture import Capture, density, look_at_capture
from mirelight.proxy.cells import cells_of
from mirelight.proxy.decimate import decimated
from mirelight.proxy.dents import filled
from mirelight.proxy.depth import DepthMap, DepthMaps, footprint, shows
from mirelight.proxy.detail import Core, closer, core_of, others, with_core, without_fog
from mirelight.proxy.detail_tuning import DETAIL
from mirelight.proxy.ends import ended
from mirelight.proxy.flats import Flat, even, flats_of, on_flats
from mirelight.proxy.foot import foot_of
from mirelight.proxy.fusion import Grid, fuse
from mirelight.proxy.ground import carried_on, ground_of, outside
from mirelight.proxy.guessed import Guess, taken_from
from mirelight.proxy.inside import hidden_share, places
from mirelight.proxy.judge import judged, seen_by
from mirelight.proxy.labels import flattened, labelled
from mirelight.proxy.lids import closed_by, covered, lids_of
from mirelight.proxy.looks import Look
from mirelight.proxy.mirrors import mirroring, mirrors_of
from mirelight.proxy.nets import surface_of
from mirelight.proxy.one_picture import without_far
from mirelight.proxy.openings import opened, windows_of
from mirelight.proxy.plain import plain_of
from mirelight.proxy.skies import Sky, fog_of
from mirelight.proxy.slanted import slanted
from mirelight.proxy.stereo import agreed
from mirelight.proxy.sweep import Sweep
from mirelight.proxy.things import Things
from mirelight.proxy.tidy import closed, smoothed, without_crumbs
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import MadeProxy, Method, ProxySettings, Soup
from mirelight.proxy.unseen import Walls, closing
from mirelight.proxy.upright import Seen, levelled, upright
from mirelight.proxy.views import around, fewer, from_points, held_up, moved
from mirelight.proxy.walls import hung, room_of

DEPTHS = "taking depth maps"
_DEFAULT = ProxySettings()
_UPRIGHT = np.array([0.0, 1.0, 0.0])  # of jobs; files have it the other way round, mostly, which is the same axis


def make(
    splats: SplatCloud,
    settings: ProxySettings = _DEFAULT,
    progress: ShareProgress | None = None,
    *,
    cameras: Sequence[Camera] = (),
    source: str | Path = "splats",
    guess: Guess | None = None,
) -> MadeProxy:
    """A triangle mesh that stands for the surface of splats.

    Discs (fitted surfels) become cells: pieces of their planes, cut by their neighbours. Other captures are looked at
    through their cameras; where those are not known, through such as their view-dependent colours tell of, or from
    around. The depth maps are smoothed, moved onto the planes that they show, and fused. Where cameras are known or
    told, depths are put right by what is seen from there, and what was not seen is closed against light. The mesh is
    decided, to the bit, by the splats, by the cameras, known or guessed, and by the settings other than `threads`.

    Args:
        splats: the capture, in world space.
        settings: how.
        progress: hears what is being done.
        cameras: those of the capture's pictures, in world space; none: they are guessed, and where that fails what was
            not seen stays open.
        source: whom to name in an error, usually the splats' file.
        guess: gives the cameras that are guessed, in world space; None: that is done now.

    Raises:
        InputError: splats that have no surface: too few, transparent, fog, too far from the origin; cameras that are
            another capture's.
        BackendError: the variant cannot run here.
        RenderError: not enough memory.
    """
    report, began = progress or quiet, time.monotonic()
    report("looking at the splats", 0.0)
    capture = look_at_capture(splats, source)
    method, walls = _method(capture, settings), Walls()
    there = [moved(camera, -capture.middle) for camera in cameras]
    refuse_strangers(capture, there, source)
    if method == "cells":
        maps = DepthMaps(capture, settings)
        soup, shown, mirrors = cells_of(capture, settings, part(report, 0.05, 0.9)), list[DepthMap](), list[Flat]()
    else:
        if not there and settings.views == "auto":
            report("guessing where it was taken from", 0.02)
            told = guess() if guess else taken_from(splats, settings)
            there = [moved(camera, -capture.middle) for camera in told]
        if len(there) == 1:
            capture, there = _of_one_picture(splats, moved(there[0], capture.middle), source)
        through = fewer(there) if there else _around(capture)
        capture = replace(
            capture, spacing=max(capture.spacing, TUNING.make_grain * footprint(through, capture.splats.means))
        )
        maps = DepthMaps(capture, settings)
        views = [maps.of(camera) for camera in passed(through, part(report, 0.05, 0.3), DEPTHS)]
        _refuse_depth(capture, maps, views, len(cameras), source)
        if not there:
            views += _inside(capture, maps, views, settings, part(report, 0.3, 0.4))
        smooth = partial(slanted, noise=capture.spacing)
        views = each(smooth, views, part(report, 0.4, 0.43), "smoothing depth maps")
        if there:
            views = agreed(views, settings, capture.spacing, part(report, 0.43, 0.55), guessed=not cameras)
        up = _stands(views, cameras, around=not there)
        found = _fused(capture, views, up, part(report, 0.55, 0.75), guessed=not cameras)
        soup, shown, mirrors, walls = found.soup, found.shown, found.mirrors, found.walls
        if there and (core := core_of(capture, there, found.cell / TUNING.cell)):
            soup = _detailed(capture, core, found, settings, part(report, 0.75, 0.9), guessed=not cameras)
    if not len(soup.faces):
        raise InputError(source, "no surface was found in it", "a capture of fog or of scattered splats has no proxy")
    if settings.triangles is not None:
        report("leaving out triangles", 0.92)
        soup = decimated(soup, settings.triangles)
    report("judging the proxy", 0.9)
    mesh = soup.mesh()
    sight = Sight(mesh, settings.variant, settings.threads)
    quality = judged(capture, maps, mesh, sight, seen_by(there) if there else None, settings, there)
    whole, ceiling = soup, None
    if there:
        # how high people held their cameras is told by these or by colours, not by where it looks clear
        known = settings.ceiling and (bool(cameras) or splats.sh_degree > 0)
        walls, last = replace(walls, ceiling=walls.ceiling and known), part(report, 0.95, 1.0)
        added = closing(soup, sight, there, capture.spacing, last, shown, walls=walls, guessed=not cameras)
        whole, ceiling = soup.beside(added.soup), added.ceiling
    return MadeProxy(
        mesh=_placed(whole, mirrors, capture),
        method=method,
        quality=quality,
        unseen=len(whole.faces) - len(soup.faces),
        mirrors=len(mirrors),
        ceiling=None if ceiling is None else ceiling.height - ceiling.floor,
        guessed=0 if cameras else len(there),
        seconds=time.monotonic() - began,
    )


def _placed(soup: Soup, mirrors: Sequence[Flat], capture: Capture) -> ProxyMesh:
    """A surface in world space, its mirrors known."""
    placed = Soup(soup.vertices + capture.middle, soup.faces).mesh()
    return placed.with_mirrors(mirroring(soup, mirrors, capture.spacing)) if mirrors else placed


def refuse_fog(splats: SplatCloud, source: str | Path, progress: ShareProgress = quiet) -> None:
    """What :func:`make` does before it makes anything of splats: a look at them from around.

    Raises:
        InputError: splats that have no surface: too few, transparent, fog, too far from the origin.
        BackendError: the variant cannot run here.
    """
    capture = look_at_capture(splats, source)
    if _method(capture, _DEFAULT) == "depth":
        maps = DepthMaps(capture, _DEFAULT)
        views = [maps.of(camera) for camera in passed(_around(capture), progress, DEPTHS)]
        _refuse_depth(capture, maps, views, 0, source)


def _method(capture: Capture, settings: ProxySettings) -> Method:
    return settings.method if settings.method != "auto" else "cells" if capture.surfels else "depth"


@dataclass(frozen=True, slots=True, eq=False)
class _Fused:
    """A surface, and what it was made of."""

    soup: Soup
    cell: float  # of the grid that it was found in, world units
    views: list[DepthMap]  # as they were joined
    flats: list[Flat]  # but walls that are guessed
    mirrors: list[Flat]
    sky: Sky
    sweep: Sweep
    room: bool  # one with windows
    walls: Walls  # a ceiling: where none are guessed, or views show them as high as eyes

    @property
    def shown(self) -> list[DepthMap]:
        """What tells which space is open: where there is a sky, the surface alone.

        In a room with windows, which are known, all else is shut: what is dark needs no splats before black.
        """
        if self.sky.fog:
            return []
        return [replace(view, alpha=np.ones_like(view.alpha)) for view in self.views] if self.room else self.views


def _of_one_picture(splats: SplatCloud, camera: Camera, source: str | Path) -> tuple[Capture, list[Camera]]:
    """What a picture shows but its sky, and its camera, world space to the capture's."""
    capture = look_at_capture(without_far(splats, (camera,)), source)
    return capture, [moved(camera, -capture.middle)]


def _stands(views: Sequence[DepthMap], cameras: Sequence[Camera], *, around: bool) -> F64 | None:
    """(3,) unit: which way is up for cameras and what views show, be they theirs, guessed or from around; None where it
    is not sure."""
    seen = Seen.of(views, around=around)
    held = held_up(cameras, seen.at)
    if held is not None:
        return levelled(seen, held)
    found = upright(seen, _UPRIGHT if around else None)
    return found.way if found and not found.doubt else None


def _fused(capture: Capture, views: list[DepthMap], up: F64 | None, report: ShareProgress, *, guessed: bool) -> _Fused:
    """By smoothed depth maps, each point of the surface in some of them; `up` (3,) unit, None: not known. What guessed
    views show agrees where the splats are, as no picture was taken from there."""
    report("finding planes", 0.0)
    flats = flats_of(views, capture.spacing, capture.radius)
    if mirrors := mirrors_of(views, flats, capture.spacing):
        views = each(lambda view: covered(view, mirrors.values(), capture.spacing), views)
        flats = closed_by(flats, mirrors)
    room = None if guessed else room_of(views, even(flats, views, capture.spacing, capture.radius), up)
    walls = room.flats(views, capture.spacing) if room else list[Flat]()
    flats, sides = room.floored(flats, walls) if room else (flats, walls)
    ends = Walls(room.is_shown_level(views), room.top) if room else Walls()
    looked = each(room.shone, views) if room else views
    windows = windows_of(looked, [*flats, *sides], capture.spacing, up if room else None)
    if room:
        windows = [x for x in windows if x.wall not in walls or room.lets_in(x)]
        views = each(room.sunlit, views)
    if windows:
        away = TUNING.opening_away * capture.radius
        pairs = list(zip(views, looked, strict=True))
        views = each(lambda pair: opened(*pair, windows, capture.spacing, away), pairs)
        flats = flats_of(views, capture.spacing, capture.radius)
        flats, sides = room.floored(flats, walls) if room else (flats, walls)
    sweep = Sweep.of([] if guessed else views, flats, capture.spacing)
    views, flats = each(sweep.moved, views), sweep.flats
    sky = Sky(0.0 if room and not room.cut else fog_of(views, flats), up)
    if not (room or sky.fog or guessed):
        flats = [*flats, *plain_of(views, flats, capture.spacing, capture.radius)]
    if windows and (lids := lids_of(views, flats, capture.spacing)):
        views = each(lambda view: covered(view, lids.values(), capture.spacing), views)
        flats = closed_by(flats, lids)
    if sky.fog and not room:
        flats = _with_ground(capture, views, flats, up, guessed=guessed)
    own = len(walls) - len(sides)  # the room's floor, if it is seen
    flats = [*flats[:own], *even(flats[own:], views, capture.spacing, capture.radius)]
    flats, many = ended([*flats, *sides]), len(flats)
    guesses = [*range(own), *range(many, len(flats))]
    views = _on_planes(views, flats, capture.spacing, sky, part(report, 0.2, 0.3), walls=guesses)
    grid = fuse(views, capture.half, TUNING.cell * capture.spacing, part(report, 0.3, 0.8), up=up)
    report("finding the surface", 0.8)
    soup = _surface(grid, flats)
    for more in (*(x.solid() for x in windows), *(outside(x, capture.half) for x in flats if x.lift is not None)):
        soup = soup.beside(more)
    kept = [sweep.along(mirror) for mirror in mirrors.values()]
    return _Fused(soup, grid.cell, views, flats[:many], kept, sky, sweep, bool(windows), ends)


def _with_ground(
    capture: Capture, views: Sequence[DepthMap], flats: list[Flat], up: F64 | None, *, guessed: bool
) -> list[Flat]:
    """The planes of a capture with a sky, its ground beneath all that views tell nothing of."""
    tolerance = TUNING.plane_tolerance * capture.spacing
    at = ground_of(flats, views, tolerance, up)
    if at is not None:
        return carried_on(flats, at, views, tolerance)
    foot = None if guessed or up is None else foot_of(views, capture.spacing, capture.radius, up)
    return flats if foot is None else [foot, *flats]


def _on_planes(
    views: Sequence[DepthMap],
    flats: Sequence[Flat],
    spacing: float,
    sky: Sky,
    report: ShareProgress,
    walls: Sequence[int] = (),
) -> list[DepthMap]:
    """The views with the pixels that lie on planes moved onto them; `walls`: those that are sides of a room."""
    tolerance = TUNING.plane_tolerance * spacing
    colors, moves = part(report, 0.0, 0.5), part(report, 0.5, 1.0)
    looks = each(lambda flat: Look.of(flat, views, spacing), flats, colors, "reading planes' colours")
    things = {k: Things.on(flat, views, spacing) for k, flat in enumerate(flats) if flat.lift is not None}
    looks = [x.with_hidden(things[k].hidden) if k in things else x for k, x in enumerate(looks)]
    labels = each(lambda view: labelled(view, flats, tolerance, looks), views, moves, "moving pixels onto planes")
    labels = filled(views, labels, flats, tolerance)
    if walls:
        labels = hung(views, labels, flats, walls)
    pairs = list(zip(views, labels, strict=True))
    for k, own in things.items():
        pairs = each(partial(own.kept, look=looks[k], k=k, none=len(flats)), pairs)
    return each(lambda pair: flattened(pair[0], flats, tolerance, sky, pair[1]), pairs)


def _surface(grid: Grid, flats: Sequence[Flat]) -> Soup:
    return on_flats(smoothed(closed(without_crumbs(surface_of(grid)))), flats, grid.cell)


def _detailed(
    capture: Capture,
    core: Core,
    found: _Fused,
    settings: ProxySettings,
    report: ShareProgress,
    *,
    guessed: bool,
) -> Soup:
    """The surface with what most pictures show in cells of its own."""
    report("looking closer", 0.0)
    margin = DETAIL.detail_margin * capture.spacing
    maps = DepthMaps(replace(capture, spacing=core.spacing), settings)
    shown = [maps.of(camera) for camera in passed(core.cameras, part(report, 0.0, 0.15), DEPTHS)]
    whole = each(lambda view: slanted(view, core.spacing), shown, part(report, 0.15, 0.2), "smoothing depth maps")
    views = each(lambda view: core.alone(view, margin), whole)
    if found.mirrors:
        views = each(lambda view: covered(view, found.mirrors, core.spacing), views)
    views = agreed(views, settings, core.spacing, part(report, 0.2, 0.5), guessed=guessed)
    views = each(found.sweep.moved, views)
    tolerance, side = TUNING.plane_tolerance * core.spacing, TUNING.plane_cell * core.spacing
    more = even(flats_of(views, core.spacing, capture.radius), views, core.spacing, capture.radius)
    more = others(more, found.flats, TUNING.plane_tolerance * capture.spacing)
    views = each(lambda pair: core.amid(*pair), list(zip(views, whole, strict=True)))
    flats = ended([*(closer(flat, core.low, core.high, side, views, tolerance) for flat in found.flats), *more])
    # most pictures show all that is here: what tells no place in one, such as smooth plastic, is no sky
    around = [*flats, *(core.beside(flat) for flat in found.flats)]
    views = _on_planes(views, around, core.spacing, Sky(0.0), part(report, 0.5, 0.6))
    views = each(lambda view: core.alone(view, margin), views)
    grid = fuse(views, core.half + margin, TUNING.cell * core.spacing, part(report, 0.6, 1.0), core.middle)
    fine = without_fog(_surface(grid, flats), views, core.spacing)
    return with_core(found.soup, fine, core, found.cell)


def _inside(
    capture: Capture, maps: DepthMaps, outer: list[DepthMap], settings: ProxySettings, report: ShareProgress
) -> list[DepthMap]:
    """Views from inside a capture whose cameras are not known, where those from around miss much."""
    hidden = hidden_share(capture, outer)
    if settings.views != "inside" and (settings.views == "around" or hidden <= TUNING.inside_hidden):
        return []
    pixels = max(max(x.camera.width, x.camera.height) for x in outer)
    looked = from_points(places(capture), pixels, 1e-3 * capture.radius)
    inner = [maps.of(camera) for camera in passed(looked, report, DEPTHS)]
    # else it is hidden in the solid
    return inner if settings.views == "inside" or hidden_share(capture, outer + inner) < 0.5 * hidden else []


def refuse_strangers(capture: Capture, cameras: Sequence[Camera], source: str | Path) -> None:
    """Raises InputError: cameras that are another capture's, as they have little of this one in their pictures.

    How much of a proxy they see tells nothing: the far sides of a room's walls are none of theirs. Nor do splats far
    from all others, as many as they may be: what was seen is dense.
    """
    if not cameras:
        return
    means, some = capture.splats.means, slice(None, None, max(len(capture.splats) // TUNING.capture_sample, 1))
    shown = np.zeros(len(means[some]), bool)
    for camera in cameras:
        shown |= shows(camera, means[some])
    weight = capture.splats.opacities[some] * density(means.astype(np.float64), means[some].astype(np.float64))
    seen = float(weight[shown].sum() / weight.sum())
    if seen < TUNING.make_least_seen:
        found = f"its {len(cameras):,} cameras have {seen:.0%} of it in their pictures"
        remedy = "give the cameras of this capture, in its own axes (the splats' world may be a trainer's); or none"
        raise InputError(source, found, remedy)


def _around(capture: Capture) -> tuple[Camera, ...]:
    """Views from around, whose pixels are as fine as splats lie, up to a bound."""
    pixels = np.clip(
        2 * capture.half.max() / (TUNING.make_pixel * capture.spacing), TUNING.make_fewest_pixels, TUNING.view_pixels
    )
    return around(capture.splats.means, capture.radius, TUNING.view_orbit, int(pixels))


def _refuse_depth(capture: Capture, maps: DepthMaps, views: list[DepthMap], cameras: int, source: str | Path) -> None:
    """`cameras`: how many the capture has; 0: views are from around."""
    opaque = np.array([float((view.alpha > TUNING.depth_opaque).mean()) for view in views])
    remedy = "a capture of fog or of scattered splats has no proxy; give a mesh"
    if opaque.mean() < TUNING.make_least_opaque:
        if cameras:
            found = f"in the pictures of its {cameras:,} cameras {opaque.mean():.1%} of the pixels are opaque"
            raise InputError(source, found, "give the cameras of this capture, in its own axes and units; or none")
        raise InputError(source, f"no surface: {opaque.mean():.1%} of the pixels around it are opaque", remedy)
    few = views[:: -(-len(views) // TUNING.make_fog_views)]
    spread = float(np.median([np.median(x) for view in few if len(x := maps.blended_over(view.camera))]))
    spread /= capture.radius
    if spread > (TUNING.make_fog_shown if cameras else TUNING.make_fog):
        raise InputError(source, f"no surface: splats blend over a depth of {spread:.0%} of its radius", remedy)
