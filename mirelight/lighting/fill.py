"""Gathers light on the cells of a surface, generation by generation.

A generation samples each cell's own light and one reflected ray a sample, which reads what the generation before has
found where it meets the surface. Light of many bounces so takes no long paths: as many bounces as generations.
Everything a sample draws is a function of its cell, its number and its generation, and a generation reads nothing but
the one before, so the same cells and lights give the same bits on any number of threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from mirelight.lighting import sky_guiding
from mirelight.lighting.develop import refuse_if_too_large, refuse_if_too_many
from mirelight.lighting.frame import PASS, FrameInProgress, LitProxy
from mirelight.lighting.layers import Layers
from mirelight.model import F32, Camera, CellLight, Lighting, RenderSettings, SurfaceCache, SurfaceCells

if TYPE_CHECKING:
    from mirelight.lighting.kernel.cells import DeviceCells

WARM = 6  # generations before what is kept: the first traces whole paths, each one after adds a bounce
TOO_NEAR = 2.0  # cells: hits nearer than this to the one before are traced on, as a cell is too coarse for them
LAST_WARM = 4  # passes of the last of them, which both halves read


@dataclass(frozen=True, slots=True, eq=False)
class _Light:
    """Irradiance / pi on C cells of K layers, from one set of samples: (K, C, 3) each."""

    layers: Layers
    direct: F32  # the last two layers are what reflected rays meet at once of the environment and of what glows
    indirect: F32

    def whole(self) -> F32:
        """(K - 2, C, 3) all light of each source."""
        out = (self.direct + self.indirect)[:-2]
        out[self.layers.environment] += self.direct[-2]
        out[self.layers.emission] += self.direct[-1]
        return np.asarray(out, np.float32)


def fill(
    lit: LitProxy,
    cells: SurfaceCells,
    settings: RenderSettings,
    samples: int,
    progress: Callable[[int, int], None],
) -> SurfaceCache:
    """Light of a lighting on every cell.

    Args:
        lit: the proxy under the lighting; cells that it reads are not looked at.
        cells: of that proxy.
        settings: seed and variant count.
        samples: of each cell, in two independent halves.
        progress: called with samples done and in all.

    Raises:
        RenderError: the light of so many cells does not fit in memory.
    """
    lighting, emission = lit.lighting, lit.emission
    names = Layers.of(lighting, emissive=emission).names
    layers = _with_met(lighting, emission)
    if not names or not len(cells):
        nothing = _Light(layers, *np.zeros((2, len(layers.names), len(cells), 3), np.float32))
        return _cache(cells, names, [nothing] * 2, lighting, emission)
    rounds = rounds_of(samples)
    refuse_if_too_many(len(cells), len(layers.names), settings.max_memory)
    row = Camera.perspective(np.eye(4), len(cells), 1, yfov=45, name="cells")
    refuse_if_too_large(row, layers, most=settings.max_memory)
    read: DeviceCells | None = None
    halves: list[_Light] = []
    spread = (
        sky_guiding.guide_sky_sampling(lit.surface, lit.sky, cells, settings.seed)[0] if lit.sky.is_sampled else None
    )
    for generation, count in enumerate(rounds):
        frame = _frame(replace(lit, cells=read), cells, row, layers, settings, generation)
        for done in _passes(frame, count):
            progress(sum(rounds[:generation]) * len(cells) + done, sum(rounds) * len(cells))
        light = _light(frame, layers)
        if generation < WARM:
            read = on_device(cells, light.whole(), nearest=0.0)
        else:
            halves.append(light)
    return SurfaceCache(
        cells=cells,
        lights=tuple(
            _cell_light(name, k, halves, lighting, emission, sum(rounds[WARM:]), spread) for k, name in enumerate(names)
        ),
    )


def rounds_of(samples: int) -> list[int]:
    """Samples of a cell in each generation, where the last two are to have so many."""
    return [PASS] * (WARM - 1) + [LAST_WARM * PASS] + [max(samples // 2 // PASS, 1) * PASS] * 2


def on_device(
    cells: SurfaceCells,
    whole: F32,
    indirect: F32 | None = None,
    met: F32 | None = None,
    doubt: F32 | None = None,
    *,
    first: bool = False,
    nearest: float,
    spread: sky_guiding.U16 | None = None,
) -> DeviceCells:
    """Cells to be read; light (K, C, 3) and the rest as of `kernel.cells.DeviceCells`, `spread` as of `CellLight`."""
    from mirelight.lighting.kernel.cells import DeviceCells
    from mirelight.lighting.kernel.sky_guiding import Spread

    nothing = np.zeros((1, 1, 3), np.float32)
    return DeviceCells(
        cells,
        whole,
        nothing if indirect is None else indirect,
        nothing if met is None else met,
        doubt,
        first=first,
        nearest=nearest,
        spread=Spread(spread, np.zeros(len(cells), np.int64) if spread is None else sky_guiding.groups(cells)),
    )


def bound(cache: SurfaceCache, layers: Layers, names: tuple[str, ...], most: int | None) -> DeviceCells:
    """A cache as a film reads it: at first hits what is not sampled there, and at later ones all of it.

    Args:
        cache: light on the surface.
        layers: the film's.
        names: the cache's lights that it takes, in the film's order where its layers are separate.
        most: bytes that it may take; None: what the machine has free.

    Raises:
        ValueError: the cache has no light of such a name.
        RenderError: it does not fit in memory.
    """
    lights = {x.name: x for x in cache.lights}
    missing = [name for name in names if name not in lights]
    if missing:
        raise ValueError(f"the surface cache has no light {missing[0]!r}; there are: {', '.join(lights) or 'none'}")
    refuse_if_too_many(len(cache.cells), len(names), most)
    zero = np.zeros((2, len(cache.cells), 3), np.float32)
    chosen = [lights[name] for name in names]
    met = [zero if x.met is None else x.met for x in chosen]
    indirect = [x.indirect for x in chosen]
    whole = [x.direct + x.indirect + y for x, y in zip(chosen, met, strict=True)]
    rest = [x + y for x, y in zip(indirect, met, strict=True)]
    if not layers.separate or not chosen:
        indirect, whole, rest = [sum(indirect, zero)], [sum(whole, zero)], [sum(rest, zero)]
    of_kind = [
        sum((x.met for x in chosen if x.kind == k and x.met is not None), zero) for k in ("environment", "emission")
    ]
    return on_device(
        cache.cells,
        _mean(whole),
        _mean(indirect),
        _mean(of_kind),
        np.stack([(x[0] - x[1]) / 2 for x in rest]),
        first=True,
        nearest=TOO_NEAR * cache.cells.size,
        spread=next((x.spread for x in chosen if x.spread is not None), None),
    )


def _mean(halves: list[F32]) -> F32:
    return np.stack([(x[0] + x[1]) / 2 for x in halves])


def _with_met(lighting: Lighting, emission: bool) -> Layers:
    """The film's layers, and two behind them for what reflected rays meet at once."""
    layers = Layers.of(lighting, emissive=emission)
    count = len(layers.names)
    return replace(layers, names=(*layers.names, "environment met", "emission met"), met=(count, count + 1))


