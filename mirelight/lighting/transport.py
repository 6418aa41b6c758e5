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
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting import sky_guiding
from mirelight.lighting.develop import refuse_if_too_large, refuse_if_too_many, refuse_if_too_many_rays
from mirelight.lighting.fill import on_device
from mirelight.lighting.frame import PASS, FrameInProgress, LitProxy
from mirelight.lighting.layers import Layers
from mirelight.model import (
    F32,
    I32,
    Camera,
    CellLight,
    Lighting,
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
BEYOND_DIRECT = 4  # and of a place without a cell
PARTS = 8  # of the rays: each bounce but the last takes one of them, in turn
ROUNDS = 2  # of them
MOST_LEFT = 0.9  # of the light that a round brings, by the next: in a closed white room there is no end to it

Progress = Callable[[int, int], None]
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


def trace_links(
    surface: DeviceProxy, cells: SurfaceCells, settings: RenderSettings, rays: int, progress: Progress
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
    each = max(min(rays, 1 << max(MOST_RAYS // max(count, 1), 1).bit_length() - 1), FEWEST)
    refuse_if_too_many_rays(count * each, settings.max_memory)
    table, points = on_device(cells, np.zeros((1, 1, 3), np.float32), nearest=0.0), CellPoints(cells)
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


def gather(
    lit: LitProxy,
    cells: SurfaceCells,
    transport: SurfaceTransport,
    settings: RenderSettings,
    progress: Progress,
) -> SurfaceCache:
    """Light of a lighting on every cell; surfaces do not glow.

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
    from mirelight.lighting.kernel.transport import DeviceLinks, bounced

    surface, sky, lighting = lit.surface, lit.sky, lit.lighting
    layers = Layers.of(lighting, emissive=False)
    count, around = len(layers.names), layers.environment
    if not count or not len(cells):
        nothing = np.zeros((2, count, len(cells), 3), np.float32)
        return _cache(cells, layers, lighting, nothing, nothing[:, 0] if count else nothing, nothing)
    refuse_if_too_many(transport.nodes, count + 2, settings.max_memory)
    places = len(transport.faces)
    # the environment apart, so that a lamp has the same bits with and without it
    lamps = [replace(lit, lighting=replace(lighting, environment=None), sky=Sky(None))] if lighting.lights else []
    outside = [replace(lit, lighting=replace(lighting, lights=()))] if lighting.environment is not None else []
    total = 2 * DIRECT * len(cells) if lamps else 0

    def own(of: Pieces, samples: int, number: int, done: int) -> tuple[list[F32], F32]:
        say, sources = partial(_say, progress, done, total), lamps if of is cells else [*lamps, *outside]
        made = [_own(x, of, settings, samples, number, say) for x in sources]
        return [x[0] for x in made], made[-1][1] if made else np.zeros((0, 3), np.float32)

    direct = np.zeros((2, count, len(cells), 3), np.float32)
    for k in range(2 if lamps else 0):
        direct[k, : count - len(outside)] = own(cells, DIRECT, k, k * DIRECT * len(cells))[0][0]
    spread = None
    if outside and sky.is_sampled:
        spread, direct[:, around] = sky_guiding.guide_sky_sampling(surface, sky, cells, settings.seed)
    of_cells = DeviceLinks(transport.target, transport.albedo)
    met = np.zeros((2, len(cells), 3), np.float32)
    base = np.zeros((count, transport.nodes, 3), np.float32)
    base[:, : len(cells)] = direct.mean(axis=0)
    if places:
        beyond_them, by_ray = own(transport, BEYOND_DIRECT, 2, total)
        base[:, len(cells) :] = np.concatenate(beyond_them)
    if lighting.environment is not None:
        met = of_cells.met(surface, CellPoints(cells), sky, transport.seed)
        base[around, : len(cells)] += met.mean(axis=0)
        if places:
            base[around, len(cells) :] += by_ray
    beyond = DeviceLinks(transport.beyond[None], transport.beyond_albedo[None])
    own_light, none = _fours(base), _fours(np.zeros_like(base))
    light, part = own_light, of_cells.samples // PARTS
    after = [base]
    for _ in range(ROUNDS):
        for k in range(PARTS):
            some = [(of_cells, 0, k * part, part), (beyond, len(cells), 0, 1)]
            light = bounced(light, own_light, count, transport.nodes, some)
        after.append(_rows(light, base.shape))
    light, half = _fours(_extrapolate_bounces(*after)), of_cells.samples // 2
    gathered = [bounced(light, none, count, transport.nodes, [(of_cells, 0, k * half, half)]) for k in range(2)]
    indirect = np.stack([_rows(x, base.shape)[:, : len(cells)] for x in gathered])
    return _cache(cells, layers, lighting, direct, met, indirect, spread, of_cells.samples)


def _say(progress: Progress, before: int, total: int, done: int) -> None:
    progress(min(before + done, total), total)


def _fours(light: F32) -> Float:
    """(layers, nodes, 3) on the device, node by node in groups of four."""
    from mirelight.lighting.kernel.transport import in_fours

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
) -> tuple[F32, F32]:
    """(K, n, 3) irradiance / pi on n pieces of the surface, sampled towards the lights; (n, 3) what rays meet at once
    of the sky."""
    from mirelight.lighting.kernel.cell_points import CellPoints

    layers = Layers.of(lit.lighting, emissive=False)
    count = len(layers.names)
    layers = replace(layers, names=(*layers.names, "met", "nothing"), met=(count, count + 1))
    row = Camera.perspective(np.eye(4), len(of.faces), 1, yfov=45, name="cells")
    refuse_if_too_large(row, layers, most=settings.max_memory)
    seed = (settings.seed + 0x9E3779B9 * (number + 1)) & 0xFFFFFFFF
    alone = replace(settings, spp=samples, noise=None, denoise=False, seed=seed, max_depth=1)
    view = CellPoints(of)
    frame = FrameInProgress(lit, row, layers, alone, aovs=False, view=view, irradiance=True)
    for _ in range(max(samples // PASS, 1)):
        for done in frame.add_pass(min(samples, PASS)):
            progress(done)
    made = np.stack([x.direct[0] for x in frame.develop().layers])
    return made[:count], made[count]


def _cache(
    cells: SurfaceCells,
    layers: Layers,
    lighting: Lighting,
    direct: F32,
    met: F32,
    indirect: F32,
    spread: sky_guiding.U16 | None = None,
    rays: int = 0,
) -> SurfaceCache:
    """Two halves of each layer (2, K, C, 3), and of what rays meet of the sky (2, C, 3), as what is kept."""
    around = layers.environment if lighting.environment is not None else -1

    def light(k: int) -> CellLight:
        return CellLight(
            name=layers.names[k],
            kind="environment" if k == around else "lights",
            direct=direct[:, k],
            met=met if k == around else None,
            indirect=indirect[:, k],
            spread=spread if k == around else None,
            rays=rays,
        )

    return SurfaceCache(cells=cells, lights=tuple(light(k) for k in range(len(layers.names))))
