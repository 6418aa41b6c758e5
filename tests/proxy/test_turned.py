"""Discs turned out of their surface are turned back; those that lie on it keep their planes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from mirelight.model import SplatCloud, triangles
from mirelight.proxy import make
from mirelight.proxy.axes import axes_of
from mirelight.proxy.capture import look_at_capture
from mirelight.proxy.discs import Discs
from mirelight.proxy.turned import neighbourhoods, righted

from .clouds import box_shell

SIDE, STEP = 2.0, 0.08


def turned(cloud: SplatCloud, degrees: float, off: float) -> SplatCloud:
    """Discs each turned by about so much, any way, and moved as far as `off` tells, any way."""
    rng = np.random.default_rng(0)
    turn = Rotation.from_rotvec(np.radians(degrees) / 1.2 * rng.normal(size=(len(cloud), 3)))
    own = Rotation.from_quat(cloud.quats[:, [1, 2, 3, 0]])
    quats = (turn * own).as_quat()[:, [3, 0, 1, 2]].astype(np.float32)
    means = cloud.means + off * rng.normal(size=(len(cloud), 3)).astype(np.float32)
    return replace(cloud, quats=quats, means=means)


def discs_of(cloud: SplatCloud) -> Discs:
    capture = look_at_capture(cloud, Path("a.ply"))
    axes, scales = axes_of(capture.splats)
    return Discs(capture.splats.means.astype(np.float64), axes, scales, capture.spacing)


def test_turned_discs_get_the_planes_of_their_neighbours_up_to_the_edges() -> None:
    discs = discs_of(turned(box_shell(SIDE, STEP, thin=0.05), 12, 0.05 * STEP))
    near, _, local = neighbourhoods(discs.at)
    found = righted(discs, near, local)
    before, after = (np.degrees(np.arccos(np.abs(x.normal).max(axis=1))) for x in (discs, found))
    assert np.median(before) > 8
    assert np.median(after) < 2 and np.quantile(after, 0.99) < 6
    np.testing.assert_allclose(
        found.axes.transpose(0, 2, 1) @ found.axes, np.tile(np.eye(3), (len(found.at), 1, 1)), atol=1e-9
    )
    off = np.abs(np.abs(found.at).max(axis=1) - SIDE / 2)
    assert np.median(off) < np.median(np.abs(np.abs(discs.at).max(axis=1) - SIDE / 2))


def test_discs_that_lie_on_their_surface_are_left_alone() -> None:
    for cloud in (box_shell(SIDE, STEP, thin=0.05), turned(box_shell(SIDE, STEP, thin=0.05), 1, 0.02 * STEP)):
        discs = discs_of(cloud)
        near, _, local = neighbourhoods(discs.at)
        assert righted(discs, near, local) is discs


def test_a_proxy_of_turned_discs_is_no_shingles() -> None:
    made = make(turned(box_shell(SIDE, STEP, thin=0.05), 12, 0.02 * STEP))
    assert made.method == "cells"
    corners = made.mesh.vertices[made.mesh.faces].astype(np.float64)
    assert np.abs(corners).max() < SIDE / 2 + 0.4 * STEP
    areas = triangles.areas(corners)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / (2 * areas[:, None])
    lean = np.degrees(np.arccos(np.minimum(np.abs(normals).max(axis=1), 1)))
    assert areas[lean < 4].sum() > 0.9 * areas.sum()
