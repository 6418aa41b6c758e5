"""Base colour and emission of glTF materials (glTF §3.9): all that a Lambert proxy can use."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from mirelight.io.gltf.document import Document
from mirelight.io.gltf.fields import Bytes, Fields
from mirelight.io.ldr import decode_srgb_image
from mirelight.model import F32, F64, Material

_CLAMP, _MIRROR, _REPEAT = 33071, 33648, 10497


@dataclass(frozen=True, slots=True, eq=False)
class UvSource:
    """Which texture coordinates a material's base colour texture takes, and how they are moved."""

    texcoord: int = 0
    transform: F64 | None = None  # (2, 3) KHR_texture_transform; None: as they are
    repeats: bool = True  # coordinates outside 0..1 wrap around, which is the only wrap that model.Material knows
    field: str = ""  # where it stands, for messages

    def key(self) -> tuple[int, bytes]:
        """Equal where two materials read the same coordinates."""
        return self.texcoord, b"" if self.transform is None else self.transform.tobytes()


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A material and where its texture coordinates come from; `uv` is None without a texture."""

    material: Material
    uv: UvSource | None = None


def read_materials(document: Document, used: set[int], textures: bool) -> dict[int, Surface]:
    """The materials of those indices.

    Args:
        document: the open file.
        used: which ``materials`` entries are wanted.
        textures: decode base colour textures; without, the factor alone is kept and no image is opened.

    Raises:
        InputError: a value outside the specification, an image that cannot be decoded, an emissive texture.
    """
    images: dict[int, F32] = {}
    return {index: _surface(document, document.entry("materials", index), textures, images) for index in sorted(used)}


def _surface(document: Document, entry: Fields, textures: bool, images: dict[int, F32]) -> Surface:
    shape, names = entry.child("pbrMetallicRoughness"), ("baseColorFactor", "baseColorTexture")
    glossy = entry.extension("KHR_materials_pbrSpecularGlossiness")
    if glossy is not None:  # archived, but common in older files: its diffuse part is the base colour
        shape, names = glossy, ("diffuseFactor", "diffuseTexture")
    factor = shape.vector(names[0], 4, (1, 1, 1, 1))[:3]
    if np.any(factor < 0):
        raise shape.fail(names[0], f"{factor.tolist()}", "it must not be negative")
    image, uv = None, None
    if textures and names[1] in shape:
        image, uv = _texture(document, shape.child(names[1]), images)
    material = Material(
        name=entry.text("name", "") or entry.where,
        base_color=factor,
        base_color_texture=image,
        emissive=_emissive(entry),
    )
    return Surface(material, uv)


def _emissive(entry: Fields) -> F64:
    factor = entry.vector("emissiveFactor", 3, (0, 0, 0))
    strength = entry.extension("KHR_materials_emissive_strength")
    scale = strength.number("emissiveStrength", 1.0) if strength else 1.0
    if np.any(factor < 0) or scale < 0:
        raise entry.fail("emissiveFactor", "negative emission", "it must not be negative")
    emission = factor * scale
    if np.any(emission > 0) and "emissiveTexture" in entry:
        remedy = "give the glowing faces a material of their own with emissiveFactor, or remove the texture"
        raise entry.fail("emissiveTexture", "emissive textures are not supported", remedy)
    return np.asarray(emission, dtype=np.float64)


def _texture(document: Document, info: Fields, images: dict[int, F32]) -> tuple[F32, UvSource]:
    texture = document.entry("textures", info.integer("index"), info, "index")
    texcoord, transform = info.integer("texCoord", 0, high=255), None
    moved = info.extension("KHR_texture_transform")
    if moved is not None:
        texcoord = moved.integer("texCoord", texcoord, high=255)
        transform = _uv_transform(moved)
    repeats = True
    if "sampler" in texture:
        sampler = document.entry("samplers", texture.integer("sampler"), texture, "sampler")
        repeats = sampler.integer("wrapS", _REPEAT) == _REPEAT and sampler.integer("wrapT", _REPEAT) == _REPEAT
    index = _image_index(texture)
    if index not in images:
        images[index] = _decode(document, document.entry("images", index, texture, "source"))
    return images[index], UvSource(texcoord, transform, repeats, info.where)


def _image_index(texture: Fields) -> int:
    webp = texture.extension("EXT_texture_webp")
    if webp is not None:
        return webp.integer("source")
    if "source" not in texture:
        others = ", ".join(sorted(texture.child("extensions").values)) or "no image"
        raise texture.fail("source", f"{others[:80]} instead of a PNG, JPEG or WebP image", "convert it to PNG")
    return texture.integer("source")


def _decode(document: Document, image: Fields) -> F32:
    data: Bytes
    if "bufferView" in image:
        data = document.view(image.integer("bufferView"), image)
    else:
        data = document.resource(image, "uri")
    return decode_srgb_image(io.BytesIO(data.tobytes()), document.path, image.where)


def _uv_transform(moved: Fields) -> F64:
    """(2, 3) matrix of KHR_texture_transform, translation * rotation * scale.

    The rotation is counter-clockwise with v pointing down, as the extension's text, its example and the Khronos viewer
    have it; the GLSL printed in the extension turns the other way.
    """
    (tx, ty), (sx, sy) = moved.vector("offset", 2, (0, 0)), moved.vector("scale", 2, (1, 1))
    turn = moved.number("rotation", 0.0)
    c, s = np.cos(turn), np.sin(turn)
    return np.array([[c * sx, s * sy, tx], [-s * sx, c * sy, ty]])
