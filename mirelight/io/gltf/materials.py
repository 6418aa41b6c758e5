"""glTF materials (glTF §3.8.4, §3.9): colour and emission of any, and of objects also their finish, normals and alpha.

What extensions lay over that is in `mirelight.io.gltf.layers`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mirelight.base import colour
from mirelight.base.errors import printable
from mirelight.io.gltf.document import Document
from mirelight.io.gltf.fields import Fields
from mirelight.io.gltf.layers import layered, share
from mirelight.io.gltf.textures import UvSource, alpha_of, texture_of
from mirelight.io.safety import BRIGHTEST
from mirelight.model import F32, F64, Material


@dataclass(frozen=True, slots=True, eq=False)
class TexturedMaterial:
    """A material and where its texture coordinates come from; `uv` is None without a texture."""

    material: Material
    uv: UvSource | None = None


def read_materials(
    document: Document, used: set[int], textures: bool, finish: bool = False
) -> dict[int, TexturedMaterial]:
    """The materials of those indices.

    Args:
        document: the open file.
        used: which ``materials`` entries are wanted.
        textures: decode base colour textures; without, their factor alone is kept. Emissive ones are always decoded,
            unless their factor is black.
        finish: decode those of metallic and roughness, normals and alpha.

    Raises:
        InputError: a value outside the specification, an image that cannot be decoded, textures of one material that
            read different coordinates.
    """
    images: dict[int, F32] = {}
    entries = {index: document.entry("materials", index) for index in sorted(used)}
    plain = {index: _surface(document, entry, textures, images) for index, entry in entries.items()}
    return {i: _finished(document, entries[i], x, finish, images) for i, x in plain.items()}


def _finished(
    document: Document, entry: Fields, plain: TexturedMaterial, textured: bool, images: dict[int, F32]
) -> TexturedMaterial:
    """The material with metallic and roughness; of the archived extension's, which has no metals, roughness alone."""
    glossy = entry.extension("KHR_materials_pbrSpecularGlossiness")
    shape = entry.child("pbrMetallicRoughness")
    metallic, roughness = (share(shape, name) for name in ("metallicFactor", "roughnessFactor"))
    if glossy is not None:
        metallic, roughness = 0.0, 1 - share(glossy, "glossinessFactor")
    made, uv = replace(plain.material, metallic=metallic, roughness=roughness), plain.uv
    if not textured:
        return TexturedMaterial(made, uv)
    for owner, name, field, wrap in (
        (shape, "metallicRoughnessTexture", "finish_texture", "finish_wrap"),
        (entry, "normalTexture", "normal_texture", "normal_wrap"),
    ):
        if name not in owner or (glossy is not None and owner is shape):
            continue
        found = texture_of(document, owner.child(name), images)
        if uv is not None and uv.key() != found.uv.key():
            remedy = "give both the same texCoord and KHR_texture_transform"
            raise owner.fail(name, "other texture coordinates than the base colour's", remedy)
        uv = found.uv
        values = colour.srgb_encode(found.image)  # these texels are numbers, and were read as colours
        more: dict[str, Any] = {field: values, wrap: found.wraps}
        made = replace(made, **more)
    if "normalTexture" in entry:
        made = replace(made, normal_scale=entry.child("normalTexture").number("scale", 1.0))
    made, uv = layered(document, entry, _cut(document, entry, shape, made), uv, images)
    return TexturedMaterial(made, uv)


def _cut(document: Document, entry: Fields, shape: Fields, made: Material) -> Material:
    """With alpha, unless the file says that there is none."""
    kind = entry.text("alphaMode", "OPAQUE")
    if kind not in ("MASK", "BLEND"):
        return made
    names = ("baseColorFactor", "baseColorTexture")
    glossy = entry.extension("KHR_materials_pbrSpecularGlossiness")
    if glossy is not None:
        shape, names = glossy, ("diffuseFactor", "diffuseTexture")
    texture: F32 | None = None
    if names[1] in shape:
        info = shape.child(names[1])
        texture = alpha_of(document, document.entry("textures", info.integer("index"), info, "index"))
    cutoff = entry.number("alphaCutoff", 0.5) if kind == "MASK" else None
    alpha = float(np.clip(shape.vector(names[0], 4, (1, 1, 1, 1))[3], 0, 1))
    return replace(made, alpha=alpha, alpha_texture=texture, cutoff=cutoff)


def _surface(document: Document, entry: Fields, textures: bool, images: dict[int, F32]) -> TexturedMaterial:
    shape, names = entry.child("pbrMetallicRoughness"), ("baseColorFactor", "baseColorTexture")
    glossy = entry.extension("KHR_materials_pbrSpecularGlossiness")
    if glossy is not None:  # archived, but common in older files: its diffuse part is the base colour
        shape, names = glossy, ("diffuseFactor", "diffuseTexture")
    factor = shape.vector(names[0], 4, (1, 1, 1, 1))[:3]
    if np.any(factor < 0) or np.any(factor > BRIGHTEST):
        raise shape.fail(names[0], f"{factor.tolist()}", "it must not be negative, or far above 1")
    emissive = _emissive(entry)
    base = texture_of(document, shape.child(names[1]), images) if textures and names[1] in shape else None
    glow = None
    if np.any(emissive > 0) and "emissiveTexture" in entry:
        glow = texture_of(document, entry.child("emissiveTexture"), images)
    if base is not None and glow is not None and base.uv.key() != glow.uv.key():
        found = "other texture coordinates than the base colour's"
        raise entry.fail("emissiveTexture", found, "give both the same texCoord and KHR_texture_transform")
    material = Material(
        name=printable(entry.text("name", "")) or entry.where,
        base_color=factor,
        base_color_texture=base.image if base else None,
        base_color_wrap=base.wraps if base else ("repeat", "repeat"),
        emissive=emissive,
        emissive_texture=glow.image if glow else None,
        emissive_wrap=glow.wraps if glow else ("repeat", "repeat"),
    )
    used = base or glow
    return TexturedMaterial(material, used.uv if used else None)


def _emissive(entry: Fields) -> F64:
    factor = entry.vector("emissiveFactor", 3, (0, 0, 0))
    strength = entry.extension("KHR_materials_emissive_strength")
    scale = strength.number("emissiveStrength", 1.0) if strength else 1.0
    if np.any(factor < 0) or scale < 0:
        raise entry.fail("emissiveFactor", "negative emission", "it must not be negative")
    with np.errstate(over="ignore", invalid="ignore"):
        radiance = np.asarray(factor * scale, dtype=np.float64)
    if not np.all(radiance <= BRIGHTEST):
        raise entry.fail("emissiveFactor", f"an emission of {radiance.max():g}", f"at most {BRIGHTEST:g} is read")
    return radiance
