"""The relight modes by name, and what a mode needs to be told."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mirelight.model import RelightMode, RelightSettings, SplatLayer, rules_of
from mirelight.model.profiles import Gloss, Space
from mirelight.relighting.albedo import ALBEDO
from mirelight.relighting.mode import Mode
from mirelight.relighting.ratio import RATIO
from mirelight.relighting.tint import TINT

MODES: Mapping[RelightMode, Mode] = MappingProxyType({mode.name: mode for mode in (TINT, RATIO, ALBEDO)})


def mode_of(settings: RelightSettings) -> Mode:
    """The mode that the settings name."""
    return MODES[settings.mode]


def reads(settings: RelightSettings) -> frozenset[str]:
    """Names of the settings that decide a frame once its splats and light are there; others may change at no cost.

    `texture_scale` is not among them: it decides the camera that light is traced with, see :func:`lighting_camera`.
    """
    mode = mode_of(settings)
    own = mode.reads | ({"space"} if mode.space is None and not rules_of(settings.profile).blending_space else set())
    own |= {"gloss"} if rules_of(settings.profile).path_traced else set()
    own |= {"per"} if rules_of(settings.profile).path_traced else set()
    own |= {"repair"} if mode.needs_captured and rules_of(settings.profile).path_traced else set()
    own |= {"sh"} if rules_of(settings.profile).splits_colour else set()
    return frozenset(own | {"mode", "profile", "blend"})


def per_splat(settings: RelightSettings) -> bool:
    """Whether splats are relit one by one, and not the pixels that they make."""
    return settings.per == "splat" and rules_of(settings.profile).path_traced


def repairs(settings: RelightSettings) -> bool:
    """Whether pixels are compared with captured light as the picture shows it."""
    compares = mode_of(settings).needs_captured and settings.blend > 0
    return settings.repair and settings.per == "pixel" and compares and rules_of(settings.profile).path_traced


def adds_lobes(settings: RelightSettings) -> bool:
    """Whether what the proxy's materials mirror of the new light is added to a frame."""
    return settings.gloss and settings.blend > 0 and rules_of(settings.profile).path_traced


def gloss_of(settings: RelightSettings) -> Gloss:
    """What becomes of colour that changes with the view."""
    return settings.sh if rules_of(settings.profile).splits_colour else "keep"


def space_of(splats: SplatLayer, settings: RelightSettings) -> Space:
    """Where the factor multiplies a composite."""
    if splats.linear:
        return "linear"
    mode = mode_of(settings)
    if mode.space is not None:
        return mode.space
    return "display" if rules_of(settings.profile).blending_space else settings.space
