"""Which material or node of the proxy a pixel shows, and how much of it: coverage by names, ranked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.base import backend
from mirelight.model import F32, I32, Camera, Matte, ProxyMesh, Variant

if TYPE_CHECKING:
    from mirelight.lighting.kernel.proxy import DeviceProxy

SAMPLES = 64  # of each pixel: a share is told to 1/64
RANKS = 6  # things that a pixel can show, as other renderers have it by default
Parts: TypeAlias = tuple[tuple[str, ...], I32]  # names, and (F,) index of each face's into them, -1: none
_LANES = 1 << 20  # of one launch
_STREAM = 0x3A77  # of sample points, for each pixel its own


class Mattes:
    """A proxy made ready for mattes. They depend on nothing but the proxy and the camera.

    Args:
        proxy: world space.
        variant: where rays are traced.
        threads: as for tracing.

    Raises:
        BackendError: the variant cannot be used on this machine.
    """

    def __init__(self, proxy: ProxyMesh, variant: Variant = "llvm_ad_rgb", threads: int | None = None) -> None:
        self._proxy = proxy
        self._surface: DeviceProxy | None = None
        if len(proxy.faces):
            backend.mitsuba(variant, threads)
            from mirelight.lighting.kernel.proxy import DeviceProxy

            self._surface = DeviceProxy(proxy)

    def of(self, camera: Camera, name: str, parts: Parts | None = None) -> Matte:
        """The matte of a camera's picture; `name`: one of `planes.MATTES`; `parts`: what it tells apart, None: what the
        proxy's file says."""
        names, of_face = labels(self._proxy, name) if parts is None else parts
        shape = (camera.height, camera.width, RANKS)
        index, share = np.full(shape, -1, np.int32), np.zeros(shape, np.float32)
        if self._surface is not None:
            flat, shares = index.reshape(-1, RANKS), share.reshape(-1, RANKS)
            seen = _Seen(self._surface, camera, of_face)
            for first in range(0, len(flat), _LANES // SAMPLES):
                some = slice(first, min(first + _LANES // SAMPLES, len(flat)))
                flat[some], shares[some] = ranked(seen.of(some))
        return Matte(name=name, names=names, index=index, share=share)


def labels(proxy: ProxyMesh, name: str) -> Parts:
    """Of a proxy's materials or nodes; things of one name are one."""
    if name == "cryptomatte_material":
        own, of_face = tuple(material.name for material in proxy.materials), proxy.face_materials
    else:
        own, of_face = proxy.nodes, proxy.face_nodes
    names = tuple(dict.fromkeys(own))
    place = np.array([names.index(x) for x in own], dtype=np.int32)
    return names, place[np.zeros(len(proxy.faces), np.int32) if of_face is None else of_face]


class _Seen:
    """What a camera's samples meet."""

    def __init__(self, surface: DeviceProxy, camera: Camera, of_face: I32) -> None:
        from mirelight.lighting.kernel.memory import integers
        from mirelight.lighting.kernel.rays import CameraRays

        self._surface, self._rays = surface, CameraRays(camera)
        self._labels = integers(np.append(of_face + 1, (0, 0)))  # padded: a single one would be compiled in
        self._type = np.uint16 if int(of_face.max(initial=0)) < 0xFFFF else np.uint32

    def of(self, pixels: slice) -> NDArray[Any]:
        """(N, SAMPLES) of some pixels (row-major): 0 nothing, else a label plus 1."""
        import drjit as dr
        import mitsuba as mi

        from mirelight.lighting.kernel.samples import mix

        lane = dr.arange(mi.UInt32, (pixels.stop - pixels.start) * SAMPLES)
        pixel = lane // SAMPLES + dr.opaque(mi.UInt32, pixels.start)
        hit, face, *_ = self._rays.first_hit(self._surface, pixel, lane % SAMPLES, mix(pixel, _STREAM))
        found = dr.select(hit, dr.gather(mi.UInt32, self._labels, face, hit), 0)
        return np.asarray(found.numpy()).astype(self._type).reshape(-1, SAMPLES)


def ranked(seen: NDArray[Any]) -> tuple[I32, F32]:
    """Labels that occur in each row, (N, RANKS), -1 where there are fewer, and their shares, the largest first.

    Of equal shares the first name goes first. What is past the last rank is left out.
    """
    count, samples = seen.shape
    ordered = np.sort(seen, axis=1)
    starts = np.ones(seen.shape, dtype=bool)
    starts[:, 1:] = ordered[:, 1:] != ordered[:, :-1]
    at = np.flatnonzero(starts)
    length = np.diff(np.append(at, seen.size))
    row, label = at // samples, ordered.reshape(-1)[at].astype(np.int64)
    row, label, length = (x[label > 0] for x in (row, label, length))
    order = np.lexsort((label, -length, row))
    row, label, length = row[order], label[order], length[order]
    first = np.searchsorted(row, np.arange(count))
    rank = np.arange(len(row)) - first[row]
    kept = rank < RANKS
    index, share = np.full((count, RANKS), -1, np.int32), np.zeros((count, RANKS), np.float32)
    index[row[kept], rank[kept]] = label[kept] - 1
    share[row[kept], rank[kept]] = length[kept] / samples
    return index, share
