"""Too many splats: neighbours joined into one keep the surface where it is."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.proxy.axes import axes_of
from mirelight.proxy.joining import joined

from .clouds import ball


def test_joined_splats_lie_on_the_same_surface_flat_against_it() -> None:
    cloud = ball(20_000, thin=0.05)
    few = joined(cloud, 2_000)
    assert 1_400 < len(few) <= 2_000
    radius = np.linalg.norm(few.means, axis=1)
    np.testing.assert_allclose(radius, 1, atol=0.01)
    axes, scales = axes_of(few)
    outwards = few.means / radius[:, None]
    assert np.quantile(np.abs((axes[:, :, 0] * outwards).sum(axis=1)), 0.05) > 0.95
    assert np.median(scales[:, 0] / scales[:, 1]) < 0.4
    np.testing.assert_allclose(few.opacities, 0.95, atol=1e-6)


def test_two_splats_in_a_voxel_become_their_mixture() -> None:
    cloud = ball(2, thin=0.05)
    one = joined(cloud, 1)
    mean = cloud.means.mean(axis=0)
    np.testing.assert_allclose(one.means[0], mean, atol=1e-6)
    axes, scales = axes_of(cloud)
    own = np.einsum("nik,nk,njk->nij", axes, scales**2, axes)
    off = cloud.means.astype(np.float64) - mean
    expected = (own + off[:, :, None] * off[:, None, :]).mean(axis=0)
    axes, scales = axes_of(one)
    assert np.einsum("nik,nk,njk->nij", axes, scales**2, axes)[0] == pytest.approx(expected, abs=1e-5)
