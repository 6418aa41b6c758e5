"""The tables behind the kernel: densities integrate to one, light lists leave nothing out, denoising adds up."""

from __future__ import annotations

import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mirelight.base import backend
from mirelight.base.errors import BackendError
from mirelight.lighting import environment, grid, lights, materials
from mirelight.lighting.denoise import denoise
from mirelight.model import (
    F32,
    Camera,
    DirectionalLight,
    Environment,
    Light,
    LightingBuffer,
    LightLayer,
    Material,
    PointLight,
    ProxyMesh,
    SpotLight,
)

RNG = np.random.default_rng(4)


def sky(h: int, w: int, peak: float = 500.0) -> Environment:
    radiance = RNG.random((h, w, 3)).astype(np.float32)
    radiance[h // 3, w // 4] = peak
    return Environment(radiance=radiance)


def loaded(made: Environment | None) -> Any:
    backend.mitsuba("llvm_ad_rgb")
    from mirelight.lighting.kernel.sky import Sky

    return Sky(made)


@pytest.mark.parametrize(("h", "w"), [(4, 8), (33, 65), (256, 512), (1100, 2200)])
def test_an_environments_samples_follow_its_light_above_the_mean(h: int, w: int) -> None:
    prepared = loaded(sky(h, w))
    columns, rows = (int(n[0]) for n in prepared.cells)
    density, slots = prepared.density.numpy().reshape(rows, columns), prepared.slots.numpy()
    assert len(slots) == environment.SLOTS
    assert density.mean() == pytest.approx(1.0, rel=1e-5)  # over the unit square
    row, column = slots >> 16, slots & 0xFFFF
    counts = np.zeros((rows, columns))
    np.add.at(counts, (row, column), 1)
    np.testing.assert_allclose(density, counts * rows * columns / environment.SLOTS, rtol=1e-6)
    peak = np.unravel_index(np.argmax(density), density.shape)
    np.testing.assert_allclose(
        (np.array(peak) + 0.5) / [rows, columns], [(h // 3 + 0.5) / h, (w // 4 + 0.5) / w], atol=0.01
    )


@pytest.mark.parametrize(("h", "w"), [(16, 48), (33, 65), (7, 3)])
def test_neighbouring_slots_are_neighbouring_directions(h: int, w: int) -> None:
    """Every cell that has a share has its slots in one run, and most runs' cells touch."""
    brightness = (RNG.random((h, w)) + np.array([[0.0], *[[20.0]] * (h - 1)])).astype(np.float32)
    slots = environment.distribution(brightness).slots
    runs = slots[np.flatnonzero(np.diff(slots.astype(np.int64), prepend=-1))]
    assert len(np.unique(runs)) == len(runs) > 0.3 * h * w
    steps = np.abs(np.diff(np.array([runs >> 16, runs & 0xFFFF], np.int64), axis=1)).max(axis=0)
    assert np.mean(steps) < 2.5


@pytest.mark.parametrize(
    "flat",
    [
        None,
        Environment(radiance=np.ones((1, 1, 3), np.float32)),
        Environment(radiance=np.zeros((8, 16, 3), np.float32)),
    ],
)
def test_an_even_sky_is_left_to_reflection(flat: Environment | None) -> None:
    prepared = loaded(flat)
    assert len(prepared.slots) == 2 and not prepared.sampled[0] and not prepared.density.numpy().any()
    assert len(prepared.texels) >= 16  # a single texel would be compiled in


def test_light_lists_leave_no_light_out() -> None:
    crowd: list[Light] = [
        PointLight(name=f"p{k}", position=RNG.uniform(-6, 6, 3), range=float(RNG.uniform(0.3, 2.5))) for k in range(150)
    ]
    crowd += [SpotLight(name="s", position=np.zeros(3), direction=np.array([1.0, 0, 0]), range=2.0)]
    crowd += [
        DirectionalLight(name="d", direction=np.array([0, -1.0, 0])),
        PointLight(name="far", position=np.ones(3) * 90),
    ]
    low, high = np.array([-5, -1, -5], np.float32), np.array([5, 3, 5], np.float32)
    made = grid.build(tuple(crowd), (low, high), separate=True)
    assert np.prod(made.resolution) > 8 and made.picks == grid.FEWER
    for p in RNG.uniform(low, high, (2000, 3)):
        x, y, z = np.minimum(((p - made.low) * made.cells_per_unit).astype(int), np.array(made.resolution) - 1)
        cell = (x * made.resolution[1] + y) * made.resolution[2] + z
        listed = set(made.lights[made.starts[cell] : made.starts[cell + 1]].tolist())
        for number, light in enumerate(crowd):
            reach = getattr(light, "range", np.inf)
            if np.isinf(reach) or np.linalg.norm(np.asarray(light.position) - p) < reach:  # type: ignore[union-attr]
                assert number in listed
    assert np.diff(made.starts.astype(int)).mean() < 30


def test_few_lights_are_all_sampled_everywhere() -> None:
    few = tuple(PointLight(name=str(k), position=np.zeros(3), range=0.1) for k in range(12))
    bounds = np.zeros(3, np.float32), np.ones(3, np.float32)
    made = grid.build(few, bounds, separate=True)
    assert made.resolution == (1, 1, 1) and made.lights.tolist() == list(range(12))
    assert made.picks == (12, 12, 12)
    assert grid.build(few, bounds, separate=False).picks == grid.FEWER
    none = grid.build((), (bounds[0], bounds[0]), separate=True)
    assert none.starts.tolist() == [0, 0] and np.all(np.isfinite(none.cells_per_unit))


def test_the_light_table_is_finite_and_never_a_single_row() -> None:
    assert lights.pack(()).shape == (2, lights.ROW)
    table = lights.pack((PointLight(name="p", position=np.zeros(3)),))
    assert np.all(np.isfinite(table)) and not table[1, 8:11].any()


def test_glowing_faces_are_drawn_by_their_power() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 0, 0], [0, 3, 0]], np.float32)
    proxy = ProxyMesh(
        vertices=vertices,
        faces=np.array([[0, 1, 2], [0, 3, 4], [0, 1, 2]], np.int32),
        materials=(Material(emissive=np.ones(3)), Material()),
        face_materials=np.array([0, 0, 1], np.int32),
    )
    glow = materials.pack_glow(proxy)
    share = np.bincount(glow.slots, minlength=3) / len(glow.slots)
    np.testing.assert_allclose(share, [0.1, 0.9, 0.0], atol=1e-5)
    areas = np.array([0.5, 4.5, 0.5])
    np.testing.assert_allclose(glow.density[:3] * areas, share, rtol=1e-5)


