"""Textures of glTF materials: which image, how it repeats, which coordinates it takes."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from mirelight.io.gltf.document import Document
from mirelight.io.gltf.fields import Bytes, Fields
from mirelight.io.ldr import decode_srgb_image, decode_with_alpha
from mirelight.model import F32, F64, Wrap, Wraps

WRAP_NUMBERS: dict[Wrap, int] = {"repeat": 10497, "mirror": 33648, "clamp": 33071}  # of a sampler's wrapS and wrapT


@dataclass(frozen=True, slots=True, eq=False)
class UvSource:
    """Which texture coordinates a material's textures take, and how they are moved."""

    texcoord: int = 0
    transform: F64 | None = None  # (2, 3) KHR_texture_transform; None: as they are

    def key(self) -> tuple[int, bytes]:
        """Equal where two materials read the same coordinates."""
        return self.texcoord, b"" if self.transform is None else self.transform.tobytes()


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """An image and how a material takes it."""

    image: F32  # (h, w, 3) linear
    wraps: Wraps
    uv: UvSource


def texture_of(document: Document, info: Fields, images: dict[int, F32]) -> Texture:
    """The texture that a textureInfo names, decoded as colours (h, w, 3); `images` holds those read before, by index.

    Raises:
        InputError: it cannot be decoded, or a value is outside the specification.
    """
    texture = document.entry("textures", info.integer("index"), info, "index")
    texcoord, transform = info.integer("texCoord", 0, high=255), None
    moved = info.extension("KHR_texture_transform")
    if moved is not None:
        texcoord = moved.integer("texCoord", texcoord, high=255)
        transform = _uv_transform(moved)
    wraps: Wraps = ("repeat", "repeat")
    if "sampler" in texture:
        sampler = document.entry("samplers", texture.integer("sampler"), texture, "sampler")
        wraps = _wrap(sampler, "wrapS"), _wrap(sampler, "wrapT")
    index = _image_index(texture)
    if index not in images:
        image = document.entry("images", index, texture, "source")
        encoded = io.BytesIO(_encoded(document, image).tobytes())
        images[index] = decode_srgb_image(encoded, document.path, image.where)
    return Texture(images[index], wraps, UvSource(texcoord, transform))


def _wrap(sampler: Fields, name: str) -> Wrap:
    value = sampler.integer(name, WRAP_NUMBERS["repeat"])
    for wrap, number in WRAP_NUMBERS.items():
        if value == number:
            return wrap
    raise sampler.fail(name, str(value), "expected 10497 (repeat), 33648 (mirror) or 33071 (clamp)")


def _image_index(texture: Fields) -> int:
    webp = texture.extension("EXT_texture_webp")
    if webp is not None:
        return webp.integer("source")
    if "source" not in texture:
        others = ", ".join(sorted(texture.child("extensions").values)) or "no image"
        raise texture.fail("source", f"{others[:80]} instead of a PNG, JPEG or WebP image", "convert it to PNG")
    return texture.integer("source")


def _encoded(document: Document, image: Fields) -> Bytes:
    if "bufferView" in image:
        return document.view(image.integer("bufferView"), image)
    return document.resource(image, "uri")


def _uv_transform(moved: Fields) -> F64:
    """(2, 3) matrix of KHR_texture_transform, translation * rotation * scale.

    The rotation is counter-clockwise with v pointing down, as the extension's text, its example and the Khronos viewer
    have it; the GLSL printed in the extension turns the other way.
    """
    (tx, ty), (sx, sy) = moved.vector("offset", 2, (0, 0)), moved.vector("scale", 2, (1, 1))
    turn = moved.number("rotation", 0.0)
    c, s = np.cos(turn), np.sin(turn)
    return np.array([[c * sx, s * sy, tx], [-s * sx, c * sy, ty]])


def alpha_of(document: Document, texture: Fields) -> F32 | None:
    """(h, w, 3) the alpha of a texture's image, three times; None where it has none."""
    image = document.entry("images", _image_index(texture), texture, "source")
    _, alpha = decode_with_alpha(io.BytesIO(_encoded(document, image).tobytes()), document.path)
    return None if alpha is None else np.repeat(alpha[..., None], 3, axis=2)
