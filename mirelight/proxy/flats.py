"""Large planes of a surface that depth maps show, and where on them it is: random samples, then votes of the pictures.

Splats of a wall lie off it to both sides by more than its roughness, and its surface would wave. Where a plane explains
what is seen (Fischler and Bolles, 1981; greedy, the largest first) it is kept flat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base.together import each
from mirelight.model import F32, F64, triangles
from mirelight.proxy.depth import DepthMap, pixels_of
from mirelight.proxy.pieces import Points, axes_of, one_piece, surface_rows, turned_to
from mirelight.proxy.squared import squared
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int, Soup, corners_of
from mirelight.proxy.views import dot, length, rays, turned

Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Flat:
    """A plane, and cells of it where the surface is."""

    normal: F64  # (3,) unit
    offset: float
    axes: F64  # (2, 3) unit, along which cells are counted
    cell: float  # their side
    low: Int  # (2,) the first
    there: Bool  # (I, J)
    lift: F64 | None = None  # (I, J) how far the surface lies before the plane, along its normal; None: nowhere
    # (I, J, 2, 4) where of a cell it is: where the first three, times a point, and the fourth add up to more than 0
    bound: F64 | None = None
    told: bool = True  # whether views show it, or it is guessed from what stands on it

    def cells(self, points: F64) -> tuple[Int, Bool]:
        """(..., 2) the cells that points (..., 3) lie over, and (...,) whether they are among these; else the first."""
        i = np.floor(np.einsum("...i,ki->...k", points, self.axes) / self.cell) - self.low
        first, second = i[..., 0], i[..., 1]  # numpy's tests of all along an axis of two are slow
        rows, columns = self.there.shape
        inner = np.asarray((first >= 0) & (first < rows) & (second >= 0) & (second < columns))  # none where not finite
        return np.where(inner[..., None], i, 0).astype(np.int64), inner

    def inside(self, points: F64) -> Bool:
        """(...,) whether points (..., 3) lie over cells where the surface is."""
        i, inner = self.cells(points)
        return np.asarray(inner & self.there[i[..., 0], i[..., 1]])

    def within(self, points: F64) -> Bool:
        """(...,) the same, but for what of those cells is past another plane."""
        here = self.inside(points)
        if self.bound is not None:
            i, _ = self.cells(points[here])
            half = self.bound[i[:, 0], i[:, 1]]
            here[here] = (np.einsum("ni,nki->nk", points[here], half[..., :3]) + half[..., 3] > 0).all(axis=1)
        return here

    @property
    def middles(self) -> F64:
        """(I J, 3) of the cells."""
        i = np.stack(np.meshgrid(*(np.arange(n) for n in self.there.shape), indexing="ij"), axis=-1).reshape(-1, 2)
        return self.at(np.add(i, 0.5, dtype=np.float64), 0.0 if self.lift is None else self.lift.reshape(-1, 1))

    def at(self, places: F64, high: F64 | float = 0.0) -> F64:
        """(N, 3) the points so many cells from the first along both axes (N, 2), `high` (N, 1) before the plane."""
        along, far = (places + self.low) * self.cell, self.offset + high
        return np.asarray(along[:, :1] * self.axes[0] + along[:, 1:] * self.axes[1] + self.normal * far)

    def finer(self, times: int) -> Flat:
        """The same plane in cells so many times smaller along each side; other planes do not bound it."""
        there = np.kron(self.there, np.ones((times, times), bool))
        fine = Flat(self.normal, self.offset, self.axes, self.cell / times, self.low * times, there)
        return fine if self.lift is None else replace(fine, lift=self.lifted(fine.middles).reshape(there.shape))

    def off(self, points: F64) -> F64:
        """(...,) distances of points (..., 3), signed."""
        return np.asarray(np.einsum("...i,i->...", points, self.normal) - self.offset - self.lifted(points))

    def lifted(self, points: F64) -> F64:
        """(...,) how far the surface lies before the plane where points (..., 3) are."""
        if self.lift is None:
            return np.zeros(points.shape[:-1])
        from scipy.ndimage import map_coordinates

        i = np.einsum("...i,ki->...k", points, self.axes) / self.cell - self.low - 0.5
        at = np.nan_to_num(i).reshape(-1, 2).T
        return np.asarray(map_coordinates(self.lift, at, order=1, mode="nearest")).reshape(points.shape[:-1])


def flats_of(views: Sequence[DepthMap], spacing: float, radius: float, *, least: float = TUNING.fog) -> list[Flat]:
    """The large planes of what views see within the radius, largest first; no slices of fog, whose points are trusted
    less than `least` in the mean."""
    points = Points.of(views, spacing, radius)
    if len(points.at) < TUNING.flat_fewest:
        return []
    low, high = np.quantile(points.at, [0.002, 0.998], axis=0)
    tolerance = TUNING.plane_tolerance * spacing
    found = [x for x in _planes(points, tolerance) if points.weight[x[2]].mean() > least]
    order = sorted(range(len(found)), key=lambda k: _lean(points, *found[k]))
    square = dict(zip(order, squared([found[k][0] for k in order]), strict=True))
    out = []
    for k, (normal, offset, rows) in enumerate(found):
        plane = _turned_upright(points, rows, (normal, offset), square[k], tolerance)
        out.append(_seen(*plane, points, rows, spacing, low, high))
    return each(lambda flat: _confirmed(flat, out, views, tolerance), out)


def even(flats: Sequence[Flat], views: Sequence[DepthMap], spacing: float, radius: float) -> list[Flat]:
    """Those of planes about which little that is surely seen, and faces as they do, lies off them; and grounds that
    rise and fall. A blanket's folds lie to both sides of any plane through them, and what is higher would stand on the
    rest as on a table. Of a plain wall little is sure.

    Args:
        flats: the planes of what views show.
        views: maps.
        spacing, radius: as for :func:`flats_of`.
    """
    points, tolerance = Points.of(views, spacing, radius), TUNING.plane_tolerance * spacing

    def lies(flat: Flat) -> bool:
        off = np.abs(flat.off(points.at)) / tolerance
        near = (off < TUNING.plane_near) & flat.inside(points.at)
        aside = near & (off > 1) & (np.abs(dot(points.normal, flat.normal)) > TUNING.plane_facing)
        known = float(np.sqrt(points.weight[near].sum() * near.sum()))  # between what is sure and all that is there
        return float(points.weight[aside].sum()) < TUNING.plane_uneven * known

    return [flat for flat in flats if flat.lift is not None or lies(flat)]


def _planes(points: Points, tolerance: float) -> list[tuple[F64, float, Int]]:
    """Normal, offset and the points of each plane."""
    rng = np.random.default_rng(0)
    left, out = np.arange(len(points.at)), list[tuple[F64, float, Int]]()
    least = TUNING.plane_least * float(points.weight.sum())
    for _ in range(2 * TUNING.plane_most):
        if len(out) == TUNING.plane_most or len(left) <= TUNING.flat_fewest:
            break
        some = left[rng.permutation(len(left))[: TUNING.flat_sample]]
        at, normals, weight = points.at[some], points.normal[some], points.weight[some]
        places, ways = np.ascontiguousarray(at.T), np.ascontiguousarray(normals.T)  # sums over three are quicker so
        best, held = 0, -1.0
        for seed in rng.choice(len(some), TUNING.flat_seeds, p=weight / weight.sum()):
            on = np.abs(_along(places - at[seed][:, None], normals[seed])) < tolerance
            on &= np.abs(_along(ways, normals[seed])) > TUNING.plane_cosine
            if weight[on].sum() > held:
                best, held = int(seed), float(weight[on].sum())
        normal, offset = _fitted(points, left, normals[best], float((at[best] * normals[best]).sum()), tolerance)
        off = np.abs(dot(points.at[left], normal) - offset)
        cosine = np.abs(dot(points.normal[left], normal))
        on = (off < tolerance) & (cosine > TUNING.plane_cosine)
        if points.weight[left[on]].sum() < least:
            break
        rows = surface_rows(points, left[on], normal, offset, tolerance)
        if points.weight[rows].sum() < least or turned_outwards(points, rows, normal) > TUNING.plane_turn:
            left = left[~on]
            continue
        out.append((normal, offset, rows))
        left = left[~((off < TUNING.plane_band * tolerance) & (cosine > 0.6))]
    return out


def _along(rows: F64, way: F64) -> F64:
    """(N,) how far along a direction (3,) rows (3, N) lie."""
    return np.asarray(rows[0] * way[0] + rows[1] * way[1] + rows[2] * way[2])


def _fitted(points: Points, rows: Int, normal: F64, offset: float, tolerance: float) -> tuple[F64, float]:
    """The plane of least squares through the largest piece of what lies on a plane, and then through what lies on that.

    Through all of it, the plane of a table would lean to take a worktop a little higher with it.
    """
    for k in range(TUNING.flat_rounds):
        wide = tolerance * (1.5 if k < TUNING.flat_rounds // 2 else 1.0)
        off = dot(points.at[rows], normal) - offset
        on = (np.abs(off) < wide) & (np.abs(dot(points.normal[rows], normal)) > TUNING.plane_cosine)
        if k < TUNING.flat_rounds // 2:
            on[on] = one_piece(points, rows[on], normal, tolerance)
        if on.sum() < 30:
            break
        at, weight = points.at[rows[on]], points.weight[rows[on]] * (1 - (off[on] / wide) ** 2) ** 2
        middle = (at * weight[:, None]).sum(axis=0) / weight.sum()
        step = at - middle
        spread = np.array([[(step[:, i] * step[:, j] * weight).sum() for j in range(3)] for i in range(3)])
        thin = np.linalg.eigh(spread)[1][:, 0]
        normal = thin * np.sign((thin * normal).sum())
        offset = float((middle * normal).sum())
    return normal, offset


def _lean(points: Points, normal: F64, offset: float, rows: Int) -> float:
    """By about how many radians a plane may lean: how far its points lie off it, to how far along it they reach."""
    at, weight = points.at[rows], points.weight[rows] / points.weight[rows].sum()
    off = dot(at, normal) - offset
    along = turned_to(at, axes_of(normal))
    along = along - (along * weight[:, None]).sum(axis=0)
    spread = [[float((along[:, i] * along[:, j] * weight).sum()) for j in range(2)] for i in range(2)]
    return float(np.sqrt((weight * off**2).sum() / max(np.linalg.eigvalsh(np.array(spread))[0], 1e-30)))


def _turned_upright(
    points: Points, rows: Int, plane: tuple[F64, float], normal: F64, tolerance: float
) -> tuple[F64, float]:
    """A plane turned to another normal; as it is where that leaves too many of its points off it."""
    if np.array_equal(normal, plane[0]):
        return plane
    along, weight = dot(points.at[rows], normal), points.weight[rows]
    offset = float((along * weight).sum() / weight.sum())
    for _ in range(TUNING.flat_rounds):
        own = weight * np.clip(1 - ((along - offset) / (1.5 * tolerance)) ** 2, 0, 1) ** 2
        offset = float((along * own).sum() / max(own.sum(), 1e-30))
    held = float(weight[np.abs(along - offset) < tolerance].sum())
    return (normal, offset) if held > TUNING.plane_square_held * float(weight.sum()) else plane


def turned_outwards(points: Points, rows: Int, normal: F64) -> float:
    """By how much, in radians, normals turn from the middle of points outwards: 0 of a plane, rough or not.

    `rows` (N,) of the points, and `normal` (3,) of their plane.

    The turn is regressed on the place in the plane, and asked along its longest and its shortest way, each as far as it
    reaches: a strip of wall is not as round as its narrow side would be if it were as long as the other.
    """
    axes = axes_of(normal)
    weight = points.weight[rows] / points.weight[rows].sum()
    place, turn = turned_to(points.at[rows], axes), turned_to(points.normal[rows], axes)
    turn = turn * np.sign(dot(points.normal[rows], normal))[:, None]
    place = place - (place * weight[:, None]).sum(axis=0)
    turn = turn - (turn * weight[:, None]).sum(axis=0)
    spread = np.array([[(place[:, i] * place[:, j] * weight).sum() for j in range(2)] for i in range(2)])
    along = np.array([[(place[:, i] * turn[:, j] * weight).sum() for j in range(2)] for i in range(2)])
    square, ways = np.linalg.eigh(spread + 1e-12 * np.eye(2) * np.trace(spread))
    rim = ways.T @ along / np.sqrt(square)[:, None]  # (2, 2) turn at one deviation along each way
    return float(np.sqrt(2) * np.linalg.norm(rim, axis=1).max())


def _seen(normal: F64, offset: float, points: Points, rows: Int, spacing: float, low: F64, high: F64) -> Flat:
    """Cells over the box that hold points of the plane, small gaps closed."""
    from scipy.ndimage import binary_closing, binary_dilation, label

    axes, cell = axes_of(normal), TUNING.plane_cell * spacing
    corners = corners_of(low, high)
    reach = turned_to(corners, axes) / cell
    own = np.floor(turned_to(points.at[rows], axes) / cell).astype(np.int64)
    start = np.minimum(np.floor(reach.min(axis=0)).astype(np.int64), own.min(axis=0)) - 1
    size = np.maximum(np.ceil(reach.max(axis=0)).astype(np.int64), own.max(axis=0)) + 2 - start
    total = np.zeros(tuple(size))
    np.add.at(total, tuple((own - start).T), points.weight[rows])
    there = binary_closing(np.pad(total > 0.15 * np.median(total[total > 0]), 8), iterations=6)[8:-8, 8:-8]
    part, _ = label(there)
    count = np.bincount(part.ravel())
    count[0] = 0
    kept = count >= max(6, 0.02 * count.max())
    return Flat(normal, offset, axes, cell, start, binary_dilation(kept[part], iterations=1))


def votes(flat: Flat, views: Sequence[DepthMap], tolerance: float) -> tuple[F64, F64, F64]:
    """(I, J) by how many views a plane's cells are seen on it, and by how many seen through, each counted by its trust;
    and by how many at all."""
    at = flat.middles
    on, through, seen = np.zeros(len(at)), np.zeros(len(at)), np.zeros(len(at))
    for view in views:
        rows, pixel, off, aslant = behind(view, flat, at)
        trust = view.trust.ravel()[pixel]
        near = tolerance + 0.5 * view.spread.ravel()[pixel] * aslant
        on[rows] += trust * (np.abs(off) < near)
        through[rows] += trust * (off > 2.5 * near)
        seen[rows] += 1
    shape = flat.there.shape
    return on.reshape(shape), through.reshape(shape), seen.reshape(shape)


def behind(view: DepthMap, flat: Flat, at: F64) -> tuple[Int, Int, F64, F64]:
    """Rows (M,) of points (N, 3) of a plane in whose pixels (M,) a view has a surface, how far that is behind the plane
    (M,), and the cosine (M,) between the plane's normal and the ray."""
    own = turned(at - view.camera.position, view.camera.camera_from_world[:3, :3])
    pixel = pixels_of(view.camera, own.astype(np.float32))
    rows = np.flatnonzero((pixel >= 0) & (view.depth.ravel()[np.maximum(pixel, 0)] > 0))
    pixel = pixel[rows]
    _, directions = rays(view.camera)
    ray = directions.reshape(-1, 3)[pixel]
    aslant = np.abs(dot(ray, flat.normal)) / length(ray)
    return rows, pixel, (view.depth.ravel()[pixel] + own[rows, 2]) * aslant, aslant