def _frame(
    lit: LitProxy, cells: SurfaceCells, row: Camera, layers: Layers, settings: RenderSettings, generation: int
) -> FrameInProgress:
    """One generation, to be sampled; the first has nothing to read and traces paths as frames do."""
    from mirelight.lighting.kernel.cell_points import CellPoints

    seed = (settings.seed + 0x9E3779B9 * (generation + 1)) & 0xFFFFFFFF
    own = replace(settings, spp=PASS, noise=None, denoise=False, seed=seed)
    return FrameInProgress(lit, row, layers, own, aovs=False, view=CellPoints(cells), irradiance=True)


def _passes(frame: FrameInProgress, samples: int) -> Iterator[int]:
    for _ in range(samples // PASS):
        yield from frame.add_pass(PASS)


def _light(frame: FrameInProgress, layers: Layers) -> _Light:
    made = frame.develop().layers
    direct, indirect = (np.stack([getattr(x, name)[0] for x in made]) for name in ("direct", "indirect"))
    return _Light(layers, direct, indirect)


def _cache(
    cells: SurfaceCells, names: tuple[str, ...], halves: list[_Light], lighting: Lighting, emission: bool
) -> SurfaceCache:
    """Two fills as what is kept."""
    lights = tuple(_cell_light(name, k, halves, lighting, emission) for k, name in enumerate(names))
    return SurfaceCache(cells=cells, lights=lights)


def _cell_light(
    name: str,
    layer: int,
    halves: list[_Light],
    lighting: Lighting,
    emission: bool,
    rays: int = 0,
    spread: sky_guiding.U16 | None = None,
) -> CellLight:
    layers = halves[0].layers
    kind: Literal["lights", "environment", "emission"] = "lights"
    if emission and layer == layers.emission:
        kind = "emission"
    elif lighting.environment is not None and layer == layers.environment:
        kind = "environment"
    met = {"lights": None, "environment": -2, "emission": -1}[kind]
    return CellLight(
        name=name,
        kind=kind,
        direct=np.stack([x.direct[layer] for x in halves]),
        met=None if met is None else np.stack([x.direct[met] for x in halves]),
        indirect=np.stack([x.indirect[layer] for x in halves]),
        rays=rays,
        spread=spread if kind == "environment" else None,
    )
