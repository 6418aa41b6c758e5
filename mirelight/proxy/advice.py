"""What is wrong with a mesh that does not fit its splats, found by trying what usually is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mirelight.base import conventions
from mirelight.model import F64, ProxyMesh
from mirelight.proxy.capture import Capture
from mirelight.proxy.mesh_tuning import MESH
from mirelight.proxy.sampling import spread
from mirelight.proxy.types import Agreement, Int
from mirelight.proxy.views import turned

UNEXPLAINED = "nothing simple explains it: see the heat map, and try --fit, or a proxy made from the splats"
_HALF = ((180, 0, 0), (0, 180, 0), (0, 0, 180))
_QUARTER = ((90, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0), (0, 0, 90), (0, 0, -90))


@dataclass(frozen=True, slots=True, eq=False)
class _Guess:
    said: str
    pose: F64  # (4, 4) what would undo it, in the capture's space
    cost: float  # how much better it must be than a simpler one


@dataclass(frozen=True, slots=True)
class Figures:
    """What a mesh is judged by, as in `ProxyQuality`."""

    uncovered: float
    gap: float  # median
    leaks: float
    wavy: float  # median
    pictures: Agreement


def advice_on(capture: Capture, mesh: ProxyMesh, figures: Figures) -> tuple[str, ...]:
    """Sentences for a mesh with such figures, in the capture's space; none where it fits."""
    wrong = []
    uncovered, gap, leaks = figures.uncovered, figures.gap, figures.leaks
    if not uncovered <= MESH.advice_uncovered:
        wrong.append(f"{uncovered:.0%} of the splats' pixels are off the proxy, where right ones leave 3 to 13 %")
    size = 2 * capture.radius
    if gap > max(MESH.advice_gap * size, (0.5 if capture.surfels else 1.25) * capture.spacing):
        wrong.append(f"the proxy lies {gap:.3g} units ({gap / size:.1%} of the size) from the splats' surface")
    if leaks > MESH.advice_leaks:
        wrong.append(f"{leaks:.0%} of the proxy's pixels show no splats")
    if figures.wavy > MESH.advice_waves:
        wrong.append(f"it waves: half of it is {figures.wavy:.0f}° and more off the planes that the splats show")
    if figures.pictures.apart > MESH.advice_apart * figures.pictures.splats_apart + MESH.advice_least_apart * size:
        wrong.append(
            f"the capture's pictures agree best {figures.pictures.apart / size:.1%} of the size off it "
            f"({figures.pictures.splats_apart / size:.1%} off the splats' own surface)"
        )
    if not wrong:
        return tuple(_on_floaters(capture, mesh))
    return (*wrong, _explained(capture, mesh) or UNEXPLAINED)


def _on_floaters(capture: Capture, mesh: ProxyMesh) -> Iterator[str]:
    """A sentence where most splats lie far off a mesh that looks right."""
    floating = _floating(capture, mesh)
    if floating > MESH.advice_floating:
        many = f"{floating:.0%} of the splats float more than {MESH.advice_float:.0%} of the size off it"
        yield f"{many}; take them out in an editor of splats, as they are lit like what lies behind them"


def _floating(capture: Capture, mesh: ProxyMesh) -> float:
    """The share of the splats that lie far off a mesh, 0..1."""
    from scipy.spatial import cKDTree

    if not len(mesh.faces):
        return 0.0
    own = _some(capture)
    surface = spread(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64), MESH.advice_surface)
    far = cKDTree(surface).query(own, distance_upper_bound=2 * MESH.advice_float * capture.radius)[0]
    return float(np.isinf(far).mean())


