"""What a capture's surfaces are made of, by how their colours change with the view.

What a matt surface sends to a camera is the same from everywhere; what a gloss mirrors is not. So lobes of some
roughnesses are traced under the captured light, as cameras of the capture see them, and a region has the one whose
changes from view to view are those of its pictures. Halves of the surface check each other: a region in which the lobe
of one half does not explain the other half stays matt.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.estimate.tuning import TUNING
from mirelight.lighting import Tracer
from mirelight.lighting.observed import Pixels, pixels_of
from mirelight.model import F64, I32, Lighting, Material, ProxyMesh, RenderSettings, SplatLayer, triangles

Int = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Finish:
    """What a region is made of."""

    name: str
    pixels: int  # that it was told by
    roughness: float  # 1: matt
    metallic: float
    explained: float  # 0..1: share of the changes with the view, the less of both halves

    @property
    def is_told(self) -> bool:
        """Whether it shows a gloss."""
        return self.roughness < 1

    @property
    def line(self) -> str:
        """In words."""
        kind = "metal" if self.metallic else "lacquer or glaze"
        return f"{self.name}: {kind}, roughness {self.roughness:.2g}; explains {self.explained:.0%} of how it changes"


@dataclass(frozen=True, slots=True, eq=False)
class _Evidence:
    """N pixels of one region, less the mean of their cells."""

    half: NDArray[np.bool_]  # (N,) of the surface
    color: F64  # (N, 3)
    lobes: F64  # (L, N, 3)

    def fit(self, lobe: int, half: bool) -> tuple[float, float]:
        """The strength of a lobe in one half, and what share of the changes in the other one it explains."""
        own, other = self.half == half, self.half != half
        told = self.lobes[lobe]
        strength = float((self.color[own] * told[own]).sum() / max((told[own] ** 2).sum(), 1e-30))
        rest = ((self.color[other] - strength * told[other]) ** 2).sum()
        return strength, float(1 - rest / max((self.color[other] ** 2).sum(), 1e-30))


def finishes(
    mesh: ProxyMesh,
    regions: I32,
    names: Sequence[str],
    light: Lighting,
    views: Sequence[SplatLayer],
    settings: RenderSettings,
    report: Callable[[str], None] | None = None,
) -> tuple[Finish, ...]:
    """What each region is made of.

    Args:
        mesh: world space, with vertex colours.
        regions: (F,) which region a face is of.
        names: of the R regions.
        light: the capture was made under.
        views: what cameras of the capture saw.
        settings: seed, variant and threads.
        report: gets a line now and then.

    Returns:
        R of them; one without evidence is matt.
    """
    normals = triangles.normals(mesh.vertices[mesh.faces].astype(np.float64))
    size = float(np.linalg.norm(mesh.bounds[1].astype(np.float64) - mesh.bounds[0]))
    some = views[:: -(-len(views) // TUNING.gloss_most_views)]
    bare = Tracer(mesh, settings, layers=False, aovs=False)
    pixels = [pixels_of(x, bare, normals, size) for x in some]
    seen = Pixels.together(pixels)
    lobes = np.stack([_mirrored(mesh, x, light, some, pixels, settings, report) for x in TUNING.gloss_roughnesses])
    return tuple(_finish(name, _evidence(seen, regions[seen.face] == k, lobes, size)) for k, name in enumerate(names))


def _mirrored(
    mesh: ProxyMesh,
    roughness: float,
    light: Lighting,
    views: Sequence[SplatLayer],
    pixels: Sequence[Pixels],
    settings: RenderSettings,
    report: Callable[[str], None] | None,
) -> F64:
    """(N, 3) what a lacquer of that roughness all over the mesh mirrors, at the pixels of all views."""
    if report is not None:
        report(f"finishes: what a roughness of {roughness:g} would mirror, in {len(views)} views")
    coat = replace(Material(), roughness=roughness)
    coated = replace(mesh, materials=(coat,), face_materials=None, albedo=None)
    tracer = Tracer(coated, replace(settings, spp=TUNING.gloss_spp), layers=False, aovs=False, lobes=True)
    parts = []
    for view, those in zip(views, pixels, strict=True):
        made = tracer.trace(light, view.camera)
        shown = made.beauty / np.maximum(made.coverage, np.float32(1e-3))[..., None]
        parts.append(shown.reshape(-1, 3)[those.pixel])
    return np.concatenate(parts).astype(np.float64)


def _evidence(seen: Pixels, own: NDArray[np.bool_], lobes: F64, size: float) -> _Evidence:
    """What a region's pixels tell: how they differ from others of the same place."""
    rows = np.flatnonzero(own & (seen.color.max(axis=1) < TUNING.gloss_white))
    cell = np.floor(seen.points[rows] * (TUNING.gloss_finest / size)).astype(np.int64)
    _, of = np.unique(cell, axis=0, return_inverse=True)
    of, count = of.ravel(), int(of.max(initial=-1)) + 1
    often = np.maximum(np.bincount(of, minlength=count), 1)

    def apart(values: F64) -> F64:
        means = np.stack([np.bincount(of, values[:, k], count) for k in range(3)], axis=1) / often[:, None]
        return np.asarray(values - means[of])

    half = np.random.default_rng(0).random(count) < 0.5
    return _Evidence(half[of], apart(seen.color[rows]), np.stack([apart(x[rows]) for x in lobes]))


