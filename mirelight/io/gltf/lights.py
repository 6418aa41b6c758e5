"""KHR_lights_punctual: every light with the node that carries it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mirelight.base import conventions
from mirelight.io.gltf.beyond import restored
from mirelight.io.gltf.document import Document
from mirelight.io.gltf.fields import Fields
from mirelight.io.gltf.names import unique_names
from mirelight.io.gltf.nodes import Node
from mirelight.io.safety import BRIGHTEST
from mirelight.model import DirectionalLight, Light, PointLight, PunctualLight, SpotLight

EXTENSION = "KHR_lights_punctual"
_AS_WRITTEN: Mapping[int, Mapping[str, object]] = {}


def read_node_lights(
    document: Document, nodes: Iterable[Node], values: Mapping[int, Mapping[str, object]] = _AS_WRITTEN
) -> tuple[Light, ...]:
    """The lights of the placed nodes, in node order.

    `values`: by the light's index, values of fields ("intensity", "spot/innerConeAngle") in place of the file's.

    A light shines along its node's world -Z; scale changes neither intensity nor range (KHR_lights_punctual, "Light
    properties"). Names are the light's, else the node's, else its type, made unique. Lights that it has no words for
    come back from their extras (`gltf.beyond`).

    Raises:
        InputError: a value outside the specification, with its field.
    """
    carriers = [(node, user) for node in nodes if (user := node.fields.extension(EXTENSION)) is not None]
    lights = document.top.child("extensions").child(EXTENSION).children("lights") if carriers else []
    found = [(node, _definition(lights, user, values)) for node, user in carriers]
    names = unique_names([(light.text("name", ""), node.name, light.text("type")) for node, light in found])
    return tuple(
        restored(_light(light, node, name), light, node.world) for (node, light), name in zip(found, names, strict=True)
    )


def _definition(lights: Sequence[Fields], user: Fields, values: Mapping[int, Mapping[str, object]]) -> Fields:
    index = user.integer("light")
    if index >= len(lights):
        raise user.fail("light", f"there is no light {index} ({len(lights)} in the file)")
    light, own = lights[index], values.get(index, {})
    if not own:
        return light
    inside = {name.removeprefix("spot/"): value for name, value in own.items() if name.startswith("spot/")}
    changed = dict(light.values) | {name: value for name, value in own.items() if "/" not in name}
    if inside:
        changed["spot"] = dict(light.child("spot").values) | inside
    return replace(light, values=changed)


def _light(light: Fields, node: Node, name: str) -> PunctualLight:
    color, intensity = light.vector("color", 3, (1, 1, 1)), light.number("intensity", 1.0)
    if np.any(color < 0) or np.any(color > 1):
        raise light.fail("color", f"{color.tolist()}", "every component must lie in 0..1; scale the intensity instead")
    if not 0 <= intensity <= BRIGHTEST:
        raise light.fail("intensity", f"{intensity:g}", f"expected 0 to {BRIGHTEST:g}")
    kind = light.text("type")
    own: dict[str, Any] = {"name": name, "color": color, "intensity": intensity}
    if kind == "directional":
        return DirectionalLight(**own, direction=_direction(node))
    own["position"] = node.world[:3, 3]
    if kind == "point":
        return PointLight(**own, range=_range(light))
    if kind == "spot":
        inner, outer = _cone(light.child("spot"))
        own |= {"direction": _direction(node), "range": _range(light)}
        return SpotLight(**own, inner_cone_angle=inner, outer_cone_angle=outer)
    raise light.fail("type", f"{kind[:40]!r}", "expected directional, point or spot")


def _direction(node: Node) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    try:
        return conventions.unit(-node.world[:3, 2])
    except ValueError:
        raise node.fields.fail("", "its Z axis has length zero, so its light has no direction") from None


def _range(light: Fields) -> float:
    value = light.number("range", math.inf)
    if value <= 0:
        raise light.fail("range", f"{value:g}", "it must be positive; leave it out for no limit")
    return value


def _cone(spot: Fields) -> tuple[float, float]:
    inner, outer = spot.number("innerConeAngle", 0.0), spot.number("outerConeAngle", math.pi / 4)
    # Single-precision writers print pi / 2 a little too large.
    if not 0 < outer <= math.pi / 2 + 1e-6:
        raise spot.fail("outerConeAngle", f"{outer:g}", "it must lie above 0 and not above pi / 2")
    if not 0 <= inner < outer:
        raise spot.fail("innerConeAngle", f"{inner:g}, with outerConeAngle {outer:g}", "it must lie in 0 .. outer")
    return inner, min(outer, math.pi / 2)
