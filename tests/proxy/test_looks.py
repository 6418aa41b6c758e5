"""What looks otherwise than a plane does to most pictures is not on it, though by depth nobody knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.model import Camera
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat
from mirelight.proxy.labels import labelled
from mirelight.proxy.looks import Look
from mirelight.proxy.views import rays

SPACING = 0.05
ROAD = Flat(
    np.array([0.0, 1, 0]), 0.0, np.array([[1.0, 0, 0], [0, 0, 1]]), 0.1, np.array([-12, -12]), np.ones((24, 24), bool)
)
EYES = ((0.0, 3.0, 0.3), (2.0, 2.2, 0.5), (-2.0, 2.2, 0.5), (0.3, 2.4, -2.0), (0.5, 2.4, 2.0), (1.5, 2.4, 1.5))
GREY, RED, LINE = (0.5, 0.5, 0.5), (0.7, 0.1, 0.1), (0.9, 0.9, 0.9)


def view(eye: tuple[float, float, float]) -> DepthMap:
    """A grey road with a white line along it."""
    camera = Camera.look_at(eye, (0, 0, 0), 160, 120, yfov=40)
    origins, ways = rays(camera)
    depth = -origins[..., 1] / ways[..., 1]
    at = origins + ways * depth[..., None]
    color = np.where((np.abs(at[..., 0]) < 0.2)[..., None], LINE, GREY).astype(np.float32)
    one = np.ones(depth.shape, np.float32)
    normal = np.broadcast_to(np.array([0, 1, 0], np.float32), (*depth.shape, 3))
    return DepthMap(camera, color, one, depth.astype(np.float32), normal, 0 * one, one)


def hidden(seen: DepthMap, color: tuple[float, float, float], *, trust: float) -> DepthMap:
    """A view with a thing of one colour in the middle of its picture, that hangs anywhere before the road."""
    there = np.zeros(seen.depth.shape, bool)
    there[40:80, 50:110] = True
    return replace(
        seen,
        color=np.where(there[..., None], np.array(color, np.float32), seen.color),
        depth=np.where(there, seen.depth - np.float32(0.8), seen.depth),
        trust=np.where(there, np.float32(trust), seen.trust),
        spread=np.where(there, np.float32(trust < 0.5), seen.spread),
    )


def on_road(seen: DepthMap, looks: list[Look]) -> float:
    """Share of that thing's pixels that are taken for the road's."""
    return float((labelled(seen, [ROAD], SPACING, looks).plane[48:72, 58:102] == 0).mean())


def test_fog_of_another_colour_is_not_the_plane_behind_it() -> None:
    views = [view(eye) for eye in EYES]
    car = hidden(views[5], RED, trust=0.01)
    assert on_road(car, []) == 1.0
    assert on_road(car, [Look.of(ROAD, [*views[:5], car], SPACING)]) == 0.0


def test_fog_of_its_colour_is_the_plane() -> None:
    views = [view(eye) for eye in EYES]
    fog = replace(hidden(views[5], GREY, trust=0.01), color=views[5].color)
    assert on_road(fog, [Look.of(ROAD, [*views[:5], fog], SPACING)]) == 1.0


def test_colours_of_the_plane_are_those_that_most_see() -> None:
    """A line is told from the road beside it; what is surely before it does not count, and what few see is not told."""
    views = [view(eye) for eye in EYES]
    parked = [hidden(x, RED, trust=1.0) for x in views]  # in the midst of each picture, and known to be there
    look = Look.of(ROAD, [*views[:4], *parked], SPACING)
    at = np.array([[[0.0, 0, 0.05], [0.5, 0, 0.05]]])
    assert look.other(np.array([[LINE, GREY]], np.float32), at) == pytest.approx(np.zeros((1, 2)))
    assert look.other(np.array([[GREY, LINE]], np.float32), at) == pytest.approx(np.ones((1, 2)))
    few = Look.of(ROAD, views[:3], SPACING)
    assert few.other(np.array([[RED, RED]], np.float32), at) == pytest.approx(np.zeros((1, 2)))
    assert look.other(np.array([[RED]], np.float32), np.array([[[50.0, 0, 0]]])) == pytest.approx(np.zeros((1, 1)))


def test_where_pictures_do_not_agree_no_colour_is_told() -> None:
    """As on what mirrors, or where as many show a thing as the plane."""
    views = [view(eye) for eye in EYES]
    shades = np.linspace(0.1, 0.9, len(views))
    varied = [replace(x, color=np.full_like(x.color, shade)) for x, shade in zip(views, shades, strict=True)]
    look = Look.of(ROAD, varied, SPACING)
    assert look.other(np.array([[RED]], np.float32), np.array([[[0.5, 0, 0.05]]])) == pytest.approx(np.zeros((1, 1)))