def depth_of(view: DepthMap, flat: Flat, directions: F64) -> F32:
    """(H, W) depth of a plane where it has cells, else 0."""
    origins, _ = rays(view.camera)
    facing = dot(directions, flat.normal)
    seen = np.abs(facing) > TUNING.label_facing * length(directions)
    facing, start = np.where(seen, facing, 1), dot(origins, flat.normal)
    depth = np.where(seen, (flat.offset - start) / facing, 0)
    for _ in range(0 if flat.lift is None else TUNING.label_rounds):
        lift = flat.lifted(origins + directions * depth[..., None])
        depth = np.where(seen, (flat.offset + lift - start) / facing, 0)
    there = (depth > view.camera.near) & flat.inside(origins + directions * depth[..., None])
    return np.where(there, depth, 0).astype(np.float32)


def seen_through(flat: Flat, views: Sequence[DepthMap], tolerance: float, least: float = TUNING.fog) -> Bool:
    """(I, J) which of a plane's cells views surely look through: trusted more than `least` in the mean."""
    held, through, seen = votes(flat, views, tolerance)
    return (through > held) & (through > least * seen)


def _confirmed(flat: Flat, flats: Sequence[Flat], views: Sequence[DepthMap], tolerance: float) -> Flat:
    """With the cells that views see on the plane, or that they do not look through where it goes on around them, or up
    to another plane."""
    from scipy.ndimage import binary_closing, binary_fill_holes, label

    held, through, _ = votes(flat, views, tolerance)
    sure = flat.there & (held > 0.5 * through)
    free = (through > 2 * held) & (through > 0.3)
    near = binary_closing(np.pad(sure | _met(flat, flats), 20), iterations=TUNING.flat_corner)[20:-20, 20:-20]
    whole = binary_closing(np.pad(sure, 20), iterations=12)[20:-20, 20:-20] | binary_fill_holes(sure) | near
    whole = whole & ~free | sure
    part, _ = label(whole)
    own_parts = np.unique(part[sure])
    return replace(flat, there=np.isin(part, own_parts[own_parts > 0]))


