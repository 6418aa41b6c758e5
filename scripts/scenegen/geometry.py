"""Procedural surfaces: sheets, bevelled boxes, lathes, tubes, leaves. Metres, Y up, faces counter-clockwise."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Part:
    """A triangle mesh of one material. UVs are in metres, so that textures keep their size wherever they are laid."""

    vertices: F64  # (V, 3) metres
    faces: I64  # (F, 3)
    uvs: F64  # (V, 2) metres
    material: str
    solid: bool = True  # False: too thin for a reconstructed proxy to see (leaves, wires)

    def moved(self, matrix: F64) -> Part:
        """The part under a rigid (4, 4) matrix."""
        return replace(self, vertices=self.vertices @ matrix[:3, :3].T + matrix[:3, 3])


@dataclass(frozen=True, kw_only=True)
class Soup:
    """Triangles of one material, three own vertices each, ready for a renderer."""

    positions: F64  # (F, 3, 3)
    normals: F64  # (F, 3, 3) unit, smoothed up to the crease angle
    uvs: F64  # (F, 3, 2)
    material: str
    solid: bool


def place(x: float = 0, y: float = 0, z: float = 0, turn: float = 0) -> F64:
    """Rigid matrix (4, 4): turn about +Y by degrees, then move."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    return np.array([[c, 0, s, x], [0, 1, 0, y], [-s, 0, c, z], [0, 0, 0, 1.0]])


def sheet(points: ArrayLike, material: str, *, flip: bool = False, solid: bool = True) -> Part:
    """A surface through a grid of points (n, m, 3); it faces d/dn x d/dm. UVs run along the mean arc lengths."""
    p = np.asarray(points, dtype=np.float64)
    n, m, _ = p.shape
    u = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=2).mean(axis=1))])
    v = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=1), axis=2).mean(axis=0))])
    i = np.arange(n * m).reshape(n, m)
    a, b, c, d = i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    uvs = np.stack(np.broadcast_arrays(u[:, None], v[None, :]), -1).reshape(-1, 2)
    return Part(
        vertices=p.reshape(-1, 3), faces=faces[:, ::-1] if flip else faces, uvs=uvs, material=material, solid=solid
    )


def rectangle(origin: ArrayLike, along: ArrayLike, up: ArrayLike, material: str, step: float = 0.25) -> Part:
    """A flat sheet from `origin` spanned by two vectors, facing along x up, cut into cells of about `step` metres."""
    o, a, b = (np.asarray(x, dtype=np.float64) for x in (origin, along, up))
    n, m = (max(2, int(np.linalg.norm(x) / step) + 1) for x in (a, b))
    s, t = np.linspace(0, 1, n), np.linspace(0, 1, m)
    return sheet(o + s[:, None, None] * a + t[None, :, None] * b, material)