def test_the_power_of_a_textured_face_is_its_textures_mean() -> None:
    """Two halves of a quad under a texture that is bright on one of them, against the integral by fine look-ups."""
    image = np.zeros((8, 8, 3), np.float32)
    image[:4] = [1.0, 2.0, 0.5]  # the upper half, v < 0.5
    quad_ = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    for repeat, wrap in ((1.0, "repeat"), (3.0, "repeat"), (3.0, "mirror"), (3.0, "clamp")):
        proxy = ProxyMesh(
            vertices=quad_,
            faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
            uvs=quad_[:, :2] * np.float32(repeat),
            materials=(Material(emissive=np.array([2.0, 1.0, 0]), emissive_texture=image, emissive_wrap=(wrap, wrap)),),  # type: ignore[arg-type]
        )
        share = np.bincount(materials.pack_glow(proxy).slots, minlength=2) / materials.GLOW_SLOTS
        x, y = np.meshgrid((np.arange(900) + 0.5) / 900, (np.arange(900) + 0.5) / 900)
        v = y * repeat
        inside = {"repeat": v % 1, "mirror": np.where(v % 2 > 1, 2 - v % 2, v % 2), "clamp": np.clip(v, 0, 1)}[wrap]
        lower, total = np.sum((inside < 0.5) & (y < x)), np.sum(inside < 0.5)
        assert share[0] == pytest.approx(lower / total, abs=0.005)


# --- denoising, with a stand-in for the library ----------------------------------------------------------------------


class _Filter:
    """Averages each channel over the picture: enough to see what was asked of it."""

    asked: list[dict[str, Any]] = []  # noqa: RUF012  (collected by the test)

    def __init__(self, device: object, kind: str) -> None:
        self.images: dict[str, Any] = {}
        self.flags: dict[str, bool] = {}
        assert kind == "RT"

    def __enter__(self) -> _Filter:
        return self

    def __exit__(self, *nothing: object) -> None:
        self.asked.append({**self.flags, "images": set(self.images)})

    def set_image(self, name: str, image: Any, layout: int) -> None:
        assert image.dtype == np.float32 and image.flags.c_contiguous and image.flags.writeable and layout == 3
        self.images[name] = image

    def set_int(self, name: str, value: int) -> None: ...

    def set_bool(self, name: str, value: bool) -> None:
        self.flags[name] = value

    def commit(self) -> None: ...

    def execute(self) -> None:
        source = self.images.get("color", next(iter(self.images.values())))
        self.images["output"][:] = source.mean(axis=(0, 1))