def _met(flat: Flat, flats: Sequence[Flat]) -> Bool:
    """(I, J) cells in which a plane meets others that stand across it and have surface there, or near it."""
    from scipy.ndimage import binary_dilation

    at, out = flat.middles, np.zeros(flat.there.shape, bool)
    for other in flats:
        if abs(float(flat.normal @ other.normal)) < 0.5:
            wide = replace(other, there=binary_dilation(other.there, iterations=TUNING.flat_corner))
            out |= ((np.abs(other.off(at)) < 0.75 * flat.cell) & wide.inside(at)).reshape(out.shape)
    return out


def on_flats(soup: Soup, flats: Sequence[Flat], reach: float) -> Soup:
    """The surface with its vertices moved onto planes that they lie on, all but so far, and face."""
    vertices = soup.vertices.copy()
    normals = triangles.vertex_normals(soup.vertices, soup.faces)
    nearest = np.full(len(vertices), reach)
    for flat in flats:
        off = flat.off(soup.vertices)
        on = (np.abs(off) < nearest) & (np.abs(dot(normals, flat.normal)) > 0.7)
        on &= flat.within(soup.vertices)
        vertices[on] = soup.vertices[on] - off[on, None] * flat.normal
        nearest[on] = np.abs(off[on])
    return Soup(vertices, soup.faces)