def _box_template() -> tuple[F64, F64, I64]:
    """Corner signs (24, 3), which axis keeps its full size (24, 3), and outward faces (44, 3) of a bevelled box."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    points = {(tuple(s), a): 3 * k + a for k, s in enumerate(signs) for a in range(3)}
    polygons: list[list[int]] = []
    for a in range(3):  # six faces
        b, c = (a + 1) % 3, (a + 2) % 3
        for side in (-1, 1):
            ring = []
            for sb, sc in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                s = [0.0, 0.0, 0.0]
                s[a], s[b], s[c] = side, sb, sc
                ring.append(points[tuple(s), a])
            polygons.append(ring)
    for a in range(3):  # twelve edges, each parallel to axis a
        b, c = (a + 1) % 3, (a + 2) % 3
        for sb in (-1, 1):
            for sc in (-1, 1):
                ends = []
                for sa in (-1, 1):
                    s = [0.0, 0.0, 0.0]
                    s[a], s[b], s[c] = sa, sb, sc
                    ends.append(tuple(s))
                polygons.append([points[ends[0], b], points[ends[1], b], points[ends[1], c], points[ends[0], c]])
    polygons += [[points[tuple(s), a] for a in range(3)] for s in signs]
    corner_signs = np.repeat(signs, 3, axis=0)
    keeps = np.tile(np.eye(3), (8, 1))
    shape = corner_signs * (1 - 0.2 * (1 - keeps))
    faces = []
    for ring in polygons:
        p = shape[ring]
        if np.dot(np.cross(p[1] - p[0], p[2] - p[0]), p.mean(axis=0)) < 0:
            ring = ring[::-1]
        faces += [[ring[0], ring[k], ring[k + 1]] for k in range(1, len(ring) - 1)]
    return corner_signs, keeps, np.array(faces)


_SIGNS, _KEEPS, _BOX_FACES = _box_template()


def boxes(
    centres: ArrayLike,
    sizes: ArrayLike,
    material: str,
    *,
    bevel: float = 0.01,
    frames: F64 | None = None,
    seed: int | None = None,
    solid: bool = True,
) -> Part:
    """Bevelled boxes.

    Args:
        centres: (N, 3) or (3,).
        sizes: full extents, (N, 3) or (3,).
        material: its texture's name.
        bevel: width of the 45 degree chamfer, metres.
        frames: (N, 3, 3) or (3, 3) rotations, columns the boxes' axes; None: aligned with the world.
        seed: shifts every box's UVs by its own random amount, so that each has another piece of the texture.
        solid: see :class:`Part`.
    """
    c, size = np.broadcast_arrays(np.atleast_2d(np.asarray(centres, float)), np.atleast_2d(np.asarray(sizes, float)))
    n = len(c)
    half = size[:, None, :] / 2
    inset = np.minimum(bevel, half * 0.45)
    local = _SIGNS * (half - inset * (1 - _KEEPS))
    rotation = np.broadcast_to(np.eye(3) if frames is None else frames, (n, 3, 3))
    vertices = np.einsum("nij,nkj->nki", rotation, local) + c[:, None, :]
    triangle = local[:, _BOX_FACES]  # own vertices for each face, so that UVs are projected along its axis
    normal = np.cross(triangle[:, :, 1] - triangle[:, :, 0], triangle[:, :, 2] - triangle[:, :, 0])
    axis = np.abs(normal).argmax(axis=-1)
    pairs = np.array([[2, 1], [0, 2], [0, 1]])
    uvs = np.take_along_axis(triangle, pairs[axis][:, :, None, :], axis=-1)
    if seed is not None:
        uvs = uvs + np.random.default_rng(seed).uniform(0, 8, (n, 1, 1, 2))
    count = n * len(_BOX_FACES) * 3
    return Part(
        vertices=vertices[:, _BOX_FACES].reshape(-1, 3),
        faces=np.arange(count).reshape(-1, 3),
        uvs=uvs.reshape(-1, 2),
        material=material,
        solid=solid,
    )


def lathe(profile: ArrayLike, material: str, segments: int = 48, *, turns: float = 1.0, ribs: int = 0) -> Part:
    """A profile (n, 2) of radius and height, going upwards, turned about +Y; `ribs` flutes it by 4 % of its radius."""
    rh = np.asarray(profile, dtype=np.float64)
    angle = np.linspace(0, 2 * np.pi * turns, segments + 1)
    radius = rh[:, :1] * (1 + (0.04 * np.cos(ribs * angle) if ribs else 0 * angle))
    p = np.stack([radius * np.sin(angle), np.broadcast_to(rh[:, 1:], radius.shape), radius * np.cos(angle)], axis=-1)
    return sheet(p, material, flip=True)


def spline(points: ArrayLike | Sequence[object], count: int) -> F64:
    """(count, d) points of the Catmull-Rom curve through `points`."""
    p: F64 = np.array(points, dtype=np.float64)
    p = np.concatenate([p[:1] * 2 - p[1:2], p, p[-1:] * 2 - p[-2:-1]])
    spans = len(p) - 3
    t = np.linspace(0, spans, count)
    k = np.minimum(t.astype(int), spans - 1)
    s = (t - k)[:, None]
    a, b, c, d = p[k], p[k + 1], p[k + 2], p[k + 3]
    return np.asarray(
        0.5 * (2 * b + (c - a) * s + (2 * a - 5 * b + 4 * c - d) * s**2 + (3 * b - a - 3 * c + d) * s**3),
        dtype=np.float64,
    )


def tube(
    path: ArrayLike, radius: ArrayLike, material: str, sides: int = 10, *, closed: bool = False, solid: bool = True
) -> Part:
    """A round tube along a path (n, 3), its frame carried without twist (a closed path's rest twist is spread out)."""
    p = np.asarray(path, dtype=np.float64)
    if closed:
        p = np.concatenate([p, p[:1]])
    tangent = np.gradient(p, axis=0)
    if closed:
        tangent[0] = tangent[-1] = p[1] - p[-2]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.empty_like(p)
    first = np.cross(tangent[0], [0.31, 0.89, 0.33])
    side[0] = first / np.linalg.norm(first)
    for k in range(1, len(p)):
        across = side[k - 1] - tangent[k] * np.dot(side[k - 1], tangent[k])
        side[k] = across / np.linalg.norm(across)
    other = np.cross(tangent, side)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    rest = np.arctan2(np.dot(side[-1], other[0]), np.dot(side[-1], side[0])) if closed else 0.0
    turn = angle[None, :] - np.linspace(0, rest, len(p))[:, None]
    r = np.broadcast_to(np.asarray(radius, dtype=np.float64), (len(p),))[:, None, None]
    ring = r * (np.cos(turn)[..., None] * side[:, None] + np.sin(turn)[..., None] * other[:, None])
    return sheet(p[:, None] + ring, material, flip=True, solid=solid)


def leaves(
    centres: F64, directions: F64, lengths: ArrayLike, material: str, rng: np.random.Generator, *, width: float = 0.5
) -> Part:
    """Bent leaves of four triangles, pointing along `directions` (N, 3), rolled at random.

    The texture is a palette: each leaf takes one random column u in 0..1.
    """
    n = len(centres)
    d = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    side = np.cross(d, rng.normal(size=(n, 3)))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    lift = np.cross(side, d)
    length = np.broadcast_to(np.asarray(lengths, dtype=np.float64), (n,))[:, None]
    base = centres
    middle = centres + d * length * 0.5 + lift * length * 0.12
    tip = centres + d * length
    left, right = (middle + sign * side * length * width / 2 + lift * length * 0.06 for sign in (-1, 1))
    vertices = np.stack([base, right, middle, left, tip], axis=1).reshape(-1, 3)
    pattern = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 2], [2, 4, 3]])
    faces = (5 * np.arange(n)[:, None, None] + pattern).reshape(-1, 3)
    uvs = np.repeat(np.stack([rng.random(n), np.full(n, 0.5)], axis=1), 5, axis=0)
    return Part(vertices=vertices, faces=faces, uvs=uvs, material=material, solid=False)


