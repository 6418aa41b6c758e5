"""Frames: a composite times a factor, the composite alone, or the lit proxy alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from mirelight.base import colour
from mirelight.model import F32, Camera, Frame, LightingBuffer, Provenance, RelightSettings, SplatLayer, rules_of
from mirelight.relighting.factor_extension import Continuation
from mirelight.relighting.far import Far
from mirelight.relighting.lobes import glossed, matt_share
from mirelight.relighting.mode import Lit, Task
from mirelight.relighting.modes import gloss_of, mode_of, space_of
from mirelight.relighting.noise import noise as noise_of
from mirelight.relighting.pixels import multiply
from mirelight.relighting.resample import bilinear, upsample

Relighter: TypeAlias = Callable[[F32, F32 | None, F32 | None, F32 | None], F32]


def apply(
    splats: SplatLayer | None,
    lighting: LightingBuffer | None,
    settings: RelightSettings,
    *,
    captured: LightingBuffer | None = None,
    captured_level: float | None = None,
    far: Far | None = None,
    made_by: Provenance | None = None,
    noise: bool = True,
) -> Frame:
    """Makes a relit frame from splats and light.

    Args:
        splats: the composite to relight; None gives the lit proxy itself (radiance, premultiplied, alpha = coverage;
            `brightness` is a setting of the tint and is not applied).
        lighting: the new light, seen by the same camera, on the frame's pixels, fewer, or four of each; None gives the
            unlit frame.
        settings: mode, space, blend and the modes' own numbers.
        captured: the light that the capture was made under, from the same camera, resolution and seed, for modes that
            need it.
        captured_level: a constant of the scene from :func:`mirelight.lighting.captured_level`: with it, a point of the
            surface has the same factor in every view. None: the mean of this view's captured light.
        far: what both lights have far away, where the settings' background is the environment; None: no change there.
        made_by: carried into the frame.
        noise: whether the frame's noise is estimated; that takes longer than the frame.

    Returns:
        The frame; with `blend` 0 its `rgba` is its `unlit` bit for bit. `lighting` in it has the frame's resolution.

    Raises:
        ValueError: neither splats nor lighting; no `captured` for a mode that needs it; buffers of different cameras.
    """
    if splats is None:
        if lighting is None:
            raise ValueError("a frame needs splats, lighting, or both")
        return _lit_proxy(lighting, settings, made_by, noise)
    unlit = unlit_rgba(splats)
    factor, relit, deviation = np.ones_like(splats.color), unlit, None
    if lighting is not None:
        mode = mode_of(settings)
        if mode.needs_captured and captured is None:
            raise ValueError(f"mode {mode.name!r} needs the lighting that the capture was made under")
        old = captured if mode.needs_captured else None
        _same_view(splats.camera, lighting)
        if old is not None:
            _same_view(splats.camera, old)

        def factor_of(new: Lit, captured: Lit | None) -> F32:
            if far is not None and captured is not None:
                new, captured = replace(new, far=far.new), replace(captured, far=far.captured)
            return blended(mode.factor(_task(splats, unlit, new, captured, captured_level, settings)), settings.blend)

        if settings.blend > 0:
            factor = factor_of(Lit.of(lighting), None if old is None else Lit.of(old))
            relit = multiplied(splats, unlit, factor, settings)
        if noise:
            deviation = noise_of(lambda *lit: multiplied(splats, unlit, factor_of(*lit), settings), lighting, old)
        lighting = upsample(lighting, splats.camera)
    return Frame(
        camera=splats.camera,
        rgba=relit,
        unlit=unlit,
        factor=factor,
        lighting=lighting,
        splats=splats,
        made_by=made_by,
        noise=deviation,
        profile=splats.profile,
    )


def relighter(
    splats: SplatLayer | None,
    surface: Lit,
    settings: RelightSettings,
    *,
    captured: Lit | None = None,
    captured_level: float | None = None,
    front: SplatLayer | None = None,
    lobes: tuple[Lit, Lit | None] | None = None,
) -> Relighter:
    """What many lightings of one view share, made ready once: a function from the light's beauty (h, w, 3), linear and
    premultiplied by coverage, to the frame's `rgba` (H, W, 4), the very one that :func:`apply` gives. It takes a
    picture of inserted objects (h, w, 4), too, or None, what lobes reflect (h, w, 3), or None, and the light's far map,
    or None.

    Args:
        splats: the composite; None: the lit proxy itself.
        surface: coverage and albedo of the lit proxy; its beauty is not read.
        settings: as for :func:`apply`.
        captured: as for :func:`apply`, with its far map where the settings' background is the environment.
        captured_level: as for :func:`apply`.
        front: the splats in front of inserted objects; None where there are no objects, or no splats.
        lobes: of the proxy's materials, whose beauty is not read, and the same with that of the captured light.
    """

    def finished(rgba: F32, factor: F32 | None, objects: F32 | None, mirrored: F32 | None) -> F32:
        if lobes is not None and mirrored is not None:
            shown = None if splats is None else unlit_rgba(splats)
            rest = matt_share(*lobes, rgba[..., 3:], shown, settings, captured)
            rgba = glossed(rgba, rest, replace(lobes[0], beauty=mirrored), settings)
        if objects is None:
            return rgba
        return covered(rgba, factor, front, bilinear(objects, (rgba.shape[0], rgba.shape[1])), settings)

    if splats is None:
        return lambda beauty, objects, mirrored, far: finished(
            np.concatenate([beauty, surface.coverage[..., None]], axis=-1), None, objects, mirrored
        )
    composite, unlit, mode = splats, unlit_rgba(splats), mode_of(settings)
    size = composite.camera.height, composite.camera.width
    old = captured if mode.needs_captured else None
    if settings.blend == 0:
        return lambda beauty, objects, mirrored, far: finished(unlit, np.ones((*size, 3), np.float32), objects, None)
    made = mode.prepared(_task(composite, unlit, surface, old, captured_level, settings))

    def relit(beauty: F32, objects: F32 | None, mirrored: F32 | None, far: F32 | None) -> F32:
        factor = blended(made(beauty, far), settings.blend)
        return finished(multiplied(composite, unlit, factor, settings), factor, objects, mirrored)

    return relit


def _task(
    splats: SplatLayer, unlit: F32, new: Lit, captured: Lit | None, level: float | None, settings: RelightSettings
) -> Task:
    """A composite's, `unlit` (H, W, 4) it as captured, and the captured light's `level`, as modes take it."""
    return Task(
        size=(splats.camera.height, splats.camera.width),
        unlit=unlit,
        new=new,
        captured=captured,
        captured_level=level,
        settings=settings,
        camera=splats.camera,
        beyond=splats.beyond,
    )


def covered(relit: F32, factor: F32 | None, front: SplatLayer | None, objects: F32, settings: RelightSettings) -> F32:
    """(H, W, 4) inserted objects in a relit picture, F' + (1 - a) (C' - F') + T a O, all linear and premultiplied.

    Args:
        relit: (H, W, 4) C', the relit composite; without splats the lit proxy beside the objects.
        factor: (H, W, 3) that it was multiplied by; None without splats.
        front: the splats in front of the objects, F' once they are relit, which let T through; None: no splats.
        objects: (H, W, 4) a O, what they send out, and their coverage a.
        settings: the frame's own.
    """
    if front is None or factor is None:  # the light of the proxy beside them is premultiplied by what is seen of it
        return np.asarray(relit + objects, np.float32)
    before = multiplied(front, unlit_rgba(front), _beside(factor, front, objects[..., 3], settings), settings)
    return np.asarray(
        before + (1 - objects[..., 3:]) * (relit - before) + front.transmittance[..., None] * objects, np.float32
    )


def _beside(factor: F32, front: SplatLayer, share: F32, settings: RelightSettings) -> F32:
    """(H, W, 3) the factor of what is in front of objects: that of what is seen beside these, continued over them.

    The factor of their own pixels is that of the surface behind them, which lies in their shadow; the profile of the
    real-time engine has that, as the engine does.

    Args:
        factor: (H, W, 3) of the picture without them.
        front: the splats in front of them.
        share: (H, W) their coverage.
        settings: the frame's own.
    """
    clear = share <= 0
    veiled = rules_of(settings.profile).path_traced and (front.transmittance[~clear] < 1).any()
    if not veiled:
        return factor
    return Continuation(clear)(factor.copy(), factor)


def unlit_rgba(splats: SplatLayer) -> F32:
    """(H, W, 4) the splats as captured: linear light, premultiplied by alpha = 1 - transmittance.

    Display-encoded composites are decoded un-premultiplied, per pixel, by their profile's curve: encoding the result
    the same way gives back the picture that was blended in display space.
    """
    out = np.empty((*splats.transmittance.shape, 4), dtype=np.float32)
    np.subtract(np.float32(1), splats.transmittance, out=out[..., 3])
    if splats.linear:
        out[..., :3] = splats.color
    else:
        decode_premultiplied(splats.color, splats, out)
    return out


def lighting_camera(camera: Camera, settings: RelightSettings) -> Camera:
    """The camera that the lighting of `camera` is traced with: the same view on `texture_scale` times the pixels,
    along each axis.

    Sizes are rounded up; where the profile has unit texels down, as GsplatRelighting sizes its texture.
    """
    round_size = math.floor if rules_of(settings.profile).unit_texels else math.ceil
    width, height = (max(1, round_size(n * settings.texture_scale)) for n in (camera.width, camera.height))
    return camera if (width, height) == (camera.width, camera.height) else camera.resized(width, height)


def blended(factor: F32, blend: float) -> F32:
    """The factor, blended with no change: mix(1, factor, blend)."""
    if blend == 1:
        return factor
    share = np.float32(blend)
    return np.asarray((1 - share) + factor * share, dtype=np.float32)


def multiplied(splats: SplatLayer, unlit: F32, factor: F32, settings: RelightSettings) -> F32:
    """(H, W, 4) linear, premultiplied: the composite times the factor; `unlit` is it in linear light.

    Colour that changes with the view takes a factor of its own where the settings say so.
    """
    gloss = gloss_of(settings)
    if gloss != "keep":
        return _split(splats, unlit, factor, np.float32(1 - settings.blend) if gloss == "remove" else None, settings)
    out = np.empty_like(unlit)
    out[..., 3] = unlit[..., 3]
    if space_of(splats, settings) == "display":
        decode_premultiplied(splats.color * factor, splats, out)
    else:
        multiply(unlit[..., :3], factor, out)
    return out


def _split(splats: SplatLayer, unlit: F32, factor: F32, least: np.float32 | None, settings: RelightSettings) -> F32:
    """D f + (C - D) g: C the composite, D the same without what changes with the view, f the factor and g that of the
    rest: `least`, or else min(f, 1), so that gloss of the capture darkens with its surface and is never brightened.

    It is summed up as C g + D (f - g), which has no negative term unless gloss is taken away.
    """
    if splats.diffuse is None:
        raise ValueError("the composite has no `diffuse`, which settings.sh asks for: composite with diffuse=True")
    of_gloss = np.minimum(factor, np.float32(1)) if least is None else least
    out = np.empty_like(unlit)
    out[..., 3] = unlit[..., 3]
    if space_of(splats, settings) == "display":
        color = splats.color * of_gloss + splats.diffuse * (factor - of_gloss)
        decode_premultiplied(np.maximum(color, np.float32(0)), splats, out)
        return out
    if splats.linear:
        out[..., :3] = splats.diffuse
    else:
        decode_premultiplied(splats.diffuse, splats, out)
    out[..., :3] *= factor - of_gloss
    out[..., :3] += unlit[..., :3] * of_gloss
    np.maximum(out[..., :3], np.float32(0), out=out[..., :3])
    return out


def decode_premultiplied(color: F32, splats: SplatLayer, out: F32) -> None:
    """Decoded colour (H, W, 3), premultiplied like the given one, into `out` (H, W, 4), which holds the alpha."""
    alpha = out[..., 3]
    decoded = colour.decode(colour.straight(color, alpha), rules_of(splats.profile).transfer)
    multiply(decoded, alpha[..., None], out)


def _lit_proxy(lighting: LightingBuffer, settings: RelightSettings, made_by: Provenance | None, noise: bool) -> Frame:
    variance = lighting.variance if noise else None
    return Frame(
        camera=lighting.camera,
        rgba=lighting.rgba,
        unlit=None,
        factor=None,
        lighting=lighting,
        splats=None,
        made_by=made_by,
        noise=None if variance is None else np.sqrt(np.maximum(variance, np.float32(0))),
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
