"""What must not depend on the machine: threads, runs, memory, compilations, ways to sort, back ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import mirelight.compositor.compositor as front_door
from mirelight.base import backend
from mirelight.base.errors import RenderError
from mirelight.compositor import Compositor, composite, order, queue
from mirelight.compositor.bin import Band, TileLists
from mirelight.compositor.blend import Source, blend
from mirelight.compositor.device import Array, Device, open_device
from mirelight.compositor.memory import check_indices, cloud_bytes, frame_bytes
from mirelight.compositor.resolve import Blended
from mirelight.model import Camera, CompositorSettings, SplatCloud

from .compositor_clouds import COMPACT, PHYSICAL, VIEW, assert_agrees, cloud, same_bits

LARGER = Camera.look_at((2.8, 0.6, 2.9), (-1, -0.3, -0.6), 320, 200, yfov=60)


@pytest.fixture
def threads() -> Iterator[None]:
    """Puts the number of worker threads back."""
    dr, _ = backend.drjit()
    before = dr.thread_count()
    yield
    dr.set_thread_count(before)


@pytest.mark.usefixtures("threads")
def test_same_bits_for_any_number_of_threads_and_on_every_run() -> None:
    splats = cloud(20000, size=0.05)
    first = Compositor(splats, threads=1).composite(LARGER)
    for count in (2, 3, 1, 2, 2):
        assert same_bits(Compositor(splats, threads=count).composite(LARGER), first)


@pytest.mark.parametrize("settings", [PHYSICAL, replace(COMPACT, eight_bit=True)])
def test_bands_change_nothing(monkeypatch: pytest.MonkeyPatch, settings: CompositorSettings) -> None:
    compositor = Compositor(cloud(3000), settings)
    whole = compositor.composite(LARGER)
    seen: list[Band] = []

    def counted(source: Source, data: list[Array], lists: TileLists, band: Band, frame: Blended) -> None:
        seen.append(band)
        blend(source, data, lists, band, frame)

    monkeypatch.setattr("mirelight.compositor.compositor.blend", counted)
    monkeypatch.setattr(front_door, "MOST_TILES", 500)
    assert same_bits(compositor.composite(LARGER), whole)
    assert len(seen) > 3 and sum(band.rows for band in seen) == -(-200 // 8)


def test_too_little_memory_renders_in_bands_or_is_refused_with_the_size() -> None:
    splats = cloud(3000)
    fixed = frame_bytes(len(splats), LARGER, 0)
    whole = composite(splats, LARGER)
    tight = replace(PHYSICAL, max_memory=fixed + 1_500_000)
    assert same_bits(Compositor(splats, tight).composite(LARGER), whole)
    with pytest.raises(RenderError, match=r"frame of 320 x 200 pixels of 3000 splats needs \d+\.\d+ GiB"):
        Compositor(splats, replace(PHYSICAL, max_memory=fixed + 10)).composite(LARGER)
    with pytest.raises(RenderError, match="a cloud of 3000 splats needs"):
        Compositor(splats, replace(PHYSICAL, max_memory=cloud_bytes(splats) - 1))
    with pytest.raises(RenderError, match="4000000 x 4000000 pixels is too large"):
        Compositor(splats).composite(replace(LARGER, width=4_000_000, height=4_000_000))


def test_a_cloud_beyond_32_bit_indices_is_refused() -> None:
    class Huge:
        sh = np.broadcast_to(np.float32(0.5), (90_000_000, 16, 3))

        def __len__(self) -> int:
            return len(self.sh)

    with pytest.raises(RenderError, match="90000000 splats is too large"):
        check_indices(Huge())  # type: ignore[arg-type]


def test_memory_needed_is_not_underestimated() -> None:
    splats = cloud(1000, degree=2)
    arrays = (splats.means, splats.quats, splats.scales, splats.opacities, splats.sh)
    assert cloud_bytes(splats) >= sum(a.nbytes for a in arrays if a is not splats.quats)
    layer = composite(splats, VIEW)
    assert frame_bytes(0, VIEW, 0) >= sum(
        a.nbytes for a in (layer.color, layer.transmittance, layer.depth, layer.median_depth)
    )


def compiled(run: object) -> int:
    """How many kernels a call compiles."""
    dr, _ = backend.drjit()
    dr.set_flag(dr.JitFlag.KernelHistory, True)
    try:
        dr.kernel_history_clear()
        run()  # type: ignore[operator]
        return sum(1 for k in dr.kernel_history() if "hash" in k and not k["cache_hit"])
    finally:
        dr.set_flag(dr.JitFlag.KernelHistory, False)


@pytest.mark.parametrize("settings", [PHYSICAL, COMPACT], ids=["physical", "playcanvas"])
def test_nothing_is_compiled_for_another_camera_or_count_and_at_most_one_kernel_for_another_size(
    settings: CompositorSettings,
) -> None:
    splats = cloud(5000, degree=2)
    Compositor(splats, settings).composite(LARGER)
    other = replace(Camera.look_at((-2, 1, 1), (0, 0, 0), 301, 190, yfov=95), cx=100.0, near=0.2, far=30.0)
    assert compiled(lambda: Compositor(splats, settings).composite(LARGER)) == 0
    assert compiled(lambda: Compositor(splats, settings).composite(other)) == 0
    assert compiled(lambda: Compositor(cloud(4321, degree=2), settings).composite(other)) == 0
    tiny = replace(other, width=57, height=33)  # tiles in another power of two
    compiled_for_size = compiled(lambda: Compositor(splats, settings).composite(tiny))
    assert compiled_for_size <= 1
    assert compiled(lambda: Compositor(splats, settings).composite(replace(tiny, width=49))) == 0


def test_the_blend_is_traced_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Later frames of other sizes, counts and cameras replay it, and give what a fresh trace gives."""
    splats = cloud(3000)
    Compositor(splats).composite(LARGER)
    views = [LARGER, replace(LARGER, width=301, cx=100.0), Camera.look_at((-2, 1, 1), (0, 0, 0), 310, 195, yfov=95)]

    def never(*_: object) -> None:
        raise AssertionError("traced again")

    with monkeypatch.context() as patch:
        patch.setattr(Source, "exponents", never)
        replayed = [
            Compositor(cloud(count), PHYSICAL).composite(view)
            for count, view in zip((3000, 777, 5000), views, strict=True)
        ]
    queue._loop.cache_clear()
    for layer, count, view in zip(replayed, (3000, 777, 5000), views, strict=True):
        assert same_bits(layer, composite(cloud(count), view))


