"""From the film's sums to a LightingBuffer. NumPy only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import RenderError
from mirelight.base.machine import free_memory
from mirelight.lighting.error_estimate import chosen, correct
from mirelight.lighting.layers import Layers
from mirelight.model import F32, Camera, LightingBuffer, LightLayer, planes

CELL_BYTES = 320  # of a layer: two halves direct and indirect, their film, means and differences on host and device
PLACE_BYTES = 512  # of a place where cells are looked for: on device and host, sorted and sorted again
RAY_BYTES = 20  # of a ray between cells: where it ends and the albedo there, on host and device, and while it is made
_TRACED = 'set render.indirect = "traced"'
SURFACE = 1 + sum(plane.width for plane in planes.SURFACE)  # floats a pixel: hits, then the table's surface AOVs


@dataclass(frozen=True, slots=True, eq=False)
class Sums:
    """What the film of K layers and H x W pixels holds, flat; H x W x 3 of each."""

    light: F32  # K * 2: radiance, direct and indirect
    squares: F32  # K, and 1 for the beauty where layers are separate: of the radiance summed over each batch
    surface: F32  # H * W * SURFACE
    parts: F32 | None = None  # K * 2: radiance over batches 0, 2, 4 … and over 1, 5, 9 …; None: not kept
    doubt: F32 | None = None  # K: half the difference of two fills of what was read; None: nothing was
    again: F32 | None = None  # (K, n, 3) radiance over the second samples of `error_estimate.chosen`; None: none

    def copied(self) -> Sums:
        """The same in memory of its own."""
        own: dict[str, F32 | None] = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **{name: x.copy() for name, x in own.items() if x is not None})

    def halves(self) -> tuple[Sums, Sums]:
        """Of paths that begin on the proxy, and of those that begin on inserted objects."""
        rows = len(self.light) // 2  # floats of all layers' squares; behind them stand those of the beauties
        layers, beauties = _halved(self.squares[:rows]), _halved(self.squares[rows:])
        squares = [np.concatenate(x) for x in zip(layers, beauties, strict=True)]
        others = {f.name: x for f in fields(self) if f.name != "squares" and (x := getattr(self, f.name)) is not None}
        first, second = (Sums(squares=squares[k], **{n: _halved(x)[k] for n, x in others.items()}) for k in range(2))
        return first, second


def _halved(x: F32) -> tuple[F32, F32]:
    middle = len(x) // 2
    return x[:middle], x[middle:]


def develop(
    camera: Camera,
    layers: Layers,
    sums: Sums,
    samples: NDArray[np.int64],
    batch: int = 1,
    *,
    sun: bool = False,
    occlusion: bool = False,
    again: int = 0,
) -> LightingBuffer:
    """Sums to means, in the memory that the sums are in: they are used up.

    Args:
        camera: of H x W pixels.
        layers: K of them.
        sums: the film.
        samples: (H * W) taken; a pixel of none is black and uncovered.
        batch: samples in a batch.
        sun, occlusion: whether those AOVs were traced.
        again: second samples of each pixel that has such.
    """
    h, w = camera.height, camera.width
    n = np.maximum(samples, 1).reshape(h, w, 1).astype(np.float32)
    batches = (samples // batch).reshape(h, w, 1)
    known = bool(batches.min() > 1)

    light = sums.light.reshape(-1, 2, h, w, 3)
    parts = _parts(sums, samples // batch, batch, (h, w, 3))
    light /= n
    means = [LightLayer(name=name, direct=x[0], indirect=x[1]) for name, x in zip(layers.names, light, strict=False)]
    beauty = sum((x.total for x in means), np.zeros((h, w, 3), np.float32))
    squares = sums.squares.reshape(-1, h, w, 3)
    if known:
        squares /= batch * n
        for k, (mean, spread) in enumerate(zip(chain((x.total for x in means), [beauty]), squares, strict=False)):
            _variance(spread, mean, batches)
            if sums.again is not None:
                _narrow(
                    spread,
                    mean,
                    sums.again.reshape(max(len(means), 1), -1, 3) / np.float32(again),
                    k,
                    n / np.float32(again),
                )
        if sums.doubt is not None:
            _add_doubt(squares, sums.doubt.reshape(-1, h, w, 3) / n)

    surface = sums.surface.reshape(h, w, SURFACE)
    hits = surface[..., 0].copy()
    surface /= np.maximum(hits, np.float32(1))[..., None]
    return LightingBuffer(
        camera=camera,
        coverage=hits / n[..., 0],
        layers=tuple(
            replace(x, variance=spread if known else None, half=own[0], quarter=own[1], other_quarter=own[2])
            for x, spread, own in zip(means, squares, parts, strict=False)
        ),
        **_surface_aovs(surface, leave_out={"sun_visibility": not sun, "ambient_occlusion": not occlusion}),
        variance=squares[-1] if known else None,
        samples=samples.reshape(h, w).astype(np.float32),
        spp=int(samples.min()),
    )


def _surface_aovs(surface: F32, leave_out: Mapping[str, bool]) -> dict[str, Any]:
    """By the buffer's field what the film holds of it; None for those left out."""
    found: dict[str, Any] = {}
    at = 1  # behind the hits
    for plane in planes.SURFACE:
        values = surface[..., at] if plane.width == 1 else surface[..., at : at + plane.width]
        found[plane.field] = None if leave_out.get(plane.field) else values
        at += plane.width
    return found


