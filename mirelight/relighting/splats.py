"""Splats relit one by one, each at its own place on the proxy, before they are blended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mirelight.base import colour, sh
from mirelight.model import (
    F32,
    Frame,
    LightingBuffer,
    Provenance,
    RelightSettings,
    SplatCloud,
    SplatLayer,
    rules_of,
)
from mirelight.relighting.frame import blended, unlit_rgba
from mirelight.relighting.mode import Lit, Task
from mirelight.relighting.modes import gloss_of, mode_of, space_of
from mirelight.relighting.pixels import divide
from mirelight.relighting.resample import upsample

_MOST = np.float32(65504)  # that a splat's colour may be, as in the compositor


def captured_color(splats: SplatCloud) -> F32:
    """(N, 3) the splats' colours averaged over directions, linear."""
    return np.asarray(splats.light(sh.mean_display(splats.sh)), np.float32)


def splat_relighter(
    color: F32,
    albedo: F32 | None,
    settings: RelightSettings,
    *,
    captured: F32 | None = None,
    captured_level: float | None = None,
) -> Callable[[F32], F32]:
    """The same for splats instead of pixels, each lit at its own place on the proxy: a function from light (N, 3),
    irradiance / pi, to what the splats' linear colours are multiplied by (N, 3), at full strength.

    Args:
        color: (N, 3) of the splats, linear, as captured.
        albedo: (N, 3) of the proxy at their places; None: not known, for modes that divide by it.
        settings: mode and the modes' own numbers.
        captured: (N, 3) the light that they were captured under, irradiance / pi, for modes that need it.
        captured_level: as for :func:`apply`; None: the mean over the splats.
    """
    mode, count = mode_of(settings), len(color)
    whole = np.ones((count, 1), np.float32)
    own = np.ones((count, 1, 3), np.float32)
    if albedo is not None and not mode.uses_proxy_colours:  # else the mode divides by it: one is as good as another
        own = albedo[:, None].astype(np.float32)
    unlit = np.concatenate([color[:, None].astype(np.float32), whole[..., None]], axis=-1)
    old = None if captured is None else Lit(beauty=captured[:, None].astype(np.float32), coverage=whole, albedo=own)
    factor = mode.prepared(
        Task(
            size=(count, 1),
            unlit=unlit,
            new=Lit(beauty=np.zeros_like(own), coverage=whole, albedo=own),
            captured=old if mode.needs_captured else None,
            captured_level=captured_level,
            settings=settings,
        )
    )
    return lambda light: factor(np.asarray(light[:, None] * own, np.float32), None)[:, 0]


def relit_colors(layer: SplatLayer, shown: F32, plain: F32, factor: F32, settings: RelightSettings) -> F32:
    """(N, 3) the colours that splats are blended in once they are relit.

    Args:
        layer: the composite of the splats as captured, for its profile and space.
        shown: (N, 3) their colours as seen by its camera, in the space that they blend in.
        plain: (N, 3) the same without what changes with the view.
        factor: (N, 3) from :func:`splat_relighter`.
        settings: blend, space and what becomes of gloss.
    """
    f = blended(factor, settings.blend)
    transfer = rules_of(layer.profile).transfer
    keeps_space = layer.linear or space_of(layer, settings) == "display"
    seen, own = (x if keeps_space else colour.decode(x, transfer) for x in (shown, plain))
    gloss = gloss_of(settings)
    if gloss == "keep":
        out = seen * f
    else:
        of_gloss = np.minimum(f, np.float32(1)) if gloss == "fade" else np.float32(1 - settings.blend)
        out = seen * of_gloss + own * (f - of_gloss)
    out = np.maximum(out, np.float32(0))
    out = out if keeps_space else colour.encode(out, transfer)
    return np.minimum(np.asarray(out, np.float32), _MOST)


def frame_of_splats(
    splats: SplatLayer,
    color: F32,
    lighting: LightingBuffer,
    made_by: Provenance | None = None,
) -> Frame:
    """A frame of splats that were relit one by one.

    Args:
        splats: their composite as captured.
        color: (H, W, 3) the composite of :func:`relit_colors`, premultiplied.
        lighting: the lit proxy seen by the same camera, which goes along with the frame.
        made_by: carried into the frame.

    Returns:
        The frame; its factor is what it is over what it was, 1 where it was black. Its noise is not known.
    """
    before = unlit_rgba(splats)
    after = unlit_rgba(replace(splats, color=color))
    factor = divide(after[..., :3], before[..., :3]) + (before[..., :3] <= 0)
    return Frame(
        camera=splats.camera,
        rgba=after,
        unlit=before,
        factor=np.asarray(factor, np.float32),
        lighting=upsample(lighting, splats.camera),
        splats=splats,
        made_by=made_by,
        noise=None,
        profile=splats.profile,
    )