def public_permutation(device: Device, values: Array, bits: int, most: int = 32) -> Array:
    """What `order.counting_permutation` returns, by documented means."""
    del bits, most
    return device.dr.argsort(values)


@pytest.mark.parametrize("digit", [8, 32])  # CUDA's and LLVM's
@pytest.mark.parametrize("bits", [1, 5, 14, 18])
def test_the_internal_permutation_is_the_public_one(bits: int, digit: int) -> None:
    device = replace(open_device("llvm_ad_rgb", None), digit=digit)
    values = device.types.UInt32(np.random.default_rng(bits).integers(0, 1 << bits, 50_000, dtype=np.uint32))
    fast = order.counting_permutation(device, values, bits).numpy()
    np.testing.assert_array_equal(fast, public_permutation(device, values, bits).numpy())
    np.testing.assert_array_equal(fast, np.argsort(values.numpy(), kind="stable"))


def test_the_picture_is_the_same_through_the_public_permutation(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = composite(cloud(3000), LARGER)
    monkeypatch.setattr(order, "counting_permutation", public_permutation)
    monkeypatch.setattr("mirelight.compositor.bin.counting_permutation", public_permutation)
    assert same_bits(composite(cloud(3000), LARGER), expected)


@pytest.mark.parametrize("digit", [8, 32])
@pytest.mark.parametrize("far", [1.0, 1e3, 1e7])
def test_depth_order_of_any_range(far: float, digit: int) -> None:
    device = replace(open_device("llvm_ad_rgb", None), digit=digit)
    r = np.random.default_rng(3)
    depth = (1e-3 + far * r.random(40_000) ** 8).astype(np.float32)
    depth[::3] = depth[0]
    visible = r.random(40_000) < 0.7
    got = order.depth_order(device, device.types.UInt32(depth.view(np.uint32)), device.types.Bool(visible)).numpy()
    kept = np.flatnonzero(visible)
    np.testing.assert_array_equal(got, kept[np.argsort(depth[kept], kind="stable")])


def test_every_tile_is_visited_once() -> None:
    for columns, rows in ((1, 1), (7, 3), (64, 33)):
        assert sorted(queue.tile_order(columns, rows)) == list(range(columns * rows))


@pytest.mark.parametrize("tile", [(4, 4), (8, 4), (2, 8)])
def test_other_tile_shapes_give_the_same_picture(monkeypatch: pytest.MonkeyPatch, tile: tuple[int, int]) -> None:
    splats = cloud(1000, degree=0)
    expected = composite(splats, VIEW)
    shaped = replace(open_device("llvm_ad_rgb", None), tile_width=tile[0], tile_height=tile[1])
    monkeypatch.setattr(front_door, "open_device", lambda *_: shaped)
    assert_agrees(splats, VIEW)
    np.testing.assert_allclose(composite(splats, VIEW).color, expected.color, atol=2e-6)


@pytest.mark.usefixtures("threads")
def test_same_bits_where_transmittance_is_a_denormal_number() -> None:
    """Piles of small, nearly opaque splats: under each some 40 factors of 1/255, which no float holds."""
    piles, high = 256, 40
    rng = np.random.default_rng(3)
    across = (np.stack(np.meshgrid(np.arange(16), np.arange(16)), axis=-1).reshape(-1, 1, 2) - 7.5) * 0.2
    behind = -0.001 * np.arange(high)[None, :, None] * np.linspace(1, 2, piles)[:, None, None]
    means = np.concatenate([np.broadcast_to(across, (piles, high, 2)), behind], axis=-1).reshape(-1, 3)
    count = len(means)
    splats = SplatCloud(
        means=means.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.full((count, 3), 0.01, np.float32),
        opacities=np.full(count, 0.998, np.float32),
        sh=rng.normal(0, 0.5, (count, 1, 3)).astype(np.float32),
    )
    camera = Camera.look_at((0, 0, 4), (0, 0, 0), 256, 256, yfov=45)
    one, two = (Compositor(splats, COMPACT, threads=n).composite(camera) for n in (1, 2))
    assert (one.transmittance < 1e-20).sum() > 100  # many leave nothing
    assert same_bits(one, two)
