"""The images that bands are blended into, and the SplatLayer made of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight.base import primaries
from mirelight.compositor.bin import Band, TileLists
from mirelight.compositor.device import Array, Device
from mirelight.compositor.queue import row_of
from mirelight.model import F32, Camera, CompositorSettings, SplatLayer, rules_of
from mirelight.model.scene import is_log

NOTHING = 2.0**-80
"""Smaller values leave the blend as 0.

A processor that rounds denormal numbers to 0 and one that keeps them (threads of one run may differ in that) part ways
only below: what a denormal weight adds to anything larger is less than half of its last bit.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Blended:
    """The images a frame's bands are blended into: whole tiles, so the last rows and columns may lie outside."""

    width: int  # px, a multiple of the tile's
    height: int  # px, a multiple of the tile's
    color: Array  # (height * width * 3,)
    transmittance: Array  # (height * width,)
    depth: Array | None  # (height * width,) sum of weight times depth
    median: Array | None  # (height * width,)
    values: Array | None  # (height * width * channels,) of other per-splat values
    channels: int = 0


def new_frame(device: Device, band: Band, *, depth: bool, channels: int) -> Blended:
    """Undefined images for all rows of `band`; every tile is written exactly once."""
    width, height = band.columns * device.tile_width, band.rows * device.tile_height

    def image(depth_of_pixel: int) -> Array:
        return device.dr.empty(device.types.Float, width * height * depth_of_pixel)

    return Blended(
        width=width,
        height=height,
        color=image(3),
        transmittance=image(1),
        depth=image(1) if depth else None,
        median=image(1) if depth else None,
        values=image(channels) if channels else None,
        channels=channels,
    )


def untile(
    device: Device,
    states: Array,
    fresh: list[float],
    lists: TileLists,
    band: Band,
    frame: Blended,
    images: dict[str, range],
) -> None:
    """Write a band's pixel states, tile by tile, into the frame's images.

    Args:
        states: (tiles * tile height * tile width * slots,); not read where a tile's list is empty.
        fresh: the state of a pixel that nothing was blended into.
        images: the slots that each image of the frame takes. Of transmittances only the size counts.
    """
    dr, types = device.dr, device.types
    width, height = device.tile_width, device.tile_height
    columns = dr.opaque(types.UInt32, band.columns)
    line = dr.arange(types.UInt32, band.tiles * height)  # a row of pixels of one tile
    tile = line // height
    row = row_of(device, tile, columns)
    first = dr.opaque(types.UInt32, band.first_row * height)
    place = (row * height + (line - tile * height) + first) * columns + (tile - row * columns)
    slots = len(fresh)
    filled = dr.gather(types.Bool, lists.filled, tile)
    read = dr.gather(types.ArrayXf, states, line, filled, shape=(width * slots, band.tiles * height))
    targets = []
    for name, taken in images.items():
        values = []
        for x in range(width):
            for s in taken:
                value = read[x * slots + s]
                value = dr.select(abs(value) < NOTHING, 0, value)
                values.append(dr.select(filled, value, fresh[s]) if fresh[s] else value)
        targets.append(getattr(frame, name))
        dr.scatter(targets[-1], types.ArrayXf(values), place)
    dr.eval(targets)


def empty_frame(device: Device, band: Band, *, depth: bool, channels: int) -> Blended:
    """What a view without splats looks like."""
    frame = new_frame(device, band, depth=depth, channels=channels)
    for image in (frame.color, frame.depth, frame.median, frame.values):
        if image is not None:
            image[:] = 0
    frame.transmittance[:] = 1
    return frame


def _cropped(image: F32, camera: Camera) -> F32:
    """The camera's part of an image made of whole tiles; no copy where they agree."""
    return np.ascontiguousarray(image[: camera.height, : camera.width])


def layer_of(frame: Blended, camera: Camera, settings: CompositorSettings) -> SplatLayer:
    """The frame as NumPy arrays; mean depth divided by what was blended."""
    size = (frame.height, frame.width)
    transmittance = _cropped(frame.transmittance.numpy().reshape(size), camera)
    if frame.depth is None or frame.median is None:
        mean = median = np.zeros(transmittance.shape, np.float32)  # not zeros_like, which writes them
    else:
        covered = 1 - transmittance
        total = _cropped(frame.depth.numpy().reshape(size), camera)
        mean = np.divide(total, covered, out=np.zeros_like(total), where=covered > 0)
        median = _cropped(frame.median.numpy().reshape(size), camera)
    return SplatLayer(
        camera=camera,
        color=decoded(_cropped(frame.color.numpy().reshape(*size, 3), camera), transmittance, settings),
        transmittance=transmittance,
        depth=mean,
        median_depth=median,
        profile=settings.profile,
        linear=settings.holds_light,
    )


def decoded(color: F32, transmittance: F32, settings: CompositorSettings) -> F32:
    """Blended colours (H, W, 3), premultiplied, as layers hold them: of log values light, else what they are."""
    if not is_log(settings.color_space) or rules_of(settings.profile).splats.pipelines:
        return color
    alpha = 1 - transmittance[..., None]
    straight = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)
    return np.asarray(np.maximum(primaries.acescct_decoded(straight), 0) * alpha, np.float32)


def values_of(frame: Blended, camera: Camera) -> F32:
    """(H, W, C) of the other per-splat values."""
    assert frame.values is not None
    return _cropped(frame.values.numpy().reshape(frame.height, frame.width, frame.channels), camera)
