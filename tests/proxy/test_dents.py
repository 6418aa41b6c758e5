"""A dent that few views see in a table, and one that most see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.model import Camera
from mirelight.proxy.dents import filled
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat
from mirelight.proxy.labels import Labels, labelled
from mirelight.proxy.views import rays

SPACING = 0.05
TABLE = Flat(
    np.array([0.0, 1, 0]), 0.0, np.array([[1.0, 0, 0], [0, 0, 1]]), 0.1, np.array([-8, -8]), np.ones((16, 16), bool)
)
EYES = ((0.0, 3.0, 0.3), (2.0, 2.2, 0.5), (-2.0, 2.2, 0.5), (0.3, 2.4, -2.0), (0.5, 2.4, 2.0))


def view(eye: tuple[float, float, float], deep: float) -> DepthMap:
    """The table from above, with a dent so many spacings deep in its middle."""
    camera = Camera.look_at(eye, (0, 0, 0), 160, 120, yfov=40)
    origins, ways = rays(camera)
    top, below = ((y - origins[..., 1]) / ways[..., 1] for y in (0.0, -deep * SPACING))
    at = origins + ways * below[..., None]
    dent = (np.abs(at[..., 0]) < 0.3) & (np.abs(at[..., 2]) < 0.3)
    one = np.ones(dent.shape, np.float32)
    normal = np.broadcast_to(np.array([0, 1, 0], np.float32), (*dent.shape, 3))
    color = np.repeat(np.where(dent, 0.1, 0.2)[..., None], 3, axis=2).astype(np.float32)
    return DepthMap(camera, color, one, np.where(dent, below, top).astype(np.float32), normal, 0 * one, one)


def settled(deep: list[float]) -> list[Labels]:
    views = [view(eye, x) for eye, x in zip(EYES, deep, strict=True)]
    return filled(views, [labelled(x, [TABLE], SPACING) for x in views], [TABLE], SPACING)


def middle(labels: Labels) -> float:
    """Share of the pixels of the picture's middle that lie on the table."""
    return float((labels.plane[55:65, 75:85] == 0).mean())


def test_a_dent_that_one_view_sees_is_none() -> None:
    dented = view(EYES[0], 4.0)
    assert middle(labelled(dented, [TABLE], SPACING)) == 0
    assert [middle(x) for x in settled([4.0, 0, 0, 0, 0])] == [1.0] * 5


def test_a_dent_that_most_views_see_stays() -> None:
    assert max(middle(x) for x in settled([4.0, 4.0, 4.0, 4.0, 0])[:4]) < 0.1


def test_what_lies_far_behind_is_no_dent() -> None:
    """A hole in the table, which others see the far side of the table through."""
    assert middle(settled([20.0, 0, 0, 0, 0])[0]) == 0


def test_nothing_changes_where_nothing_is_behind() -> None:
    views = [view(eye, 0.0) for eye in EYES]
    labels = [labelled(x, [TABLE], SPACING) for x in views]
    for before, after in zip(labels, filled(views, labels, [TABLE], SPACING), strict=True):
        np.testing.assert_array_equal(before.plane, after.plane)
        np.testing.assert_array_equal(before.sure, after.sure)


def test_a_thing_on_the_table_stays() -> None:
    """What lies before the plane is not asked."""
    views = [view(eye, 0.0) for eye in EYES]
    views[0] = replace(views[0], depth=np.where(np.arange(160) < 80, views[0].depth - 0.5, views[0].depth).astype("f4"))
    labels = [labelled(x, [TABLE], SPACING) for x in views]
    np.testing.assert_array_equal(filled(views, labels, [TABLE], SPACING)[0].plane, labels[0].plane)