def blob(centre: ArrayLike, radii: ArrayLike, material: str, rough: float, seed: int, rings: int = 40) -> Part:
    """An ellipsoid with `rough` of its radius as bumps."""
    polar = np.linspace(np.pi, 0, rings)[:, None]
    turn = np.linspace(0, 2 * np.pi, 2 * rings)[None, :]
    d = np.stack(np.broadcast_arrays(np.sin(polar) * np.sin(turn), np.cos(polar), np.sin(polar) * np.cos(turn)), -1)
    bump = 1 + rough * noise(d * 3.0, seed, octaves=3)
    return sheet(np.asarray(centre) + d * bump[..., None] * np.asarray(radii, dtype=np.float64), material, flip=True)


def noise(points: ArrayLike, seed: int, octaves: int = 4) -> F64:
    """Smooth noise in about -1..1 at points (..., 3): trilinear value noise, each octave half as strong."""
    p = np.asarray(points, dtype=np.float64)
    out = np.zeros(p.shape[:-1])
    table = np.random.default_rng(seed).uniform(-1, 1, 4096)
    for octave in range(octaves):
        q = p * 2.0**octave + 17.3 * octave
        cell = np.floor(q).astype(np.int64)
        t = q - cell
        t = t * t * (3 - 2 * t)
        for corner in np.ndindex(2, 2, 2):
            c = cell + corner
            key = (c[..., 0] * 73856093) ^ (c[..., 1] * 19349663) ^ (c[..., 2] * 83492791)
            out += 0.5**octave * np.prod(np.where(corner, t, 1 - t), axis=-1) * table[key % 4096]
    return out


def soups(parts: Iterable[Part], crease: float = 40.0) -> list[Soup]:
    """The parts grouped by material, with normals smoothed across edges flatter than `crease` degrees."""
    groups: dict[tuple[str, bool], list[Part]] = {}
    for part in parts:
        groups.setdefault((part.material, part.solid), []).append(part)
    out = []
    for (material, solid), members in groups.items():
        positions = np.concatenate([m.vertices[m.faces] for m in members])
        uvs = np.concatenate([m.uvs[m.faces] for m in members])
        cross = np.cross(positions[:, 1] - positions[:, 0], positions[:, 2] - positions[:, 0])
        kept = np.linalg.norm(cross, axis=1) > 1e-12
        positions, uvs = positions[kept], uvs[kept]
        normals = _smooth(positions, cross[kept], np.cos(np.radians(crease)))
        out.append(Soup(positions=positions, normals=normals, uvs=uvs, material=material, solid=solid))
    return out


def _smooth(positions: F64, cross: F64, agree: float) -> F64:
    """Corner normals (F, 3, 3): area-weighted mean of the faces around a corner whose normals agree with its own."""
    face_normal = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    keys = np.round(positions.reshape(-1, 3) * 1e5).astype(np.int64)
    _, vertex = np.unique(keys, axis=0, return_inverse=True)
    order = np.argsort(vertex.reshape(-1), kind="stable")
    grouped = vertex.reshape(-1)[order]
    total = np.zeros((len(order), 3))
    total += cross[np.arange(len(order)) // 3]
    shift = 1
    while True:  # pair every corner with those `shift` places on among the corners of the same vertex
        same = grouped[shift:] == grouped[:-shift]
        if not same.any() or shift > 64:
            break
        a, b = order[:-shift][same], order[shift:][same]
        close = np.einsum("ij,ij->i", face_normal[a // 3], face_normal[b // 3]) > agree
        a, b = a[close], b[close]
        np.add.at(total, a, cross[b // 3])
        np.add.at(total, b, cross[a // 3])
        shift += 1
    unit: F64 = total / np.linalg.norm(total, axis=1, keepdims=True)
    return unit.reshape(-1, 3, 3)


def area(items: Sequence[Soup]) -> float:
    """Total surface, square metres."""
    return float(
        sum(
            np.linalg.norm(
                np.cross(s.positions[:, 1] - s.positions[:, 0], s.positions[:, 2] - s.positions[:, 0]), axis=1
            ).sum()
            / 2
            for s in items
        )
    )
