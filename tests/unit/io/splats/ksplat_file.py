"""A writer of .ksplat by the letter of GaussianSplats3D's SplatBuffer.js, for tests alone: offsets are in bytes."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from mirelight.model import SplatCloud

from .truth import C0

HALF_RANGE = 32767


def packed(clouds: Sequence[SplatCloud], level: int, *, block: float = 5.0, each: int = 256, sh: float = 0.5) -> bytes:
    """A file with a section for each cloud, whose splats come bucket by bucket; SH in 8 bits from -sh to sh."""
    count = sum(len(x) for x in clouds)
    head = bytearray(4096)
    struct.pack_into("<BBxxIIIIH", head, 0, 0, 1, len(clouds), len(clouds), count, count, level)
    struct.pack_into("<5f", head, 24, 0, 0, 0, -sh, sh)
    sections = [_section(x, level, block, each, sh) for x in clouds]
    return bytes(head) + b"".join(x for x, _ in sections) + b"".join(x for _, x in sections)


def _section(cloud: SplatCloud, level: int, block: float, each: int, sh: float) -> tuple[bytes, bytes]:
    cells = np.floor((cloud.means - cloud.means.min(axis=0)) / block)
    centres = (cells + 0.5) * block + cloud.means.min(axis=0)
    full: list[np.ndarray] = []
    others: list[np.ndarray] = []
    for cell in np.unique(cells, axis=0):
        rows = np.flatnonzero((cells == cell).all(axis=1))
        parts = [rows[k : k + each] for k in range(0, len(rows), each)]
        full += [x for x in parts if len(x) == each]
        others += [x for x in parts if len(x) < each]
    buckets = full + others if level else [np.arange(len(cloud))]
    data = b"".join(_splat(cloud, int(i), centres[i], level, block, sh) for rows in buckets for i in rows)
    if level:
        where = np.array([centres[rows[0]] for rows in buckets], "<f4")
        data = np.array([len(x) for x in others], "<u4").tobytes() + where.tobytes() + data
    head = bytearray(1024)
    struct.pack_into("<II", head, 0, len(cloud), len(cloud))
    struct.pack_into("<I", head, 28, len(data))
    if level:
        struct.pack_into("<IIfH", head, 8, each, len(buckets), block, 12)
        struct.pack_into("<I", head, 24, HALF_RANGE)
        struct.pack_into("<II", head, 32, len(full), len(others))
    struct.pack_into("<H", head, 40, round(cloud.sh.shape[1] ** 0.5) - 1)
    return bytes(head), data


def _splat(cloud: SplatCloud, i: int, centre: np.ndarray, level: int, block: float, sh: float) -> bytes:
    number = "<f4" if level == 0 else "<f2"
    where = cloud.means[i].astype("<f4").tobytes()
    if level:
        steps = np.round((cloud.means[i] - centre) * HALF_RANGE / (block / 2)) + HALF_RANGE
        where = np.clip(steps, 0, 2 * HALF_RANGE + 1).astype("<u2").tobytes()
    rgba = np.append(0.5 + C0 * cloud.sh[i, 0], cloud.opacities[i]) * 255
    rest = [cloud.sh[i, low:high].T.ravel() for low, high in ((1, 4), (4, 9))]  # all of red, then green, then blue
    values = np.concatenate(rest)
    kept = values.astype(number)
    if level == 2:
        kept = np.clip(np.floor((values + sh) / (2 * sh) * 255), 0, 255).astype("u1")
    return b"".join(
        (
            where,
            cloud.scales[i].astype(number).tobytes(),
            cloud.quats[i].astype(number).tobytes(),
            np.clip(np.round(rgba), 0, 255).astype("u1").tobytes(),
            kept.tobytes(),
        )
    )
