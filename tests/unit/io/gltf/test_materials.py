"""Base colours, textures and emission."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mirelight.base import colour
from mirelight.base.errors import InputError
from mirelight.io.gltf.scene import read_scene
from mirelight.model import Material, ProxyMesh

PIXELS = np.random.default_rng(0).integers(0, 256, (4, 6, 3)).astype(np.uint8)
UVS = np.array([[0, 0], [1, 0], [0.25, 0.75]], dtype=np.float32)


def encoded(kind: str, pixels: NDArray[np.uint8] = PIXELS, **options: Any) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, kind, **options)
    return stream.getvalue()


def textured(
    glb: Any, image: dict[str, Any], info: dict[str, Any] | None = None, texture: dict[str, Any] | None = None
) -> None:
    """A triangle with a base colour texture."""
    source = glb.put("textures", {"source": glb.put("images", image), **(texture or {})})
    shape = {"baseColorTexture": {"index": source, **(info or {})}}
    material = glb.put("materials", {"pbrMetallicRoughness": shape})
    attributes = {"TEXCOORD_0": glb.accessor(UVS), "TEXCOORD_1": glb.accessor(1 - UVS)}
    glb.node(mesh=glb.mesh(glb.primitive(attributes=attributes, material=material)))


def proxy(glb: Any, **options: Any) -> ProxyMesh:
    mesh = read_scene(glb.save(), **options).mesh
    assert mesh is not None
    return mesh


@pytest.mark.parametrize(("kind", "options"), [("PNG", {}), ("WEBP", {"lossless": True})])
def test_textures_are_decoded_to_linear(glb: Any, kind: str, options: dict[str, Any]) -> None:
    textured(glb, {"bufferView": glb.view(encoded(kind, **options)), "mimeType": f"image/{kind.lower()}"})
    texture = proxy(glb).materials[0].base_color_texture
    assert texture is not None
    assert np.array_equal(texture, colour.srgb_decode(PIXELS / np.float32(255)))


def test_jpeg_beside_the_file(glb: Any, tmp_path: Any) -> None:
    flat = np.full((8, 8, 3), (200, 100, 50), dtype=np.uint8)
    (tmp_path / "base color.jpg").write_bytes(encoded("JPEG", flat, quality=100, subsampling=0))
    textured(glb, {"uri": "base%20color.jpg"})
    texture = proxy(glb).materials[0].base_color_texture
    assert texture is not None
    assert np.allclose(colour.srgb_encode(texture) * 255, (200, 100, 50), atol=2)


@pytest.mark.parametrize("mode", ["L", "LA", "P", "RGBA", "I;16"])
def test_other_kinds_of_png(glb: Any, mode: str) -> None:
    gray = PIXELS[..., 0]
    if mode == "I;16":
        image = Image.fromarray(gray.astype(np.uint16) * 257)
    else:
        image = Image.fromarray(gray).convert(mode)
    stream = io.BytesIO()
    image.save(stream, "PNG")
    textured(glb, {"bufferView": glb.view(stream.getvalue())})
    texture = proxy(glb).materials[0].base_color_texture
    assert texture is not None
    assert np.allclose(texture, colour.srgb_decode(gray / np.float32(255))[..., None], atol=1e-6)


def test_webp_extension_and_fallback(glb: Any) -> None:
    webp = glb.put("images", {"bufferView": glb.view(encoded("WEBP", lossless=True))})
    textured(glb, {"uri": "missing.png"}, texture={"extensions": {"EXT_texture_webp": {"source": webp}}})
    texture = proxy(glb).materials[0].base_color_texture
    assert texture is not None and texture.shape == (4, 6, 3)


def test_texture_transform_is_applied_to_the_coordinates(glb: Any) -> None:
    """The extension's own example: offset (0, 1), a quarter turn, scale 0.5 shows the image's lower left quadrant."""
    moved = {"offset": [0, 1], "rotation": math.pi / 2, "scale": [0.5, 0.5]}
    textured(glb, {"bufferView": glb.view(encoded("PNG"))}, {"extensions": {"KHR_texture_transform": moved}})
    uvs = proxy(glb).uvs
    assert uvs is not None
    u, v = UVS.T
    assert np.allclose(uvs, np.stack([0.5 * v, 1 - 0.5 * u], axis=1), atol=1e-6)
    assert uvs[:, 0].max() <= 0.5 and uvs[:, 1].min() >= 0.5


def test_second_set_of_coordinates(glb: Any) -> None:
    textured(glb, {"bufferView": glb.view(encoded("PNG"))}, {"texCoord": 1})
    uvs = proxy(glb).uvs
    assert uvs is not None and np.array_equal(uvs, 1 - UVS)


def test_the_transform_overrides_the_set(glb: Any) -> None:
    textured(glb, {"bufferView": glb.view(encoded("PNG"))}, {"extensions": {"KHR_texture_transform": {"texCoord": 1}}})
    uvs = proxy(glb).uvs
    assert uvs is not None and np.array_equal(uvs, 1 - UVS)


def test_samplers_say_how_coordinates_outside_the_image_wrap(glb: Any) -> None:
    sampler = glb.put("samplers", {"wrapS": 33071, "wrapT": 33648})
    textured(glb, {"bufferView": glb.view(encoded("PNG"))}, texture={"sampler": sampler})
    assert proxy(glb).materials[0].base_color_wrap == ("clamp", "mirror")
    glb.top["samplers"][0] = {"wrapT": 33071}
    assert proxy(glb).materials[0].base_color_wrap == ("repeat", "clamp")
    glb.top["samplers"][0] = {"wrapT": 7}
    with pytest.raises(InputError, match=r"samplers\[0\]\.wrapT: 7; expected 10497 \(repeat\)"):
        proxy(glb)


def test_without_textures_no_image_is_opened(glb: Any) -> None:
    textured(glb, {"uri": "missing.png"})
    assert proxy(glb, textures=False).materials[0].base_color_texture is None
    with pytest.raises(InputError, match=r"images\[0\]\.uri: missing.png: no such file"):
        proxy(glb)


@pytest.mark.parametrize("data", [b"not an image", encoded("PNG")[:60], b"\x89PNG\r\n\x1a\n" + b"\0" * 40])
def test_damaged_images_are_one_line(glb: Any, data: bytes) -> None:
    textured(glb, {"bufferView": glb.view(data)})
    with pytest.raises(InputError, match=r"images\[0\]: an image that cannot be decoded"):
        proxy(glb)


def test_an_image_bomb_is_refused_before_it_is_decoded(glb: Any) -> None:
    data = bytearray(encoded("PNG"))
    data[16:24] = (60_000).to_bytes(4, "big") * 2  # the header claims 3.6 gigapixels
    textured(glb, {"bufferView": glb.view(bytes(data))})
    with pytest.raises(InputError, match=r"images\[0\]"):
        proxy(glb)


def test_basis_textures_are_named(glb: Any) -> None:
    textured(glb, {"uri": "x.ktx2"}, texture={"extensions": {"KHR_texture_basisu": {"source": 0}}})
    del glb.top["textures"][0]["source"]
    with pytest.raises(InputError, match=r"textures\[0\]\.source: KHR_texture_basisu instead of a PNG"):
        proxy(glb)


def material(glb: Any, **fields: Any) -> Material:
    glb.node(mesh=glb.mesh(glb.primitive(material=glb.put("materials", fields))))
    return proxy(glb).materials[0]


def test_factor_and_emission(glb: Any) -> None:
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 20}}
    found = material(
        glb,
        name="lamp",
        pbrMetallicRoughness={"baseColorFactor": [0.1, 0.2, 0.3, 1]},
        emissiveFactor=[1, 0.5, 0],
        extensions=strength,
    )
    assert found.name == "lamp"
    assert found.base_color.tolist() == [0.1, 0.2, 0.3]
    assert found.emissive.tolist() == [20, 10, 0]


def test_finish_normals_alpha_and_lacquer_are_read_where_they_are_asked_for(glb: Any) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (4, 6, 4)).astype(np.uint8)
    image = glb.put("images", {"bufferView": glb.view(encoded("PNG", pixels)), "mimeType": "image/png"})
    texture = {"index": glb.put("textures", {"source": image})}
    made = glb.put(
        "materials",
        {
            "pbrMetallicRoughness": {
                "baseColorTexture": texture,
                "baseColorFactor": [1, 1, 1, 0.5],
                "metallicFactor": 0,
            },
            "normalTexture": {**texture, "scale": 0.5},
            "alphaMode": "MASK",
            "extensions": {
                "KHR_materials_ior": {"ior": 2.0},
                "KHR_materials_specular": {
                    "specularFactor": 0.5,
                    "specularColorFactor": [1, 0.5, 20],
                    "specularTexture": texture,
                },
                "KHR_materials_clearcoat": {"clearcoatFactor": 0.25, "clearcoatTexture": texture},
                "KHR_materials_transmission": {"transmissionFactor": 0.75, "transmissionTexture": texture},
                "KHR_materials_sheen": {},
            },
        },
    )
    glb.node(mesh=glb.mesh(glb.primitive(attributes={"TEXCOORD_0": glb.accessor(UVS)}, material=made)))
    found, plain = proxy(glb, finish=True).materials[0], proxy(glb).materials[0]
    np.testing.assert_allclose(found.specular, np.array([1 / 9, 1 / 18, 1]) * 0.5)
    assert (found.specular_weight, found.clearcoat, found.alpha, found.cutoff) == (0.5, 0.25, 0.5, 0.5)
    assert found.normal_scale == 0.5 and found.normal_texture is not None and found.alpha_texture is not None
    np.testing.assert_allclose(found.normal_texture, pixels[..., :3] / 255, atol=1e-6)
    np.testing.assert_allclose(found.alpha_texture[..., 0], pixels[..., 3] / 255, atol=1e-6)
    assert found.transmission == 0.75 and found.layer_texture is not None and found.specular_texture is not None
    np.testing.assert_allclose(found.layer_texture[..., [0, 2]], np.repeat(pixels[..., :1], 2, axis=2) / 255, atol=1e-6)
    assert (found.layer_texture[..., 1] == 1).all() and (found.specular_texture[..., :3] == 1).all()
    np.testing.assert_allclose(found.specular_texture[..., 3], pixels[..., 3] / 255, atol=1e-6)
    assert found.ignored == ("sheen", "frosting of glass")
    assert plain.normal_texture is None and plain.alpha_texture is None and plain.alpha == 1
    with pytest.raises(InputError, match=r"ior: 0\.5; it must be 0, or 1 and more"):
        glb.top["materials"][0]["extensions"]["KHR_materials_ior"]["ior"] = 0.5
        proxy(glb, finish=True)


def test_the_archived_specular_glossiness_model(glb: Any) -> None:
    glossy = {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0.1, 0.2, 0.3, 1]}}
    assert material(glb, extensions=glossy).base_color.tolist() == [0.1, 0.2, 0.3]


def test_a_primitive_without_material_is_white_and_dark(glb: Any) -> None:
    glb.node(mesh=glb.mesh(glb.primitive()))
    found = proxy(glb).materials[0]
    assert found.base_color.tolist() == [1, 1, 1] and found.emissive.tolist() == [0, 0, 0]


def glowing(glb: Any, info: dict[str, Any] | None = None, **fields: Any) -> None:
    """A triangle with a base colour texture and an emissive one, of the same image."""
    textured(glb, {"bufferView": glb.view(encoded("PNG"))})
    sampler = glb.put("samplers", {"wrapS": 33071, "wrapT": 33071})
    emissive = glb.put("textures", {"source": 0, "sampler": sampler})
    glb.top["materials"][0] |= {"emissiveTexture": {"index": emissive, **(info or {})}, **fields}


def test_an_emissive_texture_multiplies_factor_and_strength(glb: Any) -> None:
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 20}}
    glowing(glb, emissiveFactor=[1, 0.5, 0.25], extensions=strength)
    for textures in (True, False):  # it glows whatever the albedo is
        found = proxy(glb, textures=textures).materials[0]
        assert found.emissive.tolist() == [20, 10, 5]
        assert found.emissive_texture is not None and found.emissive_wrap == ("clamp", "clamp")
        assert np.array_equal(found.emissive_texture, colour.srgb_decode(PIXELS / np.float32(255)))
        assert (found.base_color_texture is None) == (not textures)
        assert found.base_color_wrap == ("repeat", "repeat")


def test_a_black_factor_leaves_the_emissive_texture_closed(glb: Any) -> None:
    found = material(glb, emissiveTexture={"index": 0})
    assert found.emissive.tolist() == [0, 0, 0] and found.emissive_texture is None


def test_both_textures_of_a_material_read_the_same_coordinates(glb: Any) -> None:
    glowing(glb, {"texCoord": 1}, emissiveFactor=[1, 1, 1])
    with pytest.raises(InputError, match=r"materials\[0\]\.emissiveTexture: other texture coordinates than the base"):
        proxy(glb)
    uvs = proxy(glb, textures=False).uvs  # the emissive texture alone has its own
    assert uvs is not None and np.array_equal(uvs, 1 - UVS)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"pbrMetallicRoughness": {"baseColorFactor": [-1, 0, 0, 1]}}, "baseColorFactor: .*must not be negative"),
        ({"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1]}}, "3 numbers, expected 4"),
        ({"emissiveFactor": [-1, 0, 0]}, "emissiveFactor: negative"),
        ({"pbrMetallicRoughness": []}, "an array, expected an object"),
    ],
)
def test_materials_outside_the_specification(glb: Any, fields: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        material(glb, **fields)
