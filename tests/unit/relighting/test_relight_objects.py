"""Inserted objects in a frame: the split at their depth, on buffers made by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mirelight import relighting
from mirelight.model import Frame, SplatLayer
from mirelight.relighting.frame import covered

from .test_relight import RATIO, H, W, camera, lit, splat_layer


def relit(objects: Any, **changed: Any) -> Frame:
    new = replace(lit(0.4), objects=objects)
    return relighting.apply(splat_layer(**changed), new, RATIO, captured=lit(0.2), captured_level=0.1)


def in_front(through: float, gray: float = 0.0) -> SplatLayer:
    return replace(
        splat_layer(),
        transmittance=np.full((H, W), through, np.float32),
        color=np.full((H, W, 3), gray * (1 - through), np.float32),
    )


def test_a_frame_stays_bit_for_bit_where_no_object_is() -> None:
    frame = relit(replace(lit(5.0, coverage=0.0), variance=np.zeros((H, W, 3), np.float32)))
    made = relighting.with_objects(frame, in_front(1.0), RATIO)
    np.testing.assert_array_equal(made.rgba, frame.rgba)
    np.testing.assert_array_equal(made.noise, frame.noise)
    plain = relit(None)
    assert relighting.with_objects(plain, None, RATIO) is plain


def test_an_object_before_everything_hides_it_by_its_coverage() -> None:
    frame = relit(lit(5.0, coverage=0.25))
    made = relighting.with_objects(frame, in_front(1.0), RATIO)
    np.testing.assert_allclose(made.rgba[..., :3], 0.75 * frame.rgba[..., :3] + 0.25 * 5.0, rtol=1e-5)
    np.testing.assert_allclose(made.rgba[..., 3], 0.75 * frame.rgba[..., 3] + 0.25, rtol=1e-5)


def test_what_is_in_front_veils_an_object_by_what_it_lets_through() -> None:
    frame = relit(lit(5.0, coverage=1.0))
    made = relighting.with_objects(frame, in_front(0.3), RATIO)
    np.testing.assert_allclose(made.rgba[..., :3], 0.3 * 5.0, rtol=1e-5)
    np.testing.assert_allclose(made.rgba[..., 3], 1.0, rtol=1e-5)
    assert made.noise is not None and frame.noise is not None
    np.testing.assert_allclose(made.noise, 0.3 * 0.2, rtol=1e-4)  # that of the object alone
    bright = relighting.with_objects(frame, in_front(0.3, gray=1.0), RATIO)
    assert frame.factor is not None
    np.testing.assert_allclose(bright.rgba[..., :3], 0.7 * frame.factor + 0.3 * 5.0, rtol=1e-4)


def test_without_splats_the_frame_is_proxy_and_objects() -> None:
    new = replace(lit(0.4, coverage=0.75), objects=lit(2.0, coverage=0.25))
    frame = relighting.with_objects(relighting.apply(None, new, RATIO), None, RATIO)
    np.testing.assert_allclose(frame.rgba[..., :3], 0.75 * 0.4 + 0.25 * 2, rtol=1e-5)
    np.testing.assert_allclose(frame.rgba[..., 3], 1)
    assert frame.camera.width == camera().width


def test_the_shadow_is_light_with_objects_over_light_without() -> None:
    cover = np.where(np.arange(W) < 2, 0.25, 1.0)  # of the surface beside an object
    made = relighting.shadow(lit(0.3, coverage=cover), lit(0.4), camera())
    np.testing.assert_allclose(made, 0.75, rtol=1e-5)
    np.testing.assert_array_equal(relighting.shadow(lit(0.3, coverage=0.0), lit(0.4), camera()), 1)
    np.testing.assert_array_equal(relighting.shadow(lit(0.3), lit(0.0), camera()), 1)


def test_what_is_in_front_is_lit_as_what_is_beside_the_object_and_not_as_what_it_hides() -> None:
    """A fog before a box: the ground behind the box is black, as it lies in its shadow; the engine has that."""
    size, wide = (60, 200), slice(98, 102)
    share = np.zeros(size, np.float32)
    share[:, wide] = 1
    objects = np.concatenate([np.full((*size, 3), 0.2), np.ones((*size, 1))], axis=-1).astype(np.float32)
    objects *= share[..., None]
    factor = np.repeat(np.where(share > 0, 0, 1)[..., None], 3, axis=-1).astype(np.float32)
    front = replace(
        splat_layer(),
        camera=camera().resized(size[1], size[0]),
        transmittance=np.full(size, 0.5, np.float32),
        color=np.full((*size, 3), 0.5, np.float32),
        depth=np.ones(size, np.float32),
        median_depth=np.ones(size, np.float32),
    )
    behind = np.ones((*size, 4), np.float32)
    made = covered(behind, factor, front, objects, RATIO)
    np.testing.assert_allclose(made[:, wide, :3], 0.5 + 0.5 * 0.2, atol=0.01)
    np.testing.assert_array_equal(made[share == 0], behind[share == 0])
    tinted = covered(behind, factor, front, objects, replace(RATIO, profile="playcanvas"))
    np.testing.assert_allclose(tinted[:, wide, :3], 0.5 * 0.2, rtol=1e-5)
    assert (factor[:, wide] == 0).all()  # the frame's own stays
