"""What goes into the making of a proxy, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64, ProxyMesh, Variant
from mirelight.model.arrays import freeze

Method: TypeAlias = Literal["cells", "depth"]
Int: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProxySettings:
    """How a proxy is made. Together with the splats these decide its every bit (threads do not)."""

    method: Literal["auto", "cells", "depth"] = "auto"  # auto: cells where splats are thin discs, else depth maps
    views: Literal["auto", "around", "inside"] = "auto"  # inside too: auto does where views from around miss much
    triangles: int | None = None  # at most about so many; None: as many as the shape needs
    ceiling: bool = True  # whether a room whose pictures end below its ceiling gets one
    variant: Variant = "llvm_ad_rgb"
    threads: int | None = None  # None: as they are


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ViewQuality:
    """How well a mesh fits splats in one view."""

    camera: str
    shown: float  # share of the picture with splats (alpha above 0.5), 0..1
    uncovered: float  # share of those pixels where the mesh is not, 0..1; 0 where nothing is shown
    gap_median: float  # median distance between splats and mesh along the view, world units; NaN: nothing to compare
    before: float  # share of the pixels with both where the mesh is the nearer, 0..1
    heat: NDArray[np.uint8]  # (h, w, 3) as in `ProxyQuality`

    def __post_init__(self) -> None:
        freeze(self, "heat", (None, None, 3), np.uint8)


@dataclass(frozen=True, slots=True)
class Agreement:
    """How well neighbouring pictures of a capture agree on a surface. NaN all: they tell nothing."""

    explained: float = np.nan  # correlation on the mesh relative to the best along the way, at most 1
    apart: float = np.nan  # mean way from the mesh to where they agree best, world units
    splats_apart: float = np.nan  # the same of the surface that the splats themselves show


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProxyQuality:
    """How well a mesh fits splats, over all pixels of some views. Splat pixels are those of alpha above 0.5 whose depth
    can be trusted: no fog, and no sky."""

    uncovered: float  # share of the splat pixels where the mesh is not, 0..1
    gap_median: float  # median distance between splats and mesh along the view, world units; NaN: nothing to compare
    gap_95: float  # its 95th percentile
    leaks: float  # share of the mesh's pixels where the splats' alpha is below 0.1, 0..1
    wavy: float  # median angle between the mesh and the large planes that splats show, degrees; NaN: there are none
    wavy_90: float  # its 90th percentile
    pictures: Agreement  # how well those of the capture agree on it, where its cameras are known
    size: float  # what gaps compare with: the diagonal of the box that holds the splats, world units
    triangles: int
    views: int  # how many were looked from
    by_view: tuple[ViewQuality, ...]  # each of them
    advice: tuple[str, ...]  # sentences: what is wrong, and what to try; empty: it fits
    heat: NDArray[np.uint8]  # (h, w, 3) the views side by side: gray fits, red is uncovered, blue leaks, yellow a gap

    def __post_init__(self) -> None:
        freeze(self, "heat", (None, None, 3), np.uint8)

    @property
    def fits(self) -> bool:
        """Whether there is nothing to say against the proxy."""
        return not self.advice


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MadeProxy:
    """A proxy made from splats, and how well it fits them."""

    mesh: ProxyMesh
    method: Method
    quality: ProxyQuality  # of the surface that was seen
    unseen: int  # triangles of the mesh, its last, that close what no camera saw against light
    mirrors: int  # mirrors of the capture that were told; their faces are known in the mesh
    ceiling: float | None  # how high over the floor one is guessed, above all pictures; None: there is none
    guessed: int  # views that it was looked at from, where its cameras are not known but splats tell of them; 0: none
    seconds: float  # that it took


@dataclass(frozen=True, slots=True, eq=False)
class Soup:
    """A triangle mesh in the making, double precision, relative to the capture's middle."""

    vertices: F64  # (V, 3)
    faces: Int  # (F, 3)

    def beside(self, other: Soup) -> Soup:
        """Both as one, this one's faces first, nothing welded."""
        return Soup(
            np.concatenate([self.vertices, other.vertices]),
            np.concatenate([self.faces, other.faces + len(self.vertices)]),
        )

    def mesh(self) -> ProxyMesh:
        """The same as a proxy mesh, in single precision."""
        return ProxyMesh(vertices=self.vertices.astype(np.float32), faces=self.faces.astype(np.int32))


def corners_of(low: F64, high: F64) -> F64:
    """(8, 3) corners of a box that reaches from one (3,) to the other."""
    return np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
