"""Windows: where their pictures are white, and bars in one plane behind the wall's face."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from mirelight.model import Camera
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat
from mirelight.proxy.openings import opened, windows_of
from mirelight.proxy.views import rays

DEEP, HALF, BAR = 0.2, 0.5, 0.06  # how far bars stand behind the wall's face, half of the window, half of a bar
SPACING = 0.06
F64 = NDArray[np.float64]


def plane(z: float, ways: F64, eye: F64) -> F64:
    """(H, W, 2) where rays meet it."""
    return np.asarray(eye[:2] + ways[..., :2] * ((z - eye[2]) / ways[..., 2])[..., None])


def view(
    eye: tuple[float, float, float],
    white: bool = True,
    *,
    ledge: float | None = None,
    blurred: bool = False,
    dusty: bool = False,
) -> DepthMap:
    """A wall across z with a window, and a cross of bars before a sky that is a fog; below it a white sill that lies so
    far before the wall's face; or blurred by a pixel before a sky that is brighter than white; or with a tenth of the
    sky gray by what hangs before it in this picture."""
    camera = Camera.look_at(eye, (0.2 * eye[0], 0, 0), 120, 90, yfov=50)
    _, ways = rays(camera)
    at, behind = plane(0.0, ways, np.array(eye)), plane(-DEEP, ways, np.array(eye))
    window = (np.abs(at) < HALF).all(axis=-1) & (np.abs(behind) < HALF).all(axis=-1)
    bars = window & (np.abs(behind) < BAR).any(axis=-1)
    depth = eye[2] + np.where(window, np.random.default_rng(1).uniform(0.15, 0.4, window.shape), 0.0)
    level = np.where(window & ~bars, 1.0 if white else 0.8, 0.4)
    if blurred:
        level = np.clip(gaussian_filter(np.where(window & ~bars, 2.5, 0.2), 1.0), 0, 1)
    if dusty:
        spots = gaussian_filter(
            np.random.default_rng(round(1e3 * eye[0] + 1e2 * eye[1] + 1e4)).normal(size=(90, 120)), 3
        )
        level = np.where(window & ~bars & (spots > np.quantile(spots, 0.9)), 0.6, level)
    if ledge is not None:
        x, y = np.moveaxis(plane(ledge, ways, np.array(eye)), -1, 0)
        sill = (np.abs(x) < HALF) & (y < -HALF - 0.05) & (y > -HALF - 0.2)
        depth, level = np.where(sill, eye[2] - ledge, depth), np.where(sill, 1.0, level)
    depth = depth / -ways[..., 2]
    ones = np.ones(depth.shape, np.float32)
    color = np.repeat(level[..., None], 3, axis=2).astype(np.float32)
    normal = np.tile(np.array([0, 0, 1], np.float32), (*depth.shape, 1))
    return DepthMap(camera, color, ones, depth.astype(np.float32), normal, 0 * ones, ones)


def patched(eye: tuple[float, float, float]) -> DepthMap:
    """The wall with its window's white on its face, bars too, and fog behind, as of a patch of sun or a skylight."""
    seen = view(eye)
    _, ways = rays(seen.camera)
    at = plane(0.0, ways, np.array(eye))
    white = (np.abs(at) < HALF).all(axis=-1) & ~(np.abs(at) < BAR / 3).any(axis=-1)
    color = np.repeat(np.where(white, 1.0, 0.4)[..., None], 3, axis=2).astype(np.float32)
    return replace(seen, color=color)


EYES = [(x, y, 2.5) for x in (-1.5, -0.5, 0.5, 1.5) for y in (-0.5, 0.6)]


def views(white: bool = True) -> list[DepthMap]:
    return [view(eye, white) for eye in EYES]


def wall() -> Flat:
    size = 2 * SPACING
    there = np.ones((20, 20), bool)
    return Flat(np.array([0.0, 0, 1]), 0.0, np.eye(3)[:2], size, np.array([-10, -10]), there)


