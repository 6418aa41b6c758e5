"""Moving and merging splats, proved by what they look like: positions, covariances and colours by direction."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.base import conventions, sh
from mirelight.base.errors import InputError
from mirelight.io import splats
from mirelight.model import SplatCloud

from . import truth

EULERS = [(0, 0, 180), (90, 0, 0), (0, -90, 0), (12, 34, 56), (-170, 5, 99)]


def covariances(cloud: SplatCloud) -> NDArray[np.float64]:
    axes = conventions.rotation_from_quaternion(cloud.quats) * cloud.scales[:, None]
    return np.asarray(axes @ axes.transpose(0, 2, 1))


@pytest.mark.parametrize("euler", EULERS)
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_similarity_moves_everything_alike(euler: tuple[float, float, float], degree: int) -> None:
    cloud = truth.cloud(30, degree)
    rotation = conventions.rotation_from_euler(euler)
    matrix = conventions.compose((1, -2, 3), rotation, 1.7)
    moved = splats.transform(cloud, matrix)
    np.testing.assert_allclose(moved.means, 1.7 * cloud.means @ rotation.T + (1, -2, 3), atol=1e-5)
    wanted = 1.7**2 * rotation @ covariances(cloud) @ rotation.T
    np.testing.assert_allclose(covariances(moved), wanted, atol=1e-5)
    np.testing.assert_array_equal(moved.opacities, cloud.opacities)
    directions = np.random.default_rng(2).normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before = np.einsum("dk,nkc->ndc", sh.basis(directions, degree), cloud.sh)
    after = np.einsum("dk,nkc->ndc", sh.basis(directions @ rotation.T, degree), moved.sh)
    np.testing.assert_allclose(after, before, atol=2e-6)


def test_the_identity_shares_what_it_can() -> None:
    cloud = truth.cloud(10, 2)
    moved = splats.transform(cloud, np.eye(4))
    np.testing.assert_array_equal(moved.means, cloud.means)
    for name in ("quats", "scales", "opacities", "sh"):
        assert np.shares_memory(getattr(moved, name), getattr(cloud, name))


def test_there_and_back() -> None:
    cloud = truth.cloud(50)
    matrix = conventions.compose((4, 5, 6), conventions.rotation_from_euler((10, 20, 30)), 0.25)
    again = splats.transform(splats.transform(cloud, matrix), np.linalg.inv(matrix))
    np.testing.assert_allclose(again.means, cloud.means, atol=1e-5)
    np.testing.assert_allclose(again.scales, cloud.scales, rtol=1e-6)
    np.testing.assert_allclose(again.sh, cloud.sh, atol=2e-6)
    assert truth.rotation_angle(again.quats, cloud.quats).max() < 2e-3


def test_moving_keeps_the_marks() -> None:
    cloud = truth.cloud(5, 0, antialiased=True)
    assert splats.transform(cloud, conventions.compose(scale=2)).antialiased


BAD = {
    "uneven": (np.diag([1.0, 2, 1, 1]), "evenly"),
    "mirror": (np.diag([-1.0, 1, 1, 1]), "mirrored"),
    "point mirror": (np.diag([-1.0, -1, -1, 1]), "mirrored"),
    "shear": (np.array([[1, 0.6, 0, 0], [0, 0.8, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]), "sheared"),
    "nothing": (np.diag([0.0, 0, 0, 1]), "to nothing"),
    "projection": (np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1.0]]), "row 0 0 0 1"),
    "nan": (np.diag([np.nan, 1, 1, 1]), "finite"),
    "shape": (np.eye(3), "4 x 4"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_splats_cannot_do_is_refused(name: str) -> None:
    matrix, said = BAD[name]
    with pytest.raises(ValueError, match=said):
        splats.transform(truth.cloud(3, 0), matrix)


def test_merging_pads_colours() -> None:
    a, b = truth.cloud(10, 1), truth.cloud(20, 3)
    both = splats.merge([a, b])
    assert (len(both), both.sh_degree) == (30, 3)
    for name in ("means", "quats", "scales", "opacities"):
        np.testing.assert_array_equal(getattr(both, name), np.concatenate([getattr(a, name), getattr(b, name)]))
    np.testing.assert_array_equal(both.sh[:10, :4], a.sh)
    np.testing.assert_array_equal(both.sh[:10, 4:], 0)
    np.testing.assert_array_equal(both.sh[10:], b.sh)


def test_merging_one_and_none() -> None:
    cloud = truth.cloud(3, 0)
    assert splats.merge([cloud]) is cloud
    with pytest.raises(ValueError, match="no splat clouds"):
        splats.merge([])


def test_merging_counts_what_was_dropped() -> None:
    cloud = truth.cloud(3, 0)
    parts = [SplatCloud(**{n: getattr(cloud, n) for n in FIELDS}, dropped=n) for n in (2, 5)]
    assert splats.merge(parts).dropped == 7


FIELDS = ("means", "quats", "scales", "opacities", "sh")


def test_antialiased_and_plain_splats_do_not_mix() -> None:
    with pytest.raises(InputError, match="antialiasing"):
        splats.merge([truth.cloud(3, 0), truth.cloud(3, 0, antialiased=True)])