def _parts(
    sums: Sums, batches: NDArray[np.int64], batch: int, shape: tuple[int, int, int]
) -> list[tuple[F32 | None, F32 | None, F32 | None]]:
    """For each layer its means over three sets that share no samples; None where too few batches are in."""
    light = sums.light.reshape(-1, 2, *shape)
    if sums.parts is None or batches.min() < 4:
        return [(None, None, None)] * len(light)
    parts = sums.parts.reshape(-1, 2, *shape)
    counts = (batches + 1) // 2, (batches + 2) // 4, batches // 4
    n = [(batch * count).reshape(*shape[:2], 1).astype(np.float32) for count in counts]
    return [
        (half / n[0], quarter / n[1], (direct + indirect - half - quarter) / n[2])
        for (direct, indirect), (half, quarter) in zip(light, parts, strict=True)
    ]


def _variance(squares: F32, mean: F32, batches: NDArray[np.int64]) -> None:
    """Mean squared batches to the variance of the mean, in place."""
    squares -= mean * mean
    np.maximum(squares, np.float32(0), out=squares)
    squares /= batches - 1


def _narrow(variance: F32, mean: F32, again: F32, layer: int, more: F32) -> None:
    """A layer's variance from batches as if they were independent to that of one Sobol' sequence, in place.

    `again`: (K, n, 3) second means of each layer; their sum is the beauty's. `more`: (H, W, 1) how many times their
    samples the mean has: the two then differ by (1 + more) times its variance.
    """
    own = again[layer] if layer < len(again) else again.sum(axis=0)
    some, flat = chosen(more.size), mean.reshape(-1, 3)
    apart = (flat[some] - own) * np.sqrt(2 / (1 + more.reshape(-1, 1)[some]))
    correct(variance.reshape(-1, 3), flat, apart, some)


def _add_doubt(squares: F32, doubt: F32) -> None:
    """Add to the variance of each layer, and of the beauty behind them, that of the cells that were read, in place.

    Half the difference of two independent fills has the variance of their mean; its square is all that is known of it.
    """
    squares[: len(doubt)] += doubt * doubt
    if len(squares) > len(doubt):
        squares[-1] += np.square(doubt.sum(axis=0))


def dark(camera: Camera, layers: Layers, spp: int) -> LightingBuffer:
    """What an empty mesh gives: no coverage and no light, without tracing."""
    pixels = camera.height * camera.width
    sums = Sums(
        light=np.zeros(len(layers.names) * 6 * pixels, np.float32),
        squares=np.zeros((len(layers.names) + layers.separate) * 3 * pixels, np.float32),
        surface=np.zeros(pixels * SURFACE, np.float32),
    )
    return develop(camera, layers, sums, np.full(pixels, spp, np.int64))


def refuse_if_too_large(
    camera: Camera, layers: Layers, *, parts: bool = False, objects: bool = False, most: int | None = None
) -> None:
    """Stop before a film is allocated that does not fit.

    Args:
        camera: of its pixels.
        layers: the film's.
        parts: with those for the denoiser.
        objects: with a half for paths that begin on inserted objects.
        most: bytes that it may take; None: what the machine has free.

    Raises:
        RenderError: says the size needed.
    """
    pixels = camera.width * camera.height * (2 if objects else 1)
    values = 6 * len(layers.names) * pixels  # of the film's largest array, which 32 bits must count
    of_layer = 10 + (6 + 9 if parts else 0)  # film; for the denoiser two sums more, and three means
    needed = 4 * pixels * (of_layer * len(layers.names) + 3 + 2 * SURFACE + 16)  # AOVs once more, working memory
    _refuse(
        f"lighting of {camera.width} x {camera.height} pixels in {len(layers.names)} layers needs",
        needed,
        most,
        "give lights a group to share a layer, leave layers out (output.layers = false with "
        'output.store = "frames"), or set texture_scale below 1',
        countable=max(values, 3 * pixels) < 2**32,
    )


def refuse_if_too_many(cells: int, layers: int, most: int | None = None) -> None:
    """Stop before the light of layers on cells of a surface is held that does not fit.

    Args:
        cells: how many.
        layers: how many.
        most: bytes that it may take; None: what the machine has free.

    Raises:
        RenderError: says the size needed.
    """
    what = f"light of {layers} layers on {cells:,} pieces of the surface needs"
    _refuse(what, CELL_BYTES * cells * max(layers, 1), most, f"give lights a group to share a layer, or {_TRACED}")


def refuse_if_too_many_places(places: int, most: int | None = None) -> None:
    """Stop before places are looked at to find cells, where what is told of them does not fit.

    Args:
        places: how many.
        most: bytes that they may take; None: what the machine has free.

    Raises:
        RenderError: says the size needed.
    """
    what = f"finding the pieces of the surface that light is kept on takes {places:,} places, which need"
    _refuse(what, PLACE_BYTES * places, most, _TRACED)


def refuse_if_too_many_rays(rays: int, most: int | None = None) -> None:
    """Stop before rays between cells of a surface are held that do not fit.

    Args:
        rays: how many, of all cells together.
        most: bytes that they may take; None: what the machine has free.

    Raises:
        RenderError: says the size needed.
    """
    _refuse(f"{rays:,} rays between pieces of the surface need", RAY_BYTES * rays, most, _TRACED)


def _refuse(what: str, needed: int, most: int | None, remedy: str, *, countable: bool = True) -> None:
    """Stop where bytes that are needed are more than `most`, or than are free once Dr.Jit has given back what it keeps
    for later; or where 32 bits do not count them."""
    allowed, found = most, "may be used (render.max_memory)"
    if allowed is None:
        allowed, found = free_memory(), "are free"
        if needed > allowed:
            import drjit as dr

            dr.flush_malloc_cache()
            allowed = free_memory()
    if needed > allowed or not countable:
        raise RenderError(f"{what} {_size(needed)} and {_size(allowed)} {found}; {remedy}")


def _size(count: int) -> str:
    return f"{count / 2**30:.1f} GiB" if count >= 2**30 else f"{count / 2**20:.1f} MiB"
