"""Light meets splats: one factor per pixel and channel, by which the finished composite is multiplied.

The factor is the same for every splat under a pixel, and blending is linear, so multiplying the composite is the same
as multiplying each splat before blending: one composite serves every lighting of its camera. Two modes differ only in
the factor: `tint` (what GsplatRelighting does) and `ratio` (new light over captured light). See docs/relighting.md.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mirelight import colour
from mirelight.model import (
    F32,
    Camera,
    Frame,
    LightingBuffer,
    LightLayer,
    Profile,
    Provenance,
    RelightSettings,
    SplatLayer,
)
from mirelight.model.planes import Owner, Plane, planes_of

_FULL_COVERAGE = np.float32(0.5)  # playcanvas: the share of a texel from which its one sample counts as a hit
_FILL_REACH = 0.01  # ratio: share of the picture's longer side up to which the factor is carried past the proxy
_NO_LIGHT = 1e-20  # keeps 0 / 0 at a ratio of 1 where the whole captured view is black


def apply(
    splats: SplatLayer | None,
    lighting: LightingBuffer | None,
    settings: RelightSettings,
    *,
    captured: LightingBuffer | None = None,
    made_by: Provenance | None = None,
) -> Frame:
    """One relit frame.

    Args:
        splats: the composite to relight; None gives the lit proxy itself (radiance, premultiplied, alpha = coverage;
            `brightness` is a setting of the tint and is not applied).
        lighting: the new light, seen by the same camera, at the frame's or a smaller resolution; None gives the unlit
            frame.
        settings: mode, space, blend and the modes' own numbers.
        captured: the light that the capture was made under, from the same camera, resolution and seed (mode `ratio`).
        made_by: carried into the frame.

    Returns:
        The frame; with `blend` 0 its `rgba` is its `unlit` bit for bit. `lighting` in it has the frame's resolution.

    Raises:
        ValueError: neither splats nor lighting; `ratio` without `captured`; buffers of different cameras.
    """
    if splats is None:
        if lighting is None:
            raise ValueError("a frame needs splats, lighting, or both")
        return _lit_proxy(lighting, settings, made_by)
    unlit = unlit_rgba(splats)
    factor, relit, noise = np.ones_like(splats.color), unlit, None
    if lighting is not None:
        factor = _factor(splats.camera, lighting, settings, captured)
        if settings.blend > 0:
            relit = _multiply(splats, unlit, factor, settings)
        noise = _noise(splats, unlit, lighting, settings, captured)
        lighting = upsample(lighting, splats.camera)
    return Frame(
        camera=splats.camera,
        rgba=relit,
        unlit=unlit,
        factor=factor,
        lighting=lighting,
        splats=splats,
        made_by=made_by,
        noise=noise,
    )


def unlit_rgba(splats: SplatLayer) -> F32:
    """(H, W, 4) the splats as captured: linear light, premultiplied by alpha = 1 - transmittance.

    Display-encoded composites are decoded un-premultiplied, per pixel, by their profile's curve: encoding the result
    the same way gives back the picture that was blended in display space.
    """
    alpha = np.float32(1) - splats.transmittance
    rgb = splats.color if splats.linear else _decode_premultiplied(splats.color, alpha, splats.profile)
    return np.concatenate([rgb, alpha[..., None]], axis=-1)


def lighting_camera(camera: Camera, settings: RelightSettings) -> Camera:
    """The camera that the lighting of `camera` is traced with: the same view on `texture_scale` times the pixels.

    Sizes are rounded up; in the playcanvas profile down, as GsplatRelighting sizes its texture.
    """
    round_size = math.floor if settings.profile == "playcanvas" else math.ceil
    width, height = (max(1, round_size(n * settings.texture_scale)) for n in (camera.width, camera.height))
    return camera if (width, height) == (camera.width, camera.height) else camera.resized(width, height)


def upsample(lighting: LightingBuffer, camera: Camera) -> LightingBuffer:
    """The buffer on the pixel grid of `camera`: bilinear between pixel centres, edges repeated.

    Colours stay premultiplied. AOVs are averages weighted by coverage, normals are made unit again. The variance of a
    weighted sum of independent pixels has squared weights; neighbours become correlated, which it does not say.
    """
    size = camera.height, camera.width
    if lighting.coverage.shape == size:
        return lighting
    coverage = _bilinear(lighting.coverage, size)

    def resampled(values: F32 | None, plane: Plane) -> F32 | None:
        if values is None:
            return None
        if plane.upsampling == "variance":
            return _bilinear(values, size, squared_weights=True)
        if plane.upsampling == "bilinear":
            return _bilinear(values, size)
        flat = values.reshape(*values.shape[:2], -1)
        summed = _bilinear(flat * lighting.coverage[..., None], size)
        average = _divide(summed, coverage[..., None]).reshape((*size, *values.shape[2:]))
        return _unit_or_zero(average) if plane.upsampling == "unit" else average

    def by_table(of: LightingBuffer | LightLayer, owner: Owner) -> dict[str, Any]:
        return {x.field: resampled(getattr(of, x.field), x) for x in planes_of(owner) if x.upsampling != "none"}

    return replace(
        lighting,
        camera=camera,
        coverage=coverage,
        layers=tuple(replace(x, **by_table(x, "layer")) for x in lighting.layers),
        noisy=tuple(replace(x, **by_table(x, "layer")) for x in lighting.noisy),
        **by_table(lighting, "lighting"),
    )


# --- the two factors -------------------------------------------------------------------------------------------------


def _factor(
    camera: Camera, lighting: LightingBuffer, settings: RelightSettings, captured: LightingBuffer | None
) -> F32:
    """(H, W, 3) what each pixel is multiplied by: mix(1, the mode's factor, blend)."""
    _same_view(camera, lighting)
    if settings.mode == "tint":
        tint = _engine_tint if settings.profile == "playcanvas" else _tint
        full = tint(lighting, settings, (camera.height, camera.width))
    else:
        if captured is None:
            raise ValueError("mode 'ratio' needs the lighting that the capture was made under")
        _same_view(camera, captured)
        full = _ratio(upsample(lighting, camera), upsample(captured, camera), settings)
    return _mix(np.float32(1), full, settings.blend)


def _tint(lighting: LightingBuffer, settings: RelightSettings, size: tuple[int, int]) -> F32:
    """mix(background, lit brightness, coverage), where lit is already multiplied by coverage."""
    coverage = _bilinear(lighting.coverage, size)[..., None]
    lit = _bilinear(lighting.beauty, size)
    return np.float32(settings.background) * (1 - coverage) + lit * np.float32(settings.brightness)


def _engine_tint(lighting: LightingBuffer, settings: RelightSettings, size: tuple[int, int]) -> F32:
    """The tint as GsplatRelighting's shader computes it from its texture.

    The texture has one sample a texel: colour and coverage 1, or zeros. Between texels both are interpolated and then
    multiplied again by `mix`, so scaled textures darken towards silhouettes; that is the engine's look, kept here.
    """
    hit = (lighting.coverage >= _FULL_COVERAGE)[..., None]
    texel = np.where(hit, _divide(lighting.beauty, lighting.coverage[..., None]), np.float32(0))
    coverage = _bilinear(hit.astype(np.float32), size)
    lit = _bilinear(texel, size)
    background = np.float32(settings.background)
    return background * (1 - coverage) + lit * np.float32(settings.brightness) * coverage


def _ratio(new: LightingBuffer, captured: LightingBuffer, settings: RelightSettings) -> F32:
    """min((E_new + d m) / (E_captured + d m), max) wherever the proxy covers anything, filled outwards from there.

    E is the lit proxy's radiance (premultiplied over coverage) over its albedo, so light alone, and m the mean
    luminance of E_captured over the proxy. It is the ratio of two averages over a pixel, and it is applied in full at
    partly covered pixels: the splats there are the same surface. (Against path-traced truth, averaging sub-pixel ratios
    costs 0.4 dB, fading by coverage 0.1 to 0.4 dB.)
    """
    covered = captured.coverage.sum(dtype=np.float64)
    light_new, light_captured = (_divide(_divide(x.beauty, x.coverage[..., None]), x.albedo) for x in (new, captured))
    summed = (colour.luminance(light_captured) * captured.coverage).sum(dtype=np.float64)
    floor = np.float32(max(settings.delta * summed / covered, _NO_LIGHT)) if covered > 0 else np.float32(_NO_LIGHT)
    ratio = np.minimum((light_new + floor) / (light_captured + floor), np.float32(settings.max_ratio))
    seen = np.minimum(new.coverage, captured.coverage) > 0
    return _filled_outwards(ratio, seen, settings.background)


def _filled_outwards(ratio: F32, seen: NDArray[np.bool_], background: float) -> F32:
    """The ratio, continued into gaps of the proxy and past its silhouettes; far from it, `background`.

    Splats reach past the proxy, and there an unchanged colour would stand out as an outline in the captured light.
    """
    if seen.all():
        return ratio
    weight = seen[..., None].astype(np.float32)
    reach = _FILL_REACH * max(seen.shape)
    filled = _pull_push(np.concatenate([ratio * weight, weight], axis=-1), reach)
    trust = filled[..., 3:]
    return np.asarray(np.where(seen[..., None], ratio, _mix(np.float32(background), filled[..., :3], trust)))


def _pull_push(total: F32, reach: float) -> F32:
    """Gaps filled by averages over ever larger blocks (Gortler et al. 1996, "The lumigraph", section 3.4.1).

    Args:
        total: (h, w, 4) sum of the known values of each block, and how many there are.
        reach: blocks up to which a value is fully trusted; each doubling beyond halves the trust.

    Returns:
        (h, w, 4) values, and trust from 0 to 1.
    """
    known = total[..., 3:] > 0
    values = _divide(total, total[..., 3:])  # the last channel becomes 1 where something is known, else 0
    height, width = known.shape[:2]
    if known.all() or height == width == 1:
        return values
    even = np.pad(total, ((0, height % 2), (0, width % 2), (0, 0)))
    halved = even[0::2, 0::2] + even[1::2, 0::2] + even[0::2, 1::2] + even[1::2, 1::2]
    coarse = _pull_push(halved, reach / 2)
    above = _bilinear(coarse, even.shape[:2])[:height, :width]
    if reach < 1:
        above = above * np.array([1, 1, 1, 0.5], dtype=np.float32)
    return np.asarray(np.where(known, values, above), dtype=np.float32)


# --- multiplying -----------------------------------------------------------------------------------------------------


def _space(splats: SplatLayer, settings: RelightSettings) -> Literal["linear", "display"]:
    """Where the factor multiplies. The engine multiplies in the space that it blends in; a ratio is of linear light."""
    if settings.mode == "ratio" or splats.linear:
        return "linear"
    return "display" if settings.profile == "playcanvas" else settings.space


def _multiply(splats: SplatLayer, unlit: F32, factor: F32, settings: RelightSettings) -> F32:
    """(H, W, 4) linear, premultiplied: the composite times the factor; `unlit` is it in linear light."""
    alpha = unlit[..., 3]
    if _space(splats, settings) == "display":
        rgb = _decode_premultiplied(splats.color * factor, alpha, splats.profile)
    else:
        rgb = unlit[..., :3] * factor
    return np.concatenate([rgb, alpha[..., None]], axis=-1)


def _decode_premultiplied(color: F32, alpha: F32, profile: Profile) -> F32:
    a = alpha[..., None]
    return np.asarray(a * colour.decode(_divide(color, a), profile), dtype=np.float32)


def _mix(a: np.float32, b: F32, share: float | F32) -> F32:
    s = np.asarray(share, dtype=np.float32)
    return np.asarray(a * (1 - s) + b * s, dtype=np.float32)


def _divide(numerator: F32, denominator: F32) -> F32:
    """numerator / denominator, 0 where the denominator is 0."""
    safe = np.where(denominator > 0, denominator, np.float32(1))
    return np.asarray(np.where(denominator > 0, numerator / safe, np.float32(0)), dtype=np.float32)


def _unit_or_zero(vectors: F32) -> F32:
    return _divide(vectors, np.linalg.norm(vectors, axis=-1, keepdims=True))


# --- resampling ------------------------------------------------------------------------------------------------------


def _bilinear(image: F32, size: tuple[int, int], *, squared_weights: bool = False) -> F32:
    """The image (h, w) or (h, w, c) on a grid of `size` (rows, columns), as a GPU's linear filter reads it.

    Pixel centres lie at +0.5 on both grids; beyond the outermost centres the edge repeats. `squared_weights` squares
    the four weights of each sample, which turns variances of independent pixels into those of the interpolated ones.
    """
    if image.shape[:2] == size:
        return image
    rows = _along(image, 0, size[0], squared_weights)
    return _along(rows, 1, size[1], squared_weights)


def _along(image: F32, axis: int, count: int, squared_weights: bool) -> F32:
    n = image.shape[axis]
    at = (np.arange(count, dtype=np.float64) + 0.5) * (n / count) - 0.5
    low = np.floor(at)
    share = (at - low).astype(np.float32).reshape((-1, *(1,) * (image.ndim - axis - 1)))
    first = np.take(image, np.clip(low, 0, n - 1).astype(np.intp), axis=axis)
    second = np.take(image, np.clip(low + 1, 0, n - 1).astype(np.intp), axis=axis)
    if squared_weights:
        # where both samples are one clamped edge pixel, the weights add before they are squared
        clamped = ((low < 0) | (low + 1 > n - 1)).reshape(share.shape)
        return np.asarray(np.where(clamped, first, first * (1 - share) ** 2 + second * share**2), dtype=np.float32)
    return np.asarray(first * (1 - share) + second * share, dtype=np.float32)


# --- noise -----------------------------------------------------------------------------------------------------------


def _noise(
    splats: SplatLayer,
    unlit: F32,
    lighting: LightingBuffer,
    settings: RelightSettings,
    captured: LightingBuffer | None,
) -> F32 | None:
    """(H, W, 3) standard deviation of the relit colour that the lighting's variance leaves; None where it is unknown.

    The frame is relit one standard deviation up and down, in any mode and space. Errors of new and captured light count
    as independent; traced with one seed they partly cancel, so for a ratio this is an upper bound.
    """

    def swing(lit: tuple[LightingBuffer, LightingBuffer], base: tuple[LightingBuffer | None, ...]) -> F32:
        up, down = (
            _multiply(splats, unlit, _factor(splats.camera, new, settings, old), settings)[..., :3]
            for new, old in zip(lit, base, strict=True)
        )
        return np.asarray(np.abs(up - down) / 2, dtype=np.float32)

    total: F32 | None = None
    if lighting.variance is not None:
        total = swing((_moved(lighting, 1), _moved(lighting, -1)), (captured, captured))
    if settings.mode == "ratio" and captured is not None and captured.variance is not None:
        from_captured = swing((lighting, lighting), (_moved(captured, 1), _moved(captured, -1)))
        total = from_captured if total is None else np.asarray(np.hypot(total, from_captured), dtype=np.float32)
    return total


def _moved(lighting: LightingBuffer, deviations: float) -> LightingBuffer:
    """The buffer with its beauty that many standard deviations off, not below zero, in one layer."""
    assert lighting.variance is not None
    sigma = np.sqrt(np.maximum(lighting.variance, 0))
    beauty = np.maximum(lighting.beauty + np.float32(deviations) * sigma, np.float32(0))
    layer = LightLayer(name="all", direct=beauty, indirect=np.zeros_like(beauty))
    return replace(lighting, layers=(layer,))


# --- frames ----------------------------------------------------------------------------------------------------------


def _lit_proxy(lighting: LightingBuffer, settings: RelightSettings, made_by: Provenance | None) -> Frame:
    noise = None if lighting.variance is None else np.sqrt(np.maximum(lighting.variance, 0))
    return Frame(
        camera=lighting.camera,
        rgba=lighting.rgba,
        unlit=None,
        factor=None,
        lighting=lighting,
        splats=None,
        made_by=made_by,
        noise=noise,
        profile=settings.profile,
    )


def _same_view(camera: Camera, lighting: LightingBuffer) -> None:
    """Refuses a buffer of another camera; the pixel grid may differ."""
    other = lighting.camera.resized(camera.width, camera.height)
    matches = (
        np.array_equal(other.world_from_camera, camera.world_from_camera)
        and np.allclose([other.fx, other.fy, other.cx, other.cy], [camera.fx, camera.fy, camera.cx, camera.cy])
        and other.projection == camera.projection
    )
    if not matches:
        raise ValueError(f"the lighting was traced from {lighting.camera.name!r}, the splats seen from {camera.name!r}")