class _Device:
    def __enter__(self) -> _Device:
        return self

    def __exit__(self, *nothing: object) -> None: ...

    def commit(self) -> None: ...

    def get_error(self) -> None: ...


def image() -> F32:
    return RNG.random((4, 6, 3)).astype(np.float32)


def noisy() -> LightingBuffer:
    camera = Camera.look_at([0, 0, 1], [0, 0, 0], 6, 4)
    names = ("a", "b")
    return LightingBuffer(
        camera=camera,
        coverage=np.ones((4, 6), np.float32),
        layers=tuple(LightLayer(name=n, direct=image(), indirect=image()) for n in names),
        depth=np.ones((4, 6), np.float32),
        position=image(),
        normal=image(),
        geometric_normal=image(),
        albedo=image(),
        variance=image(),
        spp=4,
    )


def test_denoised_layers_add_up_to_the_denoised_beauty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyoidn", SimpleNamespace(Device=_Device, Filter=_Filter, OIDN_FORMAT_FLOAT3=3))
    _Filter.asked.clear()
    before = noisy()
    after = denoise(before)
    np.testing.assert_allclose(after.beauty, np.broadcast_to(before.beauty.mean(axis=(0, 1)), (4, 6, 3)), rtol=1e-5)
    assert after.noisy == before.layers
    assert after.variance is None and before.variance is not None
    assert [x.name for x in after.layers] == ["a", "b"]
    colors = [x for x in _Filter.asked if "color" in x["images"]]
    assert len(colors) == 5  # the beauty, and two layers' direct and indirect light
    assert all(x["images"] == {"color", "albedo", "normal", "output"} and x["hdr"] and x["cleanAux"] for x in colors)


def test_without_layers_the_sum_alone_is_denoised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyoidn", SimpleNamespace(Device=_Device, Filter=_Filter, OIDN_FORMAT_FLOAT3=3))
    _Filter.asked.clear()
    before = noisy()
    dark = before.layers[0].direct.copy()
    dark[0, 0] = 0
    black = LightLayer(name="beauty", direct=dark, indirect=dark)
    after = denoise(replace(before, layers=(black,)), layers=False)
    np.testing.assert_allclose(after.beauty, np.broadcast_to((2 * dark).mean(axis=(0, 1)), (4, 6, 3)), rtol=1e-5)
    assert sum("color" in x["images"] for x in _Filter.asked) == 1


def test_the_error_of_a_denoised_picture_counts_its_bias(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stand-in for the denoiser gives the picture's mean, so its error is the truth's own variation."""
    monkeypatch.setitem(sys.modules, "pyoidn", SimpleNamespace(Device=_Device, Filter=_Filter, OIDN_FORMAT_FLOAT3=3))
    h, w = 96, 128
    truth = np.ones((h, w, 3), np.float32)
    truth[:, ::2] = 1.5
    camera = Camera.look_at([0, 0, 1], [0, 0, 0], w, h)
    one, rng = np.ones((h, w), np.float32), np.random.default_rng(4)

    def seen(sigma: float) -> F32:
        return (truth + sigma * rng.standard_normal((h, w, 3))).astype(np.float32)

    half, quarter, other = seen(0.57), seen(0.8), seen(0.8)
    beauty = ((2 * half + quarter + other) / 4).astype(np.float32)
    layer = LightLayer(name="a", direct=beauty, indirect=0 * beauty, half=half, quarter=quarter, other_quarter=other)
    buffer = LightingBuffer(
        camera=camera,
        coverage=one,
        layers=(layer,),
        depth=one,
        position=beauty,
        normal=beauty,
        geometric_normal=beauty,
        albedo=beauty,
        variance=np.full((h, w, 3), 0.4**2, np.float32),
    )
    after = denoise(buffer)
    assert after.variance is not None
    assert after.variance.mean() == pytest.approx(0.25**2, rel=0.1)
    assert np.mean((after.beauty - truth) ** 2) == pytest.approx(0.25**2, rel=0.02)


def test_denoising_without_the_library_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    with pytest.raises(BackendError, match=r"pip install 'mirelight\[denoise\]', or set render.denoise = false"):
        denoise(noisy())


def test_a_range_of_next_to_nothing_stays_in_single_precision() -> None:
    for reach in (1e-300, 5e-324):
        table = lights.pack((PointLight(name="p", position=np.zeros(3), range=reach),))
        assert np.all(np.isfinite(table))