def _some(capture: Capture) -> F64:
    """(N, 3) where some of the splats are, evenly taken."""
    means = capture.splats.means
    return np.asarray(means[:: max(len(means) // MESH.advice_points, 1)].astype(np.float64))


def _explained(capture: Capture, mesh: ProxyMesh) -> str | None:
    """What would make the mesh fit, of the things that usually are wrong."""
    found = _best(capture, mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)) if len(mesh.faces) else None
    return None if found is None else found.said


def best_guess(capture: Capture, vertices: F64, faces: Int) -> F64:
    """The matrix (4, 4), in the capture's space, that undoes what is usually wrong with a mesh, else the identity."""
    found = _best(capture, vertices, faces)
    return np.eye(4) if found is None else found.pose


def _best(capture: Capture, vertices: F64, faces: Int) -> _Guess | None:
    from scipy.spatial import cKDTree

    own = _some(capture)
    tree = cKDTree(own)
    on_mesh = spread(vertices, faces, MESH.advice_points)

    def distance(points: F64, most: float = math.inf) -> float:
        """Infinity where it is `most` or more."""
        # of the mesh the nearer half alone: the rest may be what no camera saw
        back = np.sort(tree.query(points)[0])[: len(points) // 2]
        half = float(np.mean(np.minimum(back, capture.radius)))
        if half >= most:
            return math.inf
        there = cKDTree(points).query(own)[0]
        return float(np.mean(np.minimum(there, capture.radius))) + half

    now = distance(on_mesh)
    floor = distance(own[::2]) + 0.01 * capture.radius  # points of the same surface lie that far apart anyway
    best: tuple[float, _Guess] | None = None
    for guess in _guesses(on_mesh, capture.middle, own):
        most = min(MESH.advice_better * now, 3 * floor, math.inf if best is None else best[0])
        found = distance(turned(on_mesh, guess.pose[:3, :3]) + guess.pose[:3, 3], most / guess.cost) * guess.cost
        if found < most:
            best = found, guess
    return None if best is None else best[1]


def _guesses(points: F64, middle: F64, splats: F64) -> Iterator[_Guess]:
    """The mesh turned about the world's origin, moved, scaled, or several of these."""
    centre, extent = _box(splats)
    back, out = conventions.compose(-middle), conventions.compose(middle)
    for turn in ((0, 0, 0), *_HALF, *_QUARTER):
        pose = back @ conventions.compose(rotation=conventions.rotation_from_euler(turn)) @ out
        text = f"transform.rotation_euler = [{turn[0]}, {turn[1]}, {turn[2]}]"
        if any(turn):
            yield _Guess(f"it looks turned: try {text} on the proxy", pose, 1.0)
        own_centre, own_extent = _box(turned(points, pose[:3, :3]) + pose[:3, 3])
        by = centre - own_centre
        said = f"translation = [{by[0]:.4g}, {by[1]:.4g}, {by[2]:.4g}]"
        yield _Guess(_together(turn, text, f"moved: try transform.{said}"), conventions.compose(by) @ pose, 1.15)
        factor = float(np.exp(np.median(np.log(np.maximum(extent, 1e-12) / np.maximum(own_extent, 1e-12)))))
        if not 0.8 < factor < 1.25:
            neat = _neat(factor)
            said = _together(turn, text, f"scaled: try transform.scale = {neat:.4g}")
            yield _Guess(said, back @ conventions.compose(scale=neat) @ out @ pose, 1.1)
            scaled = conventions.compose(centre) @ conventions.compose(-own_centre * factor, scale=factor) @ pose
            yield _Guess(_together(turn, text, f"scaled by about {1 / factor:.4g} and moved"), scaled, 1.25)


def _together(turn: tuple[int, int, int], text: str, more: str) -> str:
    return f"it looks {more} on the proxy" if not any(turn) else f"it looks turned ({text}) and {more} on the proxy"


def _box(points: F64) -> tuple[F64, F64]:
    """Centre and extent, without strays."""
    low, high = np.quantile(points, [0.01, 0.99], axis=0)
    return (low + high) / 2, high - low


def _neat(factor: float) -> float:
    """A power of ten where that is meant (metres and centimetres), else the factor."""
    power = 10.0 ** round(np.log10(factor))
    return power if 0.8 < factor / power < 1.25 else factor
