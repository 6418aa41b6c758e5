"""What a composite takes, asked before it is taken."""

from __future__ import annotations

from mirelight.base.errors import RenderError
from mirelight.base.machine import free_memory
from mirelight.compositor.cloud import PADDED
from mirelight.compositor.device import Device
from mirelight.compositor.record import RECORD
from mirelight.model import Camera, SplatCloud

_GIB = 1 << 30
_INDICES = 1 << 32  # array elements that the kernels' 32-bit indices reach


def cloud_bytes(splats: SplatCloud) -> int:
    """Bytes that an upload takes: centres, covariance factors, opacities, padded SH rows; for a while rotations and
    scales, here and on the device."""
    return len(splats) * 4 * (3 + 9 + 1 + PADDED[splats.sh.shape[1]] + 2 * 7)


def frame_bytes(count: int, camera: Camera, channels: int) -> int:
    """Bytes of one frame without its tile lists: records twice, keys and orders, images."""
    return count * (2 * 4 * RECORD + 24) + camera.width * camera.height * 4 * (6 + channels) * 2


def check_indices(splats: SplatCloud) -> None:
    """Raises RenderError where a cloud has more numbers than 32-bit indices reach."""
    row = max(RECORD, PADDED[splats.sh.shape[1]])
    if len(splats) * row >= _INDICES:
        raise RenderError(f"a cloud of {len(splats)} splats is too large; {_INDICES // row - 1} are possible: split it")


def check_pixels(camera: Camera) -> None:
    """Raises RenderError where an image has more numbers than 32-bit indices reach."""
    if camera.width * camera.height * 4 >= _INDICES:
        raise RenderError(
            f"a frame of {camera.width} x {camera.height} pixels is too large; {_INDICES // 4 - 1} are possible: "
            "render it in parts by moving cx and cy"
        )


def allowance(device: Device, needed: int, most: int | None, what: str) -> int:
    """Bytes that remain once `needed` is taken.

    Args:
        needed: bytes about to be allocated.
        most: the caller's limit; None: what the machine has free (CUDA: no check, its allocator refuses by itself).
        what: for the message.

    Raises:
        RenderError: `needed` is more than that.
    """
    if most is None and device.variant == "cuda_ad_rgb":
        return 1 << 62
    free = free_memory() if most is None else most
    if needed > free and most is None:
        device.dr.flush_malloc_cache()  # memory that Dr.Jit keeps for later counts as taken
        free = free_memory()
    if needed > free:
        raise too_large(needed, free, what)
    return free - needed


def too_large(needed: int, free: int, what: str) -> RenderError:
    """The error that says how much was needed and how much there is."""
    return RenderError(
        f"{what} needs {needed / _GIB:.2f} GiB of memory and {free / _GIB:.2f} GiB may be used; nothing was allocated. "
        "Use fewer splats, a smaller frame or a machine with more memory, or raise max_memory"
    )
