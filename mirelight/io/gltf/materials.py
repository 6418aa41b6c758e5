"""glTF materials (glTF §3.8.4, §3.9): colour and emission of any, and of objects also their finish, normals, alpha and
lacquer (KHR_materials_ior, _specular, _clearcoat)."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mirelight.base import colour
from mirelight.base.errors import printable
from mirelight.io.gltf.document import Document
from mirelight.io.gltf.fields import Bytes, Fields
from mirelight.io.ldr import decode_srgb_image, decode_with_alpha
from mirelight.io.safety import BRIGHTEST
from mirelight.model import F32, F64, Material, Wrap, Wraps

_UNFOLLOWED = (
    "KHR_materials_anisotropy",
    "KHR_materials_dispersion",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
)
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
    metallic, roughness = (_share(shape, name) for name in ("metallicFactor", "roughnessFactor"))
    if glossy is not None:
        metallic, roughness = 0.0, 1 - _share(glossy, "glossinessFactor")
    made, uv = replace(plain.material, metallic=metallic, roughness=roughness), plain.uv
    if not textured:
        return TexturedMaterial(made, uv)
    made = _layered(entry, made)
    for owner, name, field, wrap in (
        (shape, "metallicRoughnessTexture", "finish_texture", "finish_wrap"),
        (entry, "normalTexture", "normal_texture", "normal_wrap"),
    ):
        if name not in owner or (glossy is not None and owner is shape):
            continue
        found = _texture(document, owner.child(name), images)
        if uv is not None and uv.key() != found.uv.key():
            remedy = "give both the same texCoord and KHR_texture_transform"
            raise owner.fail(name, "other texture coordinates than the base colour's", remedy)
        uv = found.uv
        values = colour.srgb_encode(found.image)  # these texels are numbers, and were read as colours
        more: dict[str, Any] = {field: values, wrap: found.wraps}
        made = replace(made, **more)
    if "normalTexture" in entry:
        made = replace(made, normal_scale=entry.child("normalTexture").number("scale", 1.0))
    return TexturedMaterial(_cut(document, entry, shape, made), uv)


def _layered(entry: Fields, made: Material) -> Material:
    """With reflectances and lacquer, and the names of what is not followed."""
    of_ior, of_specular, of_coat = (entry.extension(f"KHR_materials_{x}") for x in ("ior", "specular", "clearcoat"))
    ior = 1.5 if of_ior is None else of_ior.number("ior", 1.5)
    if of_ior is not None and ior != 0 and ior < 1:
        raise of_ior.fail("ior", f"{ior:g}", "it must be 0, or 1 and more")
    tint, weight = np.ones(3), 1.0
    if of_specular is not None:
        weight = _share(of_specular, "specularFactor")
        tint = of_specular.vector("specularColorFactor", 3, (1, 1, 1))
        if np.any(tint < 0) or np.any(tint > BRIGHTEST):
            raise of_specular.fail("specularColorFactor", f"{tint.tolist()}", "it must not be negative, or far above 1")
    above = 1.0 if ior == 0 else ((ior - 1) / (ior + 1)) ** 2  # 0 is said of what reflects all, for older materials
    coat, rough = 0.0, 0.0
    if of_coat is not None:
        coat, rough = (_share(of_coat, name, 0.0) for name in ("clearcoatFactor", "clearcoatRoughnessFactor"))
    there = [x.removeprefix("KHR_materials_") for x in _UNFOLLOWED if entry.extension(x) is not None]
    for owner in (of_specular, of_coat):
        there += [] if owner is None else [x for x in owner.values if x.endswith("Texture")]
    return replace(
        made,
        specular=np.minimum(above * tint, 1) * weight,
        specular_weight=weight,
        clearcoat=coat,
        clearcoat_roughness=rough,
        ignored=tuple(there),
    )


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
        texture = _alpha(document, document.entry("textures", info.integer("index"), info, "index"))
    cutoff = entry.number("alphaCutoff", 0.5) if kind == "MASK" else None
    alpha = float(np.clip(shape.vector(names[0], 4, (1, 1, 1, 1))[3], 0, 1))
    return replace(made, alpha=alpha, alpha_texture=texture, cutoff=cutoff)


def _alpha(document: Document, texture: Fields) -> F32 | None:
    """(h, w, 3) the alpha of a texture's image, three times; None where it has none."""
    image = document.entry("images", _image_index(texture), texture, "source")
    _, alpha = decode_with_alpha(io.BytesIO(_encoded(document, image).tobytes()), document.path)
    return None if alpha is None else np.repeat(alpha[..., None], 3, axis=2)


def _share(shape: Fields, name: str, default: float = 1.0) -> float:
    value = shape.number(name, default)
    if not 0 <= value <= 1:
        raise shape.fail(name, f"{value:g}", "it must be from 0 to 1")
    return value


def _surface(document: Document, entry: Fields, textures: bool, images: dict[int, F32]) -> TexturedMaterial:
    shape, names = entry.child("pbrMetallicRoughness"), ("baseColorFactor", "baseColorTexture")
    glossy = entry.extension("KHR_materials_pbrSpecularGlossiness")
    if glossy is not None:  # archived, but common in older files: its diffuse part is the base colour
        shape, names = glossy, ("diffuseFactor", "diffuseTexture")
    factor = shape.vector(names[0], 4, (1, 1, 1, 1))[:3]
    if np.any(factor < 0) or np.any(factor > BRIGHTEST):
        raise shape.fail(names[0], f"{factor.tolist()}", "it must not be negative, or far above 1")
    emissive = _emissive(entry)
    base = _texture(document, shape.child(names[1]), images) if textures and names[1] in shape else None
    glow = None
    if np.any(emissive > 0) and "emissiveTexture" in entry:
        glow = _texture(document, entry.child("emissiveTexture"), images)
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


@dataclass(frozen=True, slots=True, eq=False)
class _Texture:
    image: F32  # (h, w, 3) linear
    wraps: Wraps
    uv: UvSource


def _texture(document: Document, info: Fields, images: dict[int, F32]) -> _Texture:
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
        images[index] = _decode(document, document.entry("images", index, texture, "source"))
    return _Texture(images[index], wraps, UvSource(texcoord, transform))


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


def _decode(document: Document, image: Fields) -> F32:
    return decode_srgb_image(io.BytesIO(_encoded(document, image).tobytes()), document.path, image.where)


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
