"""Light on the surface as a file."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from mirelight.errors import InputError
from mirelight.io import surface_cache
from mirelight.model import F32, CellLight, SurfaceCache, SurfaceCells

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


def cache() -> SurfaceCache:
    def light() -> F32:
        return RNG.random((2, 3, 3)).astype(np.float32)

    return SurfaceCache(
        cells=cells(),
        lights=(
            CellLight(name="lamp é", kind="lights", direct=light(), met=None, indirect=light()),
            CellLight(name="sky", kind="environment", direct=light(), met=light(), indirect=light()),
        ),
    )


def same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(map(same, a, b))
    if dataclasses.is_dataclass(a):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    return a == b


def test_a_cache_comes_back_as_it_was(tmp_path: Path) -> None:
    one = cache()
    surface_cache.write(tmp_path / "light.npz", one)
    again = surface_cache.read(tmp_path / "light.npz")
    assert same(one, again)
    assert not same(one, cache())
    assert [x.name for x in tmp_path.iterdir()] == ["light.npz"]


def test_lights_are_scaled_and_joined() -> None:
    one = cache()
    lamp, sky = one.lights
    doubled = sky.scaled(np.array([2.0, 1.0, 0.5]))
    assert doubled.met is not None and sky.met is not None
    np.testing.assert_allclose(doubled.met, sky.met * np.array([2, 1, 0.5], np.float32))
    np.testing.assert_allclose(doubled.indirect, sky.indirect * np.array([2, 1, 0.5], np.float32))
    alone = dataclasses.replace(one, lights=(lamp,))
    assert [x.name for x in alone.joined(dataclasses.replace(one, lights=(sky,))).lights] == ["lamp é", "sky"]
    with pytest.raises(ValueError, match="two lights"):
        one.joined(alone)
    with pytest.raises(ValueError, match="different cells"):
        alone.joined(dataclasses.replace(cache(), lights=(sky,)))


def test_damaged_and_foreign_files_are_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "light.npz"
    surface_cache.write(path, cache())
    sound = path.read_bytes()
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    for name, other in (
        ("version", np.array(9)),
        ("starts", np.array([0, 5], np.uint32)),
        ("keys", np.zeros((2, 2), np.uint32)),
        ("kinds", np.array(["lights", "moon"])),
        ("direct_0", np.zeros((2, 2, 3), np.float32)),
        ("size", np.array(-1.0)),
    ):
        np.savez(path, **{**arrays, name: other})
        with pytest.raises(InputError, match="surface cache"):
            surface_cache.read(path)
    del arrays["anchors"]
    np.savez(path, **arrays)
    with pytest.raises(InputError, match="surface cache"):
        surface_cache.read(path)
    for damaged in (sound[:100], sound[: len(sound) // 2], b"", b"PK" * 40, sound[:200] + bytes(50) + sound[250:]):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"surface cache"):
            surface_cache.read(path)
    with pytest.raises(InputError, match="cannot be read"):
        surface_cache.read(tmp_path / "none.npz")
