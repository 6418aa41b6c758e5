"""Where planes end at others that they meet."""

from __future__ import annotations

import numpy as np

from mirelight.model import F64
from mirelight.proxy.ends import ended
from mirelight.proxy.flats import Flat

CELL = 0.1


def flat(normal: tuple[float, ...], offset: float, axes: F64, low: tuple[int, int], size: tuple[int, int]) -> Flat:
    return Flat(np.array(normal), offset, axes, CELL, np.array(low), np.ones(size, bool))


def top(first: int, past: int) -> Flat:
    """The plane y = 0 for x from so many cells to so many, and z from -2 to 2."""
    return flat((0.0, 1, 0), 0.0, np.array([[1.0, 0, 0], [0, 0, 1]]), (first, -20), (past - first, 40))


def side(lowest: int, past: int) -> Flat:
    """The plane x = 0.03 for y from so many cells to so many."""
    return flat((1.0, 0, 0), 0.03, np.array([[0.0, 1, 0], [0, 0, 1]]), (lowest, -20), (past - lowest, 40))


def within(of: Flat, *points: tuple[float, float]) -> list[bool]:
    """Whether it is at x and y of points."""
    return [bool(of.within(np.array([[x, y, 0.12]]))[0]) for x, y in points]


def test_a_box_ends_at_its_edge() -> None:
    """Cells of its top reach three cells past its side, and its side's two above the top."""
    above, beside = ended([top(-30, 3), side(-30, 2)])
    assert within(above, (-1, 0), (-0.05, 0), (0.02, 0), (0.06, 0), (0.15, 0), (0.25, 0)) == [True] * 3 + [False] * 3
    assert within(beside, (0.03, -1), (0.03, -0.02), (0.03, 0.03), (0.03, 0.15)) == [True, True, False, False]
    assert above.inside(np.array([[0.15, 0, 0]]))[0]  # as it is labelled by, still


def test_a_floor_on_both_sides_of_a_wall_goes_on() -> None:
    floor, _ = ended([top(-30, 30), side(0, 20)])
    assert within(floor, (-1, 0), (-0.02, 0), (0.08, 0), (1, 0)) == [True] * 4


def test_a_shelf_at_a_wall_stays() -> None:
    """All of it is as short as what sticks out past a corner."""
    shelf, _ = ended([top(0, 4), side(-30, 30)])
    assert within(shelf, (0.06, 0), (0.15, 0), (0.35, 0)) == [True] * 3


def test_a_table_before_what_stands_on_it_stays() -> None:
    """It is as short there as what sticks out past a corner, in its own cells; what stands on it was looked at closer,
    in cells a fifth as large."""
    close = Flat(
        np.array([1.0, 0, 0]),
        0.03,
        np.array([[0.0, 1, 0], [0, 0, 1]]),
        CELL / 5,
        np.array([0, -100]),
        np.ones((30, 200), bool),
    )
    table, _ = ended([top(-30, 5), close])
    assert within(table, (-1, 0), (0.06, 0), (0.45, 0)) == [True] * 3
    lip, _ = ended([top(-30, 2), close])
    assert within(lip, (-1, 0), (0.06, 0), (0.15, 0)) == [True, False, False]
