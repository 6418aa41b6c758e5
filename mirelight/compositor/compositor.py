"""The compositor's front door: a cloud is uploaded once and composited for any number of cameras."""

from __future__ import annotations

from mirelight.compositor import reference
from mirelight.compositor.bin import Band, sorted_records, tile_lists
from mirelight.compositor.blend import Frame, Source, blend, new_frame
from mirelight.compositor.device import open_device
from mirelight.compositor.kernel import splat_kernel
from mirelight.compositor.order import depth_order
from mirelight.compositor.project import project, upload, view_of
from mirelight.compositor.resolve import layer_of
from mirelight.errors import BackendError
from mirelight.model import Camera, CompositorSettings, SplatCloud, SplatLayer, Variant

_DEFAULT = CompositorSettings()


class Compositor:
    """Composites one cloud, again and again.

    Args:
        splats: the cloud, in world space.
        settings: profile and its details.
        variant: where it runs; `scalar_rgb` uses LLVM where there is one, else the NumPy reference.
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
        self.splats = splats
        self.settings = settings
        try:
            self._device = open_device(variant, threads)
        except BackendError:
            if variant != "scalar_rgb":
                raise
            self._device = None
            return
        self._cloud = upload(self._device, splats, settings)

    def composite(self, camera: Camera, *, depth: bool = True) -> SplatLayer:
        """The splats as `camera` sees them.

        Args:
            depth: whether mean and median depth are wanted; without them they are 0 and the blend takes a quarter less.
        """
        if self._device is None:
            return reference.composite(self.splats, camera, self.settings)
        frame = self._blended(camera, depth=depth)
        return layer_of(frame, camera, self.settings)

    def _blended(self, camera: Camera, *, depth: bool) -> Frame:
        device = self._device
        kernel = splat_kernel(self.settings, camera)
        whole = Band(-(-camera.width // device.tile_width), -(-camera.height // device.tile_height), 0)
        frame = new_frame(device, whole, depth=depth, channels=0)
        projected = project(device, self._cloud, view_of(device, camera, kernel), kernel, self.settings)
        order = depth_order(device, projected.key, projected.visible)
        records = sorted_records(device, projected.records, order)
        source = Source(device, kernel, records, None, 0, depth)
        blend(source, tile_lists(device, records, whole), whole, frame)
        return frame


def composite(
    splats: SplatCloud,
    camera: Camera,
    settings: CompositorSettings = _DEFAULT,
    variant: Variant = "llvm_ad_rgb",
    threads: int | None = None,
) -> SplatLayer:
    """Composite `splats` once; see :class:`Compositor` for many cameras."""
    return Compositor(splats, settings, variant=variant, threads=threads).composite(camera)