def test_bars_are_cut_out_of_the_plane_they_stand_in() -> None:
    (window,) = windows_of(views(), [wall()], SPACING)
    solid = window.solid()
    assert solid.vertices[:, 2].max() == pytest.approx(-DEEP, abs=0.5 * SPACING)
    assert solid.vertices[:, 2].max() - solid.vertices[:, 2].min() == pytest.approx(2 * BAR, abs=0.5 * SPACING)
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    volume = np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6  # closed, with fronts outwards
    assert volume == pytest.approx(window.bars.sum() * window.face.cell**2 * np.ptp(solid.vertices[:, 2]))
    x, y = window.face.middles.reshape(*window.bars.shape, 3)[..., :2].transpose(2, 0, 1)
    near, far = np.minimum(np.abs(x), np.abs(y)), np.maximum(np.abs(x), np.abs(y))
    inner = (np.abs(x) < HALF - DEEP) & (np.abs(y) < HALF - 2 * SPACING)  # jambs hide the rest from most views
    assert window.bars[inner & (near < BAR - 0.03)].all() and not window.bars[inner & (near > BAR + 0.04)].any()
    rim = (far > HALF + SPACING) & (far < HALF + 1.25 * SPACING)
    assert window.bars[rim].all()


def test_a_sky_brighter_than_white_leaves_most_of_bars_it_is_blurred_over() -> None:
    """Cut out where they are half as dark as at their darkest, a third of them would be left."""
    (window,) = windows_of([view(eye, blurred=True) for eye in EYES], [wall()], SPACING)
    x, y = window.face.middles.reshape(*window.bars.shape, 3)[..., :2].transpose(2, 0, 1)
    beside = (np.abs(y) > 0.15) & (np.abs(y) < HALF - 2 * SPACING) & (np.abs(x) < 0.2)
    assert BAR < window.bars[beside].mean() * 0.4 < 2.5 * BAR


def test_what_hangs_before_panes_in_some_pictures_is_no_bar() -> None:
    (window,) = windows_of([view(eye, dusty=True) for eye in EYES], [wall()], SPACING)
    x, y = window.face.middles.reshape(*window.bars.shape, 3)[..., :2].transpose(2, 0, 1)
    near, far = np.minimum(np.abs(x), np.abs(y)), np.maximum(np.abs(x), np.abs(y))
    inner = far < HALF - DEEP
    assert window.bars[inner & (near < BAR - 0.03)].all() and window.bars[inner & (near > BAR + 0.04)].mean() < 0.03


def test_a_sill_that_shines_is_no_pane() -> None:
    ledge = 1.2 * SPACING
    (window,) = windows_of([view(eye, ledge=ledge) for eye in EYES], [wall()], SPACING)
    y = window.face.middles.reshape(*window.bars.shape, 3)[..., 1]
    panes = window.face.there & ~window.bars
    assert panes.any() and not panes[y < -HALF].any()


def test_what_is_seen_through_a_window_is_far_away_and_the_wall_stays() -> None:
    before = view((0.5, 0.6, 2.5))
    windows = windows_of(views(), [wall()], SPACING)
    after = opened(before, before, windows, SPACING, 50.0)
    _, ways = rays(before.camera)
    there = (np.abs(plane(-DEEP, ways, before.camera.position)) < HALF - SPACING).all(axis=-1)
    assert (after.depth[there] == 50).all()
    apart = (np.abs(plane(0.0, ways, before.camera.position)) > HALF + SPACING).any(axis=-1)
    np.testing.assert_array_equal(after.depth[apart], before.depth[apart])


def test_what_windows_were_only_looked_for_in_moves_nothing() -> None:
    """What is white about a guessed room's walls is put behind them to look for windows: a patch of sun comes back."""
    before, windows = view((0.5, 0.6, 2.5)), windows_of(views(), [wall()], SPACING)
    _, ways = rays(before.camera)
    apart = (np.abs(plane(0.0, ways, before.camera.position)) > HALF + SPACING).any(axis=-1)
    looked = replace(before, depth=np.where(apart, 1.05 * before.depth, before.depth))
    after = opened(before, looked, windows, SPACING, 50.0)
    np.testing.assert_array_equal(after.depth[apart], before.depth[apart])
    assert (after.depth[~apart] == 50).any()


def test_the_sun_makes_no_patch_on_a_ceiling() -> None:
    """What is white there lets light in, although its bars stand in its face."""
    seen = [patched(eye) for eye in EYES]
    assert windows_of(seen, [wall()], SPACING) == []
    assert windows_of(seen, [wall()], SPACING, np.array([0.0, 1, 0])) == []
    (skylight,) = windows_of(seen, [wall()], SPACING, np.array([0.0, 0, -1]))  # it looks down
    assert skylight.bars.any() and not skylight.bars[skylight.face.there].all()


def test_a_wall_without_white_has_no_window() -> None:
    assert windows_of(views(white=False), [wall()], SPACING) == []
