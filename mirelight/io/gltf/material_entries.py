"""A material as an entry of a glTF file: the inverse of ``materials`` and ``layers``."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour
from mirelight.io.gltf.textures import WRAP_NUMBERS
from mirelight.model import F32, F64, Material, Wraps

AddTexture: TypeAlias = Callable[[bytes, Wraps], dict[str, Any]]
_F0 = 0.04  # reflectance from above of an index of refraction of 1.5, which materials have that say nothing
_NEARLY = 1e-9


def material_entry(material: Material, add: AddTexture) -> dict[str, Any]:
    """The entry of ``materials`` that `read_materials` reads as this one; its extensions are those that it needs.

    Both sides of it are seen, as of all surfaces here. What is no colour is stored to a 255th.

    Args:
        material: colour, emission, finish, normals, alpha, reflectances, lacquer and transmission are stored.
        add: stores a PNG file and how it repeats, and gives the textureInfo.
    """
    shape: dict[str, Any] = {
        "baseColorFactor": [*material.base_color.tolist(), material.alpha],
        "metallicFactor": material.metallic,
        "roughnessFactor": material.roughness,
    }
    if material.base_color_texture is not None or material.alpha_texture is not None:
        shape["baseColorTexture"] = add(_base_png(material), material.base_color_wrap)
    if material.finish_texture is not None:
        shape["metallicRoughnessTexture"] = add(_png(_levels(material.finish_texture)), material.finish_wrap)
    entry: dict[str, Any] = {"name": material.name, "pbrMetallicRoughness": shape, "doubleSided": True}
    if material.cutoff is not None:
        entry |= {"alphaMode": "MASK", "alphaCutoff": material.cutoff}
    elif material.alpha < 1 or material.alpha_texture is not None:
        entry["alphaMode"] = "BLEND"
    if material.normal_texture is not None:
        entry["normalTexture"] = add(_png(_levels(material.normal_texture)), material.normal_wrap)
        if material.normal_scale != 1:
            entry["normalTexture"] = entry["normalTexture"] | {"scale": material.normal_scale}
    extensions = _emission(material, entry, add) | _reflectance(material, add) | _layers(material, add)
    if extensions:
        entry["extensions"] = {f"KHR_materials_{name}": value for name, value in extensions.items()}
    return entry


def wrap_numbers(wraps: Wraps) -> dict[str, int]:
    """The sampler of a texture that repeats so; empty where it is what files mean that say nothing."""
    if wraps == ("repeat", "repeat"):
        return {}
    s, t = (WRAP_NUMBERS[wrap] for wrap in wraps)
    return {"wrapS": s, "wrapT": t}


def _emission(material: Material, entry: dict[str, Any], add: AddTexture) -> dict[str, Any]:
    """Puts what glows into the entry; gives the extension of its strength."""
    brightest = float(material.emissive.max())
    if brightest <= 0:
        return {}
    # A power of two, so that factor * strength gives the same bits back.
    strength = 2.0 ** math.ceil(math.log2(brightest)) if brightest > 1 else 1.0
    entry["emissiveFactor"] = (material.emissive / strength).tolist()
    if material.emissive_texture is not None:
        entry["emissiveTexture"] = add(_png(_encoded(material.emissive_texture)), material.emissive_wrap)
    return {} if strength == 1 else {"emissive_strength": {"emissiveStrength": strength}}


def _reflectance(material: Material, add: AddTexture) -> dict[str, Any]:
    """Extensions of what a dielectric reflects: by its index where it is gray, else by a colour."""
    weight, texture, out = material.specular_weight, material.specular_texture, dict[str, Any]()
    from_above: F64 = material.specular / weight if weight > 0 else np.full(3, _F0)
    specular: dict[str, Any] = {} if weight == 1 else {"specularFactor": weight}
    if np.ptp(from_above) > _NEARLY or from_above.max() >= 1:
        specular["specularColorFactor"] = (from_above / _F0).tolist()
    elif abs(from_above[0] - _F0) > _NEARLY:
        root = math.sqrt(float(from_above[0]))
        out["ior"] = {"ior": (1 + root) / (1 - root)}
    if texture is not None:
        both = np.concatenate([_encoded(texture[..., :3]), _levels(texture[..., 3:])], axis=2)
        info = add(_png(both), material.specular_wrap)
        specular |= {"specularColorTexture": info, "specularTexture": info}
    return out | ({"specular": specular} if specular else {})


def _layers(material: Material, add: AddTexture) -> dict[str, Any]:
    """Extensions of lacquer and of glass."""
    out: dict[str, Any] = {}
    values, wraps = material.layer_texture, material.layer_wrap
    if material.clearcoat > 0:
        coat: dict[str, Any] = {
            "clearcoatFactor": material.clearcoat,
            "clearcoatRoughnessFactor": material.clearcoat_roughness,
        }
        if values is not None:
            info = add(_png(_levels(values)), wraps)
            coat |= {"clearcoatTexture": info, "clearcoatRoughnessTexture": info}
        out["clearcoat"] = coat
    if material.transmission > 0:
        out["transmission"] = {"transmissionFactor": material.transmission}
        if values is not None and (values[..., 2] < 1).any():
            out["transmission"]["transmissionTexture"] = add(_png(_levels(values[..., [2, 2, 2]])), wraps)
    return out


def _base_png(material: Material) -> bytes:
    """Colour and alpha as one picture, of the larger's size; white where there is alpha alone."""
    color, alpha = material.base_color_texture, material.alpha_texture
    if alpha is None:
        assert color is not None
        return _png(_encoded(color))
    shown = np.full((1, 1, 3), 255, np.uint8) if color is None else _encoded(color)
    size = np.maximum(shown.shape[:2], alpha.shape[:2])
    return _png(np.concatenate([_spread(shown, size), _spread(_levels(alpha[..., :1]), size)], axis=2))


def _spread(texels: NDArray[np.uint8], size: NDArray[np.intp]) -> NDArray[np.uint8]:
    """Texels at so many rows and columns, each the nearest."""
    rows, columns = (np.arange(n) * m // n for n, m in zip(size, texels.shape[:2], strict=True))
    return np.asarray(texels[rows[:, None], columns])


def _encoded(linear: F32) -> NDArray[np.uint8]:
    """8-bit sRGB of colours."""
    return _levels(colour.srgb_encode(linear))


def _levels(values: F32) -> NDArray[np.uint8]:
    """8 bits of 0 to 1."""
    return np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)


def _png(texels: NDArray[np.uint8]) -> bytes:
    """(h, w, 3 or 4) as a file."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(texels)).save(stream, "PNG")
    return stream.getvalue()
