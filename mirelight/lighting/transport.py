"""How light goes from cell to cell of a surface, found once without any light; then any light is sums along it.

Every cell sends out cosine-distributed rays. Where they end (a cell and the albedo there, or the sky) does not depend
on the lights, so that is kept. For a lighting, each cell's own light is sampled, what the rays that end in the sky
bring is looked up there, and reflected light is gathered along the others, bounce by bounce. So another picture of the
sky, another rotation, another sun or lamp asks for no new rays between surfaces.

A ray that ends on a place without a cell goes on from there, and few such places stand for all that a cell's rays end
on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirelight.base.progress import CountProgress
from mirelight.lighting import sky_guiding
from mirelight.lighting.cell_reading import on_device
from mirelight.lighting.develop import refuse_if_too_large, refuse_if_too_many, refuse_if_too_many_rays
from mirelight.lighting.frame import PASS, FrameInProgress, LitProxy, Passes
from mirelight.lighting.layers import Layers
from mirelight.model import (
    F32,
    I32,
    Camera,
    CellLight,
    RenderSettings,
    SurfaceCache,
    SurfaceCells,
    SurfaceTransport,
)
from mirelight.model.surface_cache import LOST, NOTHING

if TYPE_CHECKING:
    from mirelight.lighting.kernel.cell_points import Pieces
    from mirelight.lighting.kernel.proxy import DeviceProxy
    from mirelight.lighting.kernel.types import Float

MOST_RAYS, FEWEST = 1 << 25, 16  # of all cells, 8 bytes each; of one
STAND_INS = 2  # places without a cell that stand for all that half of a cell's rays end on
BEYOND = 4  # hits of a ray that goes on without a cell
DIRECT = PASS  # samples of a cell's own light of lamps in each half
GLOWING = 8 * PASS  # and of what glows, which is seen under many directions
BEYOND_DIRECT = 4  # and of a place without a cell
PARTS = 8  # of the rays: each bounce but the last takes one of them, in turn
ROUNDS = 2  # of them
MOST_LEFT = 0.9  # of the light that a round brings, by the next: in a closed white room there is no end to it

Words = NDArray[np.uint32]


@dataclass(frozen=True, slots=True, eq=False)
class _Places:
    """Places without a cell; shapes as of `SurfaceTransport`."""

    faces: I32
    corners: F32
    normals: F32

    @staticmethod
    def joined(parts: list[_Places]) -> _Places:
        none = _Places(np.zeros((0, 1), np.int32), np.zeros((0, 1, 2), np.float32), np.zeros((0, 1, 3), np.float32))
        rows = [none, *parts]
        return _Places(*(np.concatenate([getattr(x, name) for x in rows]) for name in _Places.__slots__))


def size_of_links(cells: int, rays: int) -> int:
    """About how many bytes a `SurfaceTransport` takes whose cells have all the places without one that they may."""
    return cells * (8 * _rays_of_each(cells, rays) + 2 * STAND_INS * 32)


def _rays_of_each(cells: int, rays: int) -> int:
    return max(min(rays, 1 << max(MOST_RAYS // max(cells, 1), 1).bit_length() - 1), FEWEST)


def trace_links(
    surface: DeviceProxy, cells: SurfaceCells, settings: RenderSettings, rays: int, progress: CountProgress
) -> SurfaceTransport:
    """Where the rays of every cell end.

    Args:
        surface: the proxy on the device.
        cells: of that proxy.
        settings: seed and memory count.
        rays: of each cell, a power of two; fewer where cells are many.
        progress: called with rays done and in all.

    Raises:
        RenderError: they do not fit in memory.
    """
    from mirelight.lighting.kernel.cell_points import CellPoints
    from mirelight.lighting.kernel.transport import LANES, cast

    count, seed = len(cells), (settings.seed + 0x51F15EED) & 0xFFFFFFFF
    each = _rays_of_each(count, rays)
    refuse_if_too_many_rays(count * each, settings.max_memory)
    table, points = on_device(cells, np.zeros((1, 1, 3), np.float32)), CellPoints(cells)
    target, albedo = np.zeros((2, each, count), np.uint32)
    parts, nodes = list[_Places](), count
    step = LANES // each
    for first in range(0, count, step):
        some = min(step, count - first)
        ends, lost = _merge_lost_ends(*cast(surface, table, points, seed, first, some, each), each // 2, nodes)
        target[:, first : first + some], albedo[:, first : first + some] = ends.reshape(2, some, each).swapaxes(1, 2)
        parts.append(lost)
        nodes += len(lost.faces)
        progress((first + some) * each, count * each)
    onwards = [np.zeros((2, 0), np.uint32)]
    new = _Places.joined(parts)
    parts = [new]
    for hit in range(BEYOND):
        if not len(new.faces):
            break
        rays_on = cast(surface, table, CellPoints(new), seed + hit + 1, 0, len(new.faces), 1)
        ends, new = _merge_lost_ends(*rays_on, 1, nodes)
        if hit == BEYOND - 1:  # the end
            ends[0][(ends[0] >= nodes) & (ends[0] < NOTHING)] = NOTHING
        else:
            parts.append(new)
            nodes += len(new.faces)
        onwards.append(ends)
    beyond, places = np.concatenate(onwards, axis=1), _Places.joined(parts)
    return SurfaceTransport(
        seed=seed,
        target=target,
        albedo=albedo,
        faces=places.faces,
        corners=places.corners,
        normals=places.normals,
        beyond=beyond[0],
        beyond_albedo=beyond[1],
    )


def _merge_lost_ends(ends: Words, face: Words, where: F32, of_half: int, nodes: int) -> tuple[Words, _Places]:
    """Ends of rays (2, n) whose places without a cell are nodes from `nodes` on, and those places.

    Of the rays of half a cell, `of_half` next to each other, all that end on such places share STAND_INS of them.
    """
    target = ends[0].reshape(-1, of_half)
    lost = target == LOST
    rank = np.cumsum(lost, axis=1, dtype=np.int64) - 1
    few = np.minimum(rank[:, -1:] + 1, STAND_INS)
    first = np.cumsum(few) - few[:, 0]
    chosen = np.flatnonzero((lost & (rank < few)).ravel())
    row, column = np.nonzero(lost)
    index = first[row] + rank[row, column] % few[row, 0]
    flat = row * of_half + column
    out = ends.copy()
    out[0, flat] = nodes + index
    out[1, flat] = ends[1, chosen[index]]
    way = where[chosen]
    places = _Places(face[chosen, None].astype(np.int32), way[:, None, 0:2], -way[:, None, 2:5])
    return out, places


class _Own(NamedTuple):
    """What falls on n pieces of the surface at once, irradiance / pi."""

    direct: F32  # (K, n, 3) sampled towards each of K lights
    sky: F32  # (n, 3) that reflected rays meet
    glow: F32  # (n, 3)


def gather(
    lit: LitProxy,
    cells: SurfaceCells,
    transport: SurfaceTransport,
    settings: RenderSettings,
    progress: CountProgress,
) -> SurfaceCache:
    """Light of a lighting on every cell.

    Args:
        lit: the proxy under the lighting.
        cells: of that proxy.
        transport: between those cells.
        settings: seed counts.
        progress: called with samples done and in all.

    Raises:
        RenderError: the light of so many cells does not fit in memory.
    """
    from mirelight.lighting.kernel.cell_points import CellPoints
    from mirelight.lighting.kernel.sky import Sky
    from mirelight.lighting.kernel.transport import DeviceLinks

    lighting, layers, n = lit.lighting, Layers.of(lit.lighting, emissive=lit.emission), len(cells)
    count, around, outside = len(layers.names), layers.environment, lighting.environment is not None
    direct, first_bounce = np.zeros((2, 2, count, n, 3), np.float32)
    if not count or not n:
        return _cache(cells, lit, direct, first_bounce, direct)
    refuse_if_too_many(transport.nodes, count + 2, settings.max_memory)
    # apart, so that each has the same bits with and without the others
    lamps = replace(lit, lighting=replace(lighting, environment=None), sky=Sky(None), emission=False)
    sky = replace(lit, lighting=replace(lighting, lights=()), emission=False)
    glow = replace(lit, lighting=replace(lighting, lights=(), environment=None), sky=Sky(None))
    of_lamps = slice(0, count - outside - lit.emission)
    done, total = 0, 2 * n * (DIRECT * bool(lighting.lights) + GLOWING * lit.emission)

    def own(source: LitProxy, of: Pieces, samples: int, number: int) -> _Own:
        nonlocal done
        made = _own(source, of, settings, samples, number, lambda now: progress(min(done + now, total), total))
        done += samples * len(of.faces)
        return made

    for k in range(2):
        if lighting.lights:
            direct[k, of_lamps] = own(lamps, cells, DIRECT, k).direct
        if lit.emission:
            (direct[k, -1],), _, first_bounce[k, -1] = own(glow, cells, GLOWING, 3 + k)
    spread = None
    if outside:
        if lit.sky.is_sampled:
            spread, direct[:, around] = sky_guiding.guide_sky_sampling(lit.surface, lit.sky, cells, settings.seed)
        links = DeviceLinks(transport.target, transport.albedo)
        first_bounce[:, around] = links.first_bounce(lit.surface, CellPoints(cells), lit.sky, transport.seed)
    base = np.zeros((count, transport.nodes, 3), np.float32)
    base[:, :n] = direct.mean(axis=0) + first_bounce.mean(axis=0)
    if len(transport.faces):
        if lighting.lights:
            base[of_lamps, n:] = own(lamps, transport, BEYOND_DIRECT, 2).direct
        if outside:
            made = own(sky, transport, BEYOND_DIRECT, 2)
            base[around, n:] = made.direct[0] + made.sky
        if lit.emission:
            made = own(glow, transport, BEYOND_DIRECT, 2)
            base[-1, n:] = made.direct[0] + made.glow
    return _cache(cells, lit, direct, first_bounce, _bounced(base, transport, n), spread, len(transport.target))


def _bounced(base: F32, transport: SurfaceTransport, n: int) -> F32:
    """(2, K, n, 3) what reaches n cells after one reflection and more, by each half of their rays, from the light
    (K, nodes, 3) that reaches nodes at once."""
    from mirelight.lighting.kernel.transport import DeviceLinks, bounced

    count, nodes, _ = base.shape
    of_cells = DeviceLinks(transport.target, transport.albedo)
    beyond = DeviceLinks(transport.beyond[None], transport.beyond_albedo[None])
    own_light, none = _fours(base), _fours(np.zeros_like(base))
    light, part = own_light, of_cells.samples // PARTS
    after = [base]
    for _ in range(ROUNDS):
        for k in range(PARTS):
            some = [(of_cells, 0, k * part, part), (beyond, n, 0, 1)]
            light = bounced(light, own_light, count, nodes, some)
        after.append(_rows(light, base.shape))
    light, half = _fours(_extrapolate_bounces(*after)), of_cells.samples // 2
    gathered = [bounced(light, none, count, nodes, [(of_cells, 0, k * half, half)]) for k in range(2)]
    return np.stack([_rows(x, base.shape)[:, :n] for x in gathered])


def _fours(light: F32) -> Float:
    """(layers, nodes, 3) on the device, node by node in groups of four."""
    from mirelight.lighting.kernel.memory import in_fours

    return in_fours(light.swapaxes(0, 1))


def _rows(fours: Float, shape: tuple[int, ...]) -> F32:
    """(layers, nodes, 3) back again."""
    layers, nodes, _ = shape
    rows = fours.numpy()[: 4 * layers * nodes].reshape(nodes, layers, 4)
    return np.ascontiguousarray(rows[..., :3].swapaxes(0, 1), np.float32)


def _extrapolate_bounces(first: F32, middle: F32, last: F32) -> F32:
    """Light after all bounces, from that before a round, after it and after another (K, n, 3).

    What rounds bring falls off as a geometric series, by a factor that grows towards its limit, so this is no more
    than there is.
    """
    # layer by layer, as the order of a sum over all of them may depend on how many there are
    new, old = (
        np.array([(a - b).sum(axis=0, dtype=np.float64) for a, b in zip(*pair, strict=True)])
        for pair in ((last, middle), (middle, first))
    )
    left = np.clip(new / np.where(old > 0, old, np.inf), 0, MOST_LEFT)[:, None]
    return np.asarray(last + (last - middle) * (left / (1 - left)), np.float32)


def _own(
    lit: LitProxy,
    of: Pieces,
    settings: RenderSettings,
    samples: int,
    number: int,
    progress: Callable[[int], None],
) -> _Own:
    """Samples of each of n pieces of the surface."""
    from mirelight.lighting.kernel.cell_points import CellPoints

    layers = Layers.of(lit.lighting, emissive=lit.emission)
    count = len(layers.names)
    layers = replace(
        layers,
        names=(*layers.names, "first bounce of the sky", "first bounce of glow"),
        first_bounce=(count, count + 1),
    )
    row = Camera.perspective(np.eye(4), len(of.faces), 1, yfov=45, name="cells")
    refuse_if_too_large(row, layers, most=settings.max_memory)
    seed = (settings.seed + 0x9E3779B9 * (number + 1)) & 0xFFFFFFFF
    alone = replace(settings, spp=samples, noise=None, denoise=False, seed=seed, max_depth=1)
    frame = FrameInProgress(lit, row, layers, alone, aovs=False, view=CellPoints(of), irradiance=True)
    for done in frame.add_passes(Passes(min(samples, PASS), max(samples // PASS, 1))):
        progress(done)
    made = np.stack([x.direct[0] for x in frame.develop().layers])
    return _Own(made[:count], made[count], made[count + 1])


def _cache(
    cells: SurfaceCells,
    lit: LitProxy,
    direct: F32,
    first_bounce: F32,
    indirect: F32,
    spread: sky_guiding.U16 | None = None,
    rays: int = 0,
) -> SurfaceCache:
    """Two halves of each layer (2, K, C, 3), and of what rays meet at once of each (2, K, C, 3), as what is kept."""
    layers = Layers.of(lit.lighting, emissive=lit.emission)

    def light(k: int, name: str) -> CellLight:
        kind: Literal["lights", "environment", "emission"] = "lights"
        if lit.emission and k == layers.emission:
            kind = "emission"
        elif lit.lighting.environment is not None and k == layers.environment:
            kind = "environment"
        return CellLight(
            name=name,
            kind=kind,
            direct=direct[:, k],
            first_bounce=None if kind == "lights" else first_bounce[:, k],
            indirect=indirect[:, k],
            spread=spread if kind == "environment" else None,
            rays=rays,
        )

    return SurfaceCache(cells=cells, lights=tuple(light(k, name) for k, name in enumerate(layers.names)))
