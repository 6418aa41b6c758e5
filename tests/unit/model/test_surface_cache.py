"""Light on the surface as it is kept."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.model import F32, CellLight, SurfaceCache, SurfaceCells, SurfaceTransport
from mirelight.model.surface_cache import NOTHING, SKY
from mirelight.pipeline.codecs import CELLS, lights_on, transport_between
from mirelight.store.artefacts import Artefacts

RNG = np.random.default_rng(3)


def cells() -> SurfaceCells:
    return SurfaceCells(
        size=0.25,
        origin=np.array([-1.0, 0.5, 2.0]),
        keys=RNG.integers(0, 100, (3, 2)).astype(np.uint32),
        starts=np.array([0, 1, 1, 3, 3], np.uint32),
        anchors=RNG.random((3, 3)).astype(np.float32),
        faces=RNG.integers(0, 9, (3, 4)).astype(np.int32),
        corners=RNG.random((3, 4, 2)).astype(np.float32),
        normals=RNG.random((3, 4, 3)).astype(np.float32),
    )


def transport(places: int = 2) -> SurfaceTransport:
    """Between three cells."""
    target = RNG.integers(0, 3 + places, (8, 3)).astype(np.uint32)
    target[:2] = SKY, NOTHING, 2
    return SurfaceTransport(
        seed=5,
        target=target,
        albedo=RNG.integers(0, 1 << 30, (8, 3)).astype(np.uint32),
        faces=RNG.integers(0, 9, (places, 1)).astype(np.int32),
        corners=RNG.random((places, 1, 2)).astype(np.float32),
        normals=RNG.random((places, 1, 3)).astype(np.float32),
        beyond=np.full(places, SKY, np.uint32),
        beyond_albedo=RNG.integers(0, 1 << 30, places).astype(np.uint32),
    )


def cache() -> SurfaceCache:
    def light() -> F32:
        return RNG.random((2, 3, 3)).astype(np.float32)

    return SurfaceCache(
        cells=cells(),
        lights=(
            CellLight(name="lamp é", kind="lights", direct=light(), first_bounce=None, indirect=light()),
            CellLight(
                name="sky",
                kind="environment",
                direct=light(),
                first_bounce=light(),
                indirect=light(),
                spread=np.array([[0, 9], [0, 65535]], np.uint16),
            ),
        ),
    )


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(map(same, a, b))
    if dataclasses.is_dataclass(a):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    return bool(a == b)


def test_some_cells_are_a_table_of_their_own() -> None:
    whole = cells()
    assert len(whole.some(3)) == 3 and len(whole.some(2)) == len(whole.some(1)) == 1
    some = whole.some(2)
    assert some.starts.tolist() == [0, 1, 1]
    for name in ("keys", "anchors", "faces", "corners", "normals"):
        np.testing.assert_array_equal(getattr(some, name), getattr(whole, name)[:1])


def test_cells_and_their_light_come_back_as_they_were(tmp_path: Path) -> None:
    one, kept = cache(), Artefacts(tmp_path)
    kept.put("cells", one.cells, CELLS)
    kept.put("light", one.lights, lights_on(3))
    kept.put("none", (), lights_on(3))
    assert same(kept.get("cells", CELLS), one.cells) and same(kept.get("light", lights_on(3)), one.lights)
    assert kept.get("none", lights_on(3)) == ()
    assert not same(kept.get("cells", CELLS), cells()) and not same(kept.get("light", lights_on(3)), cache().lights)
    assert kept.there() == {"cells", "light", "none"}


@pytest.mark.parametrize("places", [0, 2])
def test_transport_comes_back_as_it_was(tmp_path: Path, places: int) -> None:
    one, kept = transport(places), Artefacts(tmp_path)
    kept.put("rays", one, transport_between(3))
    assert same(kept.get("rays", transport_between(3)), one)
    assert (one.cells, one.nodes) == (3, 3 + places)
    assert kept.get("rays", transport_between(4)) is None and kept.get("rays", CELLS) is None
    assert kept.get("other", transport_between(3)) is None
    path = tmp_path / "rays.light"
    sound = path.read_bytes()
    for damaged in (sound[:-64], b"", sound.replace(b'"seed": 5', b'"sead": 5')):
        path.write_bytes(damaged)
        assert kept.get("rays", transport_between(3)) is None


def test_rays_end_on_nodes_that_there_are() -> None:
    one = transport()
    for name, ends in (("target", one.target), ("beyond", one.beyond)):
        wrong = ends.copy()
        wrong.flat[-1] = one.nodes
        with pytest.raises(ValueError, match="end nowhere"):
            dataclasses.replace(one, **{name: wrong})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="6 rays"):
        dataclasses.replace(one, target=one.target[:6], albedo=one.albedo[:6])


def test_lights_are_scaled_and_joined() -> None:
    one = cache()
    lamp, sky = one.lights
    doubled = sky.scaled(np.array([2.0, 1.0, 0.5]))
    assert doubled.first_bounce is not None and sky.first_bounce is not None
    np.testing.assert_allclose(doubled.first_bounce, sky.first_bounce * np.array([2, 1, 0.5], np.float32))
    np.testing.assert_allclose(doubled.indirect, sky.indirect * np.array([2, 1, 0.5], np.float32))
    alone = dataclasses.replace(one, lights=(lamp,))
    assert [x.name for x in alone.joined(dataclasses.replace(one, lights=(sky,))).lights] == ["lamp é", "sky"]
    with pytest.raises(ValueError, match="two lights"):
        one.joined(alone)
    with pytest.raises(ValueError, match="different cells"):
        alone.joined(dataclasses.replace(cache(), lights=(sky,)))


def test_what_is_damaged_or_of_other_cells_is_not_there(tmp_path: Path) -> None:
    kept = Artefacts(tmp_path)
    kept.put("cells", cells(), CELLS)
    kept.put("light", cache().lights, lights_on(3))
    assert kept.get("light", lights_on(4)) is None
    assert (
        kept.get("light", CELLS) is None
        and kept.get("cells", lights_on(3)) is None
        and kept.get("other", CELLS) is None
    )
    for name in ("cells", "light"):
        path = tmp_path / f"{name}.light"
        sound = path.read_bytes()
        other_size, other_kind = (
            sound.replace(b'"size": 0.25', b'"size": -0.2'),
            sound.replace(b'"lights"', b'"gights"'),
        )
        for damaged in (sound[:40], sound[:-64], b"", b"PK" * 40, other_size, other_kind):
            path.write_bytes(damaged)
            if damaged != sound:
                assert (kept.get(name, CELLS) if name == "cells" else kept.get(name, lights_on(3))) is None
