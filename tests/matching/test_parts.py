"""The solver against SciPy's, pictures against the writer that made them, curves against their inverses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import nnls

from mirelight.apps.match.solve import Column, closest, fitted, nonnegative
from mirelight.apps.match.target import read_target, resized
from mirelight.apps.match.tone import CURVES, inverse
from mirelight.apps.match.uncertain import tiles, uncertainties
from mirelight.base import colour
from mirelight.base.errors import InputError
from mirelight.io.png import encode_display, write_png
from mirelight.model import DisplaySettings, DisplayView, ToneCurve


def test_no_light_shows_on_black_splats() -> None:
    columns = [Column(np.zeros((5, 3)), k) for k in range(3)]
    found, seen = fitted(columns, np.full((5, 3), 0.2), np.ones((5, 3)))
    assert not seen.any() and not found.any()


@pytest.mark.parametrize("seed", range(20))
def test_the_same_weights_as_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 20))
    a = rng.random((60, n)) ** 3
    b = a @ rng.normal(size=n) + rng.normal(size=60)  # about half of them want to be negative
    np.testing.assert_allclose(nonnegative(a.T @ a, a.T @ b), nnls(a, b)[0], atol=1e-8)


def test_a_column_without_light_and_a_doubled_one() -> None:
    a = np.array([[1.0, 0, 1], [2, 0, 2], [3, 0, 3]])
    found = nonnegative(a.T @ a, a.T @ np.array([2.0, 4, 6]))
    assert found[1] == 0
    assert found.sum() == pytest.approx(2)


def test_outliers_move_the_fit_little() -> None:
    """A tenth of the picture is painted over: least squares alone would be off by a third."""
    rng = np.random.default_rng(3)
    columns = [Column(rng.random((900, 3)), 1), Column(rng.random((900, 3)), 1)]
    true = np.array([2.0, 0.7])
    picture = 2.0 * columns[0].picture + 0.7 * columns[1].picture
    picture += rng.normal(scale=0.005, size=picture.shape)
    picture[:90] += 3
    weight = np.ones((900, 3)) * [0, 1, 0]
    found, seen = fitted(columns, picture, weight)
    assert seen.all()
    np.testing.assert_allclose(found, true, rtol=0.01)


def test_what_a_picture_does_not_show_is_said() -> None:
    rng = np.random.default_rng(0)
    columns = [Column(rng.random((50, 3)), 0), Column(np.zeros((50, 3)), 0)]
    found, seen = fitted(columns, 3 * columns[0].picture, np.ones((50, 3)))
    assert seen.tolist() == [True, False]
    np.testing.assert_allclose(found, [3, 0])


@pytest.mark.parametrize("curve", CURVES)
def test_tone_curves_are_turned_back(curve: ToneCurve) -> None:
    light = (np.random.default_rng(1).random((4000, 3)) ** 3 * 2).astype(np.float32)
    shown = colour.tone_map(light, curve)
    back, known = inverse(np.minimum(shown, 1), curve)
    inside = known & (shown.max(axis=1, keepdims=True) < 0.98)
    assert inside.mean() > 0.3
    np.testing.assert_allclose(back[inside], light[inside], rtol=2e-3, atol=1e-3)


@pytest.mark.parametrize("curve", CURVES)
def test_a_displayed_frame_gives_its_light_back(tmp_path: Path, curve: ToneCurve) -> None:
    rng = np.random.default_rng(2)
    alpha = rng.random((30, 40)).astype(np.float32)
    light = (rng.random((30, 40, 3)) * 0.9 * alpha[..., None]).astype(np.float32)
    display = DisplaySettings(exposure=-0.5, tone=curve, background=(0.2, 0.5, 0.1))
    write_png(tmp_path / "a.png", encode_display(np.dstack([light, alpha]), display), {})
    found, counts = read_target(tmp_path / "a.png", None, curve).light(alpha, display)
    assert (counts > 0).mean() > 0.7
    thick = (counts > 0) & (alpha[..., None] > 0.3)
    np.testing.assert_allclose(found[thick], light[thick], atol=0.03)
    assert abs(float(np.mean((found - light)[thick]))) < 1e-3


def test_clipped_and_masked_pixels_do_not_count(tmp_path: Path) -> None:
    pixels = np.full((20, 30, 3), 100, np.uint8)
    pixels[:5, :, 0] = 255
    mask = np.full((20, 30, 3), 255, np.uint8)
    mask[:, 20:] = 0
    write_png(tmp_path / "a.png", pixels, {})
    write_png(tmp_path / "mask.png", mask, {})
    target = read_target(tmp_path / "a.png", tmp_path / "mask.png", "none")
    _, counts = target.light(np.ones((20, 30), np.float32), DisplaySettings())
    assert not counts[:5, :, 0].any() and counts[:5, :20, 1].all() and not counts[:, 20:].any()


def test_pictures_of_another_shape_or_curve_are_refused(tmp_path: Path) -> None:
    write_png(tmp_path / "a.png", np.full((20, 30, 3), 100, np.uint8), {})
    target = read_target(tmp_path / "a.png", None, "none")
    with pytest.raises(InputError, match="30 x 20 pixels"):
        target.light(np.ones((20, 20), np.float32), DisplaySettings())
    with pytest.raises(InputError, match=r"display\.view is 'ACES', which is not turned back"):
        view = DisplayView(config="ocio://default", display="screen", view="ACES", identity="1")
        target.light(np.ones((20, 30), np.float32), DisplaySettings(view=view))
    with pytest.raises(InputError, match="agx"):
        read_target(tmp_path / "a.png", None, "agx")
    write_png(tmp_path / "mask.png", np.full((20, 20, 3), 255, np.uint8), {})
    with pytest.raises(InputError, match="20 x 20 pixels for a picture of 30 x 20 pixels"):
        read_target(tmp_path / "a.png", tmp_path / "mask.png", "none")


def test_errors_that_all_columns_share_do_not_make_lights_weaker() -> None:
    """A quarter up and down from pixel to pixel, as splats are off: in light every weight would lose its variance."""
    rng = np.random.default_rng(5)
    true, pictures = np.array([1.0, 0.5]), rng.uniform(0.05, 0.6, (2, 20_000, 3))
    target = np.einsum("n,npk->pk", true, pictures)
    off = np.exp(rng.normal(-(0.25**2) / 2, 0.25, (20_000, 1)))  # right in the mean
    columns = [Column(picture * off, k) for picture in pictures for k in range(3)]
    found, _ = closest(columns, target, np.zeros_like(target), np.ones_like(target), 1.0)
    np.testing.assert_allclose(found, np.repeat(true, 3), rtol=0.02)
    in_light, _ = fitted(columns, target, np.ones_like(target))
    assert (in_light < 0.97 * np.repeat(true, 3)).all()


def test_areas_keep_their_mean() -> None:
    image = np.random.default_rng(5).random((37, 53, 3)).astype(np.float32)
    np.testing.assert_allclose(resized(image, (9, 16)).mean(axis=(0, 1)), image.mean(axis=(0, 1)), rtol=1e-5)
    blocks = image[:36, :52].reshape(9, 4, 13, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(resized(image[:36, :52], (9, 13)), blocks, rtol=1e-5)


def test_what_does_not_count_stays_nothing_at_any_size() -> None:
    """Less than nothing by rounding had no square root, and every light came out as none."""
    rng = np.random.default_rng(0)
    counts = rng.random((150, 200, 3)).astype(np.float32) * (rng.random((150, 200, 1)) > 0.3).astype(np.float32)
    counts[75:, :100] = 0
    small = resized(counts, (90, 120))
    assert small.min() >= 0
    assert small[45:, :60].max() == 0


SIZE = 36, 64


def lamps() -> list[Column]:
    """Two lamps on a wall, one to the left and one to the right, in every channel; the second is faint in blue."""
    down, right = (np.arange(n)[s] / SIZE[0] for n, s in zip(SIZE, (np.s_[:, None], np.s_[None]), strict=True))
    falls = [1 / (0.1 + (down - 0.5) ** 2 + (right - x) ** 2) for x in (0.4, 1.4)]
    pictures = [np.repeat(f.reshape(-1, 1), 3, axis=1) * [1, 1, s] for f, s in zip(falls, (1, 0.02), strict=True)]
    return [Column(0.05 * picture, k) for picture in pictures for k in range(3)]


def told_of(target: np.ndarray, columns: list[Column]) -> tuple[np.ndarray, np.ndarray]:
    """Weights found, and how far they may be off."""
    nothing, counts = np.zeros_like(target), np.ones_like(target)
    found, told = closest(columns, target, nothing, counts, 1.0)
    return found, uncertainties(columns, found, told, target, nothing, counts, 1.0, tiles(SIZE))


def test_a_scenes_errors_are_what_is_said_of_them() -> None:
    columns, true = lamps(), np.array([1.0, 1, 1, 0.7, 0.7, 0.7])
    picture = sum(x * c.picture * np.eye(3)[c.channel] for x, c in zip(true, columns, strict=True))
    shares = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        areas = rng.uniform(0.9, 1.1, (4, 4, 3)).repeat(9, axis=0).repeat(16, axis=1)  # colours or shadows that are off
        found, off = told_of(picture * areas.reshape(-1, 3), columns)
        shares.append(np.abs(found - true) / off)
        assert (off[:5] < 0.3 * true[:5]).all()
        assert off[5] > 5 * off[4]  # the faint one
    assert np.mean(np.array(shares) <= 1) > 0.8
    assert np.max(shares) < 2.5


def test_a_picture_that_the_lights_explain_leaves_no_doubt() -> None:
    columns = lamps()
    picture = sum(0.5 * c.picture * np.eye(3)[c.channel] for c in columns)
    found, off = told_of(np.asarray(picture), columns)
    np.testing.assert_allclose(found, 0.5, rtol=1e-4)
    assert (off < 1e-3).all()


def test_lights_that_look_alike_and_one_that_does_not_show_are_not_known() -> None:
    left, right, *_ = lamps()[:1] + lamps()[3:4]
    dark = Column(np.zeros_like(left.picture), 0)
    _, off = told_of(left.picture + right.picture * [1, 0, 0], [left, right, left, dark])
    assert np.isinf(off[[0, 2, 3]]).all()
    assert off[1] < 1e-3


def test_tiles_are_about_square_and_cover_the_picture() -> None:
    tile = tiles((90, 160)).reshape(90, 160)
    assert len(np.unique(tile)) == 9 * 16
    assert all((tile[::10, ::10].ravel() == tile[9::10, 9::10].ravel()).tolist())
