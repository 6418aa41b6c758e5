"""What extensions of glTF lay over a material: KHR_materials_ior, _specular, _clearcoat and _transmission.

Walls are thin: light that goes through one goes straight on. What else a file says is named, and not followed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.base import colour
from mirelight.io.gltf.document import Document
from mirelight.io.gltf.fields import Fields
from mirelight.io.gltf.textures import Texture, UvSource, alpha_of, texture_of
from mirelight.io.safety import BRIGHTEST
from mirelight.model import F32, Material, Wraps

_UNFOLLOWED = (
    "KHR_materials_anisotropy",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_unlit",
    "KHR_materials_volume",
)
_FROSTED = 0.1  # roughness from which glass is seen to be shown clearer than it is


def layered(
    document: Document, entry: Fields, made: Material, uv: UvSource | None, images: dict[int, F32]
) -> tuple[Material, UvSource | None]:
    """(the material with reflectances, lacquer and transmission, and the names of what is not followed; where its
    texture coordinates come from).

    Raises:
        InputError: a value outside the specification, an image that cannot be decoded.
    """
    names = ("ior", "specular", "clearcoat", "transmission")
    of_ior, of_specular, of_coat, of_glass = (entry.extension(f"KHR_materials_{x}") for x in names)
    ior = 1.5 if of_ior is None else of_ior.number("ior", 1.5)
    if of_ior is not None and ior != 0 and ior < 1:
        raise of_ior.fail("ior", f"{ior:g}", "it must be 0, or 1 and more")
    tint, weight = np.ones(3), 1.0
    if of_specular is not None:
        weight = share(of_specular, "specularFactor")
        tint = of_specular.vector("specularColorFactor", 3, (1, 1, 1))
        if np.any(tint < 0) or np.any(tint > BRIGHTEST):
            raise of_specular.fail("specularColorFactor", f"{tint.tolist()}", "it must not be negative, or far above 1")
    above = 1.0 if ior == 0 else ((ior - 1) / (ior + 1)) ** 2  # 0 is said of what reflects all, for older materials
    coat, rough = 0.0, 0.0
    if of_coat is not None:
        coat, rough = (share(of_coat, name, 0.0) for name in ("clearcoatFactor", "clearcoatRoughnessFactor"))
    glass = 0.0 if of_glass is None else share(of_glass, "transmissionFactor", 0.0)
    said = [x.removeprefix("KHR_materials_") for x in _UNFOLLOWED if entry.extension(x) is not None]
    if glass > 0 and made.roughness > _FROSTED:
        said.append("frosting of glass")
    maps = _Maps(document, uv, images)
    specular = maps.of(((of_specular, "specularColorTexture", (0, 1, 2)), (of_specular, "specularTexture", (3,))), 4)
    layers = maps.of(
        (
            (of_coat, "clearcoatTexture", (0,)),
            (of_coat, "clearcoatRoughnessTexture", (1,)),
            (of_glass, "transmissionTexture", (2,)),
        ),
        3,
    )
    said += maps.left
    said += [] if of_coat is None or "clearcoatNormalTexture" not in of_coat else ["clearcoatNormalTexture"]
    return replace(
        made,
        specular=np.minimum(above * tint, 1) * weight,
        specular_weight=weight,
        specular_texture=specular[0],
        specular_wrap=specular[1],
        clearcoat=coat,
        clearcoat_roughness=rough,
        transmission=glass,
        layer_texture=layers[0],
        layer_wrap=layers[1],
        ignored=tuple(said),
    ), maps.uv


class _Maps:
    """Reads textures whose channels belong to one; those that read other coordinates than the rest are left out."""

    def __init__(self, document: Document, uv: UvSource | None, images: dict[int, F32]) -> None:
        self._document, self._images = document, images
        self.uv = uv
        self.left: list[str] = []  # names of those

    def of(
        self, wanted: tuple[tuple[Fields | None, str, tuple[int, ...]], ...], channels: int
    ) -> tuple[F32 | None, Wraps]:
        """((h, w, channels) 1 where no texture says other, how it repeats); None: there is none.

        Args:
            wanted: owner and name of each texture, and the channels that it fills.
            channels: of all.
        """
        found: list[tuple[F32, tuple[int, ...]]] = []
        wraps: Wraps | None = None
        for owner, name, places in wanted:
            if owner is None or name not in owner:
                continue
            info = owner.child(name)
            texture = texture_of(self._document, info, self._images)
            alike = self.uv is None or self.uv.key() == texture.uv.key()
            if not alike or wraps not in (None, texture.wraps):
                self.left.append(name)
                continue
            self.uv, wraps = texture.uv, texture.wraps
            found.append((self._values(info, texture, places), places))
        if not found:
            return None, ("repeat", "repeat")
        h, w = (max(x.shape[k] for x, _ in found) for k in range(2))
        out = np.ones((h, w, channels), np.float32)
        for values, places in found:
            rows, columns = (np.arange(n) * m // n for n, m in zip((h, w), values.shape[:2], strict=True))
            out[..., places] = values[rows[:, None], columns]
        return out, wraps or ("repeat", "repeat")

    def _values(self, info: Fields, texture: Texture, places: tuple[int, ...]) -> F32:
        """(h, w, n) of the channels: colours where there are three, the alpha in the fourth place, else numbers."""
        if len(places) == 3:
            return texture.image
        if places == (3,):
            alpha = alpha_of(self._document, self._document.entry("textures", info.integer("index"), info, "index"))
            return np.ones((*texture.image.shape[:2], 1), np.float32) if alpha is None else alpha[..., :1]
        channel = 1 if places == (1,) else 0  # roughness is in the green, all else in the red
        return np.asarray(colour.srgb_encode(texture.image[..., channel : channel + 1]), np.float32)


def share(shape: Fields, name: str, default: float = 1.0) -> float:
    """A number from 0 to 1; raises InputError where it is not."""
    value = shape.number(name, default)
    if not 0 <= value <= 1:
        raise shape.fail(name, f"{value:g}", "it must be from 0 to 1")
    return value