def _finish(name: str, told: _Evidence) -> Finish:
    """The lobe that explains most of the other half, both ways."""
    matt = Finish(name, len(told.color), 1.0, 0.0, 0.0)
    if len(told.color) < TUNING.gloss_fewest:
        return matt
    fits = [[told.fit(k, half) for half in (False, True)] for k in range(len(TUNING.gloss_roughnesses))]
    shares = [min(share for _, share in both) for both in fits]
    best = int(np.argmax(shares))
    strengths = [strength for strength, _ in fits[best]]
    strength = float(np.mean(strengths))
    is_metal = min(strengths) > TUNING.gloss_metal
    as_matt = best == len(shares) - 1 or shares[best] < TUNING.gloss_explained
    if as_matt or not (is_metal or TUNING.gloss_strength[0] < strength < TUNING.gloss_strength[1]):
        return replace(matt, explained=max(shares[best], 0.0))
    return Finish(name, len(told.color), _between(shares, best), float(is_metal), shares[best])


def _between(shares: Sequence[float], best: int) -> float:
    """The roughness at the top of a parabola through the best share and those beside it, over its logarithm: there what
    lobes explain of each other falls off alike both ways."""
    if not 0 < best < len(shares) - 1:
        return TUNING.gloss_roughnesses[best]
    x, y = np.log(TUNING.gloss_roughnesses[best - 1 : best + 2]), np.array(shares[best - 1 : best + 2])
    a, b, _ = np.polyfit(x, y, 2)
    return round(float(np.exp(np.clip(-b / (2 * a), x[0], x[2]))), 3) if a < 0 else TUNING.gloss_roughnesses[best]


def regions_of(mesh: ProxyMesh, seed: int = 0) -> tuple[I32, tuple[str, ...]]:
    """(F,) which region each face is of, and their names: its materials, or parts alike in colour and near each other.

    Args:
        mesh: with vertex colours, where it has but one material.
        seed: of the search for parts.
    """
    if sum(not x.is_mirror for x in mesh.materials) > 1 and mesh.face_materials is not None:
        return mesh.face_materials, tuple(x.name for x in mesh.materials)
    from scipy.cluster.vq import kmeans2
    from scipy.spatial import cKDTree

    from mirelight.base.colour import srgb_encode

    corners = mesh.vertices[mesh.faces].astype(np.float64)
    size = float(np.linalg.norm(mesh.bounds[1].astype(np.float64) - mesh.bounds[0]))
    colors = np.zeros((len(corners), 3)) if mesh.vertex_colors is None else mesh.vertex_colors[mesh.faces].mean(axis=1)
    told = np.concatenate(
        [srgb_encode(np.clip(colors, 0, 1)) / TUNING.gloss_color, corners.mean(axis=1) / (TUNING.gloss_place * size)],
        axis=1,
    )
    even, _ = triangles.strewn(corners, TUNING.gloss_places)
    middles, _ = kmeans2(told[even], TUNING.gloss_regions, seed=seed, minit="++")
    _, nearest = cKDTree(middles).query(told)
    there, regions = np.unique(nearest, return_inverse=True)
    return regions.astype(np.int32).ravel(), tuple(f"part {k + 1}" for k in range(len(there)))


def _of(found: Finish, material: Material) -> Material:
    """A material that is made so; a mirror stays one."""
    if material.is_mirror:
        return material
    return replace(material, name=found.name, roughness=found.roughness, metallic=found.metallic, finish_texture=None)


def finished(mesh: ProxyMesh, regions: I32, found: Sequence[Finish]) -> ProxyMesh:
    """The mesh with what its regions (F,) are made of; what else its materials say stays."""
    pairs, which = np.unique(np.stack([regions, mesh.owners]), axis=1, return_inverse=True)
    materials = tuple(_of(found[region], mesh.materials[owner]) for region, owner in pairs.T)
    return replace(mesh, materials=materials, face_materials=which.ravel().astype(np.int32))
