"""A surface cache as frames read it, on the device."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mirelight.lighting import sky_guiding
from mirelight.lighting.develop import refuse_if_too_many
from mirelight.lighting.layers import Layers
from mirelight.model import F32, SurfaceCache, SurfaceCells

if TYPE_CHECKING:
    from mirelight.lighting.kernel.cells import DeviceCells

TOO_NEAR = 2.0  # cells: later hits nearer than this to the one before are traced on, as a cell is too coarse for them


def on_device(
    cells: SurfaceCells,
    whole: F32,
    rest: F32 | None = None,
    first_bounce: F32 | None = None,
    doubt: F32 | None = None,
    spread: sky_guiding.U16 | None = None,
) -> DeviceCells:
    """Cells to be read; light (K, C, 3) and the rest as of `kernel.cells.DeviceCells`, `spread` as of `CellLight`."""
    from mirelight.lighting.kernel.cells import DeviceCells
    from mirelight.lighting.kernel.sky_guiding import Spread

    groups = np.zeros(len(cells), np.int64) if spread is None else sky_guiding.groups(cells)
    nothing = np.zeros((1, 1, 3), np.float32)
    rest, first_bounce = (nothing if x is None else x for x in (rest, first_bounce))
    return DeviceCells(
        cells, whole, rest, first_bounce, doubt, nearest=TOO_NEAR * cells.size, spread=Spread(spread, groups)
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
    first_bounce = [zero if x.first_bounce is None else x.first_bounce for x in chosen]
    indirect = [x.indirect for x in chosen]
    whole = [x.direct + x.indirect + y for x, y in zip(chosen, first_bounce, strict=True)]
    rest = [x + y for x, y in zip(indirect, first_bounce, strict=True)]
    if not layers.separate or not chosen:
        indirect, whole, rest = [sum(indirect, zero)], [sum(whole, zero)], [sum(rest, zero)]
    of_kind = [
        sum((x.first_bounce for x in chosen if x.kind == k and x.first_bounce is not None), zero)
        for k in ("environment", "emission")
    ]
    return on_device(
        cache.cells,
        _mean(whole),
        _mean(indirect),
        _mean(of_kind),
        np.stack([(x[0] - x[1]) / 2 for x in rest]),
        spread=next((x.spread for x in chosen if x.spread is not None), None),
    )


def _mean(halves: list[F32]) -> F32:
    return np.stack([(x[0] + x[1]) / 2 for x in halves])
