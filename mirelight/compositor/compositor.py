"""The compositor's front door: a cloud is uploaded once and composited for any number of cameras."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mirelight.base.sh import C0
from mirelight.compositor.bin import (
    MOST_TILES,
    Band,
    TileLists,
    TooLarge,
    sorted_records,
    sorted_values,
    split,
    tile_lists,
)
from mirelight.compositor.blend import Source, blend, blend_eight_bit, blend_in_front
from mirelight.compositor.cloud import upload, view_of
from mirelight.compositor.color import splat_colors, tone_records
from mirelight.compositor.device import Array, Device, open_device
from mirelight.compositor.engine import EngineDrawing
from mirelight.compositor.kernel import splat_kernel
from mirelight.compositor.memory import allowance, check_indices, check_pixels, cloud_bytes, frame_bytes, too_large
from mirelight.compositor.order import depth_order
from mirelight.compositor.project import EXACT, project
from mirelight.compositor.record import VALUE_ROW
from mirelight.compositor.resolve import Blended, decoded, empty_frame, layer_of, new_frame, values_of
from mirelight.compositor.source import MOST_COLOR, factors_of
from mirelight.compositor.supersample import finer, mean, mean_color, reduced
from mirelight.model import F32, I32, Camera, CompositorSettings, SplatCloud, SplatLayer, Variant, frozen_array

_DEFAULT = CompositorSettings()


@dataclass(slots=True, eq=False)
class _Look:
    """Splats as a camera sees them, whatever is blended of them. M can be seen."""

    camera: Camera
    order: Array  # (M,) their indices from front to back
    records: Array  # (M * RECORD,) in that order
    lists: TileLists | None = None  # of the whole frame, once they are known


class Compositor:
    """Composites one cloud, again and again.

    Args:
        splats: the cloud, in world space.
        settings: profile and its details.
        variant: where it runs.
        threads: worker threads of the LLVM backend (process-wide); None: as they are.

    Raises:
        BackendError: the variant cannot run here.
        RenderError: the cloud does not fit into memory; raised before anything is allocated.
    """

    def __init__(
        self,
        splats: SplatCloud,
        settings: CompositorSettings = _DEFAULT,
        *,
        variant: Variant = "llvm_ad_rgb",
        threads: int | None = None,
    ) -> None:
        self.splats, space = splats, splats.color_space  # what the cloud says of itself holds
        self.settings = settings if settings.color_space == space else replace(settings, color_space=space)
        self._device = open_device(variant, threads)
        check_indices(splats)
        allowance(self._device, cloud_bytes(splats), settings.max_memory, f"a cloud of {len(splats)} splats")
        self._cloud = upload(self._device, splats, settings) if len(splats) else None
        self._held: _Look | None = None

    def composite(
        self, camera: Camera, *, depth: bool = True, diffuse: bool = False, drawing: EngineDrawing | None = None
    ) -> SplatLayer:
        """The splats as `camera` sees them.

        Args:
            depth: whether mean and median depth are wanted; without them they are 0 and the blend takes a quarter less.
            diffuse: whether the same without what changes with the view is wanted, too (profile physical).
            drawing: the engine's own order and grid of pixels; None: exact order, exact places.

        Raises:
            RenderError: not even one row of tiles fits into memory.
        """
        count = self.settings.samples
        if count > 1:
            fine = self._one_sample.composite(finer(camera, count), depth=depth, diffuse=diffuse)
            return reduced(fine, camera, count)
        if diffuse:
            return self.composite_with(camera, np.zeros((len(self.splats), 0), "f4"), depth=depth, diffuse=True)[0]
        return layer_of(self._blend(camera, None, depth=depth, drawing=drawing), camera, self.settings)

    def composite_with(
        self, camera: Camera, values: F32, *, depth: bool = True, diffuse: bool = False
    ) -> tuple[SplatLayer, F32]:
        """The layer, and other values of the splats blended with the same weights.

        That is how modes work that light each splat: up to eight channels share one blend with the colour.

        Args:
            values: (N, C) any numbers, one row a splat of the cloud.
            depth: as for :meth:`composite`.
            diffuse: as there; it takes three of the channels.

        Returns:
            the layer and (H, W, C) sums of weight times value, premultiplied like the colour.

        Raises:
            ValueError: `values` is not (N, C) with C >= 1 (0 with `diffuse`), or not finite.
        """
        count = self.settings.samples
        if count > 1:
            layer, sums = self._one_sample.composite_with(finer(camera, count), values, depth=depth, diffuse=diffuse)
            return reduced(layer, camera, count), mean(sums, count)
        values = frozen_array(values, (len(self.splats), None), np.float32, "values")
        if diffuse:
            values = np.concatenate([self.plain_colors, values], axis=1)
        if values.shape[1] == 0 or not np.isfinite(values).all():
            raise ValueError(f"values {values.shape}: at least one channel is needed, and finite numbers")
        frames = [
            self._blend(camera, values[:, i : i + VALUE_ROW], depth=depth and i == 0)
            for i in range(0, values.shape[1], VALUE_ROW)
        ]
        sums = np.concatenate([values_of(frame, camera) for frame in frames], axis=2)
        layer = layer_of(frames[0], camera, self.settings)
        if diffuse:
            plain, sums = sums[..., :3], sums[..., 3:]
            layer = replace(layer, diffuse=decoded(plain, layer.transmittance, self.settings))
        return layer, sums

    def composite_colors(self, camera: Camera, colors: F32) -> F32:
        """(H, W, 3) the composite of other colours (N, 3) of the splats, in their space; see :meth:`composite_with`."""
        count = self.settings.samples
        layer, values = self._one_sample.composite_with(finer(camera, count), colors, depth=False)
        made = decoded(values, layer.transmittance, self.settings)
        return made if count == 1 else mean_color(made, layer, count)

    @contextmanager
    def holding(self, camera: Camera) -> Iterator[I32]:
        """Within it, places, order and tile lists of the splats are found once for all composites of one camera.

        Gives the (M,) splats that can be seen, from front to back: other rows of `values` count for nothing.

        Raises:
            ValueError: the settings are supersampled, whose composites are of a finer camera.
        """
        if self.settings.samples > 1:
            raise ValueError("a camera is held for composites of one sample a pixel")
        self._held = self._look(camera, EXACT)
        try:
            yield np.asarray(self._held.order.numpy(), np.int32)
        finally:
            self._held = None

    def in_front(self, camera: Camera, depth: F32) -> SplatLayer:
        """The splats whose far sides, one standard deviation behind their centres, lie in front of something.

        Args:
            depth: (H, W) of that along the view axis, world units; 0 where there is nothing, and no splat in front.

        Raises:
            RenderError: as :meth:`composite`.
        """
        depth = frozen_array(depth, (camera.height, camera.width), np.float32, "depth")
        count = self.settings.samples
        if count > 1:
            fine = np.repeat(np.repeat(depth, count, axis=0), count, axis=1)
            return reduced(self._one_sample.in_front(finer(camera, count), fine), camera, count)
        back = camera.world_from_camera[:3, 2]
        extent = np.linalg.norm(back @ factors_of(self.splats.quats, self.splats.scales), axis=1)
        behind = (camera.world_from_camera[:3, 3] - self.splats.means) @ back + extent
        far = np.nan_to_num(behind[:, None]).astype(np.float32)
        return layer_of(self._blend(camera, far, depth=False, limit=depth), camera, self.settings)

    @cached_property
    def _one_sample(self) -> Compositor:
        """The same with a sample a pixel."""
        made = copy(self)
        made._held = None
        made.settings = replace(self.settings, supersampling=1)
        return made

    @property
    def plain_colors(self) -> F32:
        """(N, 3) the splats' colours averaged over directions, as the profile physical blends them."""
        return np.asarray(np.clip(0.5 + C0 * self.splats.sh[:, 0], 0, MOST_COLOR), np.float32)

    def colors(self, camera: Camera) -> F32:
        """(N, 3) the splats' colours as they are blended for that camera (SH evaluated, tone curve applied)."""
        if self._cloud is None:
            return np.zeros((0, 3), dtype=np.float32)
        view = view_of(self._device, camera, splat_kernel(self.settings, camera))
        return splat_colors(self._device, self._cloud, view, self.settings)

    def _blend(
        self,
        camera: Camera,
        values: F32 | None,
        *,
        depth: bool,
        drawing: EngineDrawing | None = None,
        limit: F32 | None = None,
    ) -> Blended:
        """`limit`: (H, W) depths that the first of the values has to be below."""
        device = self._device
        settings, kernel = self.settings, splat_kernel(self.settings, camera)
        channels = 0 if values is None else values.shape[1]
        what = f"a frame of {camera.width} x {camera.height} pixels of {len(self.splats)} splats"
        check_pixels(camera)
        halves = drawing is not None and drawing.subpixel_bits is not None
        needed = frame_bytes(len(self.splats) * (1 + halves), camera, channels)
        memory = allowance(device, needed, settings.max_memory, what)

        whole = Band(-(-camera.width // device.tile_width), -(-camera.height // device.tile_height), 0)
        held = self._held if self._held is not None and self._held.camera is camera and drawing is None else None
        look = held or self._look(camera, drawing or EXACT)
        if len(look.order) == 0:
            return empty_frame(device, whole, depth=depth, channels=channels)
        frame = new_frame(device, whole, depth=depth, channels=channels)
        data = [look.records] if values is None else [look.records, sorted_values(device, values, look.order)]
        source = Source(device, kernel.fragment, channels, depth, halves)
        if limit is not None:
            data += _whole_tiles(device, limit, whole)
        for band, lists in _bands(device, look.records, whole, memory, what, held):
            (blend if limit is None else blend_in_front)(source, data, lists, band, frame)
        if settings.rounds:
            back = device.dr.reverse(device.dr.arange(device.types.UInt32, len(look.order)))
            records = sorted_records(device, look.records, back)
            source = Source(device, kernel.fragment, 0, False, halves)
            for band, lists in _bands(device, records, whole, memory, what):
                blend_eight_bit(source, [records], lists, band, frame)
        return frame

    def _look(self, camera: Camera, drawing: EngineDrawing) -> _Look:
        device, settings, kernel = self._device, self.settings, splat_kernel(self.settings, camera)
        none = device.dr.zeros(device.types.UInt32, 0)
        if self._cloud is None:
            return _Look(camera, none, none)
        projected = project(device, self._cloud, view_of(device, camera, kernel), kernel, settings, drawing)
        order = depth_order(device, projected.key, projected.visible)
        if len(order) == 0:
            return _Look(camera, none, none)
        records = sorted_records(device, projected.records, order)
        if settings.tones_splats:
            tone_records(device, records, settings)
        return _Look(camera, order, records)


def _whole_tiles(device: Device, image: F32, band: Band) -> list[Array]:
    """An image (H, W) padded with 0 to the band's tiles, and its width."""
    height, width = band.rows * device.tile_height, band.columns * device.tile_width
    padded = np.zeros((height, width), np.float32)
    padded[: image.shape[0], : image.shape[1]] = image
    return [device.floats(padded), device.count(width)]


def _bands(
    device: Device, records: Array, whole: Band, memory: int, what: str, held: _Look | None = None
) -> Iterator[tuple[Band, TileLists]]:
    """The frame's bands with their tile lists: one where it fits into memory, else halves of halves.

    `held` keeps those of the whole frame.
    """
    if held is not None and held.lists is not None:
        yield whole, held.lists
        return
    waiting = [whole]
    while waiting:
        band = waiting.pop()
        lists = tile_lists(device, records, band, memory) if band.tiles <= MOST_TILES else TooLarge(0)
        if isinstance(lists, TileLists):
            if held is not None and band is whole:
                held.lists = lists
            yield band, lists
        elif band.rows > 1:
            waiting += reversed(split(band))
        else:
            raise too_large(lists.needed, memory, what)


def composite(
    splats: SplatCloud,
    camera: Camera,
    settings: CompositorSettings = _DEFAULT,
    variant: Variant = "llvm_ad_rgb",
    threads: int | None = None,
) -> SplatLayer:
    """Composite `splats` once; see :class:`Compositor` for many cameras."""
    return Compositor(splats, settings, variant=variant, threads=threads).composite(camera)
