"""Turns of one direction onto another."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.base.conventions import turn_onto


def test_the_shortest_turn() -> None:
    """It takes one onto the other, of any lengths, about an axis across both."""
    rng = np.random.default_rng(4)
    for one, other in rng.standard_normal((20, 2, 3)):
        turn = turn_onto(one, other)
        np.testing.assert_allclose(turn @ one / np.linalg.norm(one), other / np.linalg.norm(other), atol=1e-12)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(turn @ np.cross(one, other), np.cross(one, other), atol=1e-12)


def test_opposite_and_equal_directions() -> None:
    for one in np.eye(3):
        turn = turn_onto(one, -one)
        np.testing.assert_allclose(turn @ one, -one, atol=1e-15)
        assert np.linalg.det(turn) == pytest.approx(1)
        np.testing.assert_array_equal(turn_onto(one, 2 * one), np.eye(3))
