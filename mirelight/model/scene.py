"""What is rendered: splats, proxy mesh, materials."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour, primaries
from mirelight.model import shown
from mirelight.model.arrays import F32, F64, I32, ArrayHolder, freeze

_COARSEST = 1e-4  # of a capture's size: the step between its numbers (at 2e-4 frames still agree to 70 dB, at 2e-2 40)
_SAMPLE = 20_000  # splats that are looked at
# As KHR_gaussian_splatting has them, and the log encoding of ACES, for which no format of splats has a word.
SplatColorSpace: TypeAlias = Literal["srgb_rec709_display", "lin_rec709_display", "ACEScct"]
SplatWorld: TypeAlias = Literal["capture", "nerfstudio", "gsplat"]  # of the pictures' cameras, or as a trainer moved it
_OPAQUE = 0.3  # opacity from which a splat tells where a surface is
SOLID = 0.02  # opacity below which a splat shows too little to be part of a surface


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SplatCloud(ArrayHolder):
    """Gaussian splats in world space, activated (no logs or logits). N splats, K = (SH degree + 1)^2."""

    means: F32  # (N, 3) world units
    quats: F32  # (N, 4) wxyz, unit
    scales: F32  # (N, 3) linear standard deviations, world units
    opacities: F32  # (N,) 0..1
    sh: F32  # (N, K, 3) coefficients of colour in the colour space; colour = 0.5 + sum sh Y
    dropped: int = 0  # splats left out on reading because a value was NaN, infinite or absurdly large
    antialiased: bool = False  # trained with opacity compensation (SPZ flag, Mip-Splatting)
    color_space: SplatColorSpace = "srgb_rec709_display"  # that splats were trained in, and blend in

    def __post_init__(self) -> None:
        n = len(self.means)
        freeze(self, "means", (n, 3))
        freeze(self, "quats", (n, 4))
        freeze(self, "scales", (n, 3))
        freeze(self, "opacities", (n,))
        freeze(self, "sh", (n, None, 3))
        if self.sh.shape[1] not in (1, 4, 9, 16):
            raise ValueError(f"SplatCloud.sh: {self.sh.shape[1]} coefficients, expected 1, 4, 9 or 16")

    def __len__(self) -> int:
        return len(self.means)

    def __repr__(self) -> str:
        corners = f", {shown.point(self.means.min(0))} to {shown.point(self.means.max(0))}" if len(self) else ""
        return f"SplatCloud({len(self):,} splats, SH degree {self.sh_degree}{corners})"

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0 to 3."""
        return round(float(self.sh.shape[1] ** 0.5)) - 1

    @property
    def opaque(self) -> NDArray[np.bool_]:
        """(N,) which splats tell where surfaces are: those that are no haze."""
        return np.asarray(self.opacities > _OPAQUE)

    def light(self, shown: F32) -> F32:
        """(..., 3) linear light of colours (..., 3) in the splats' space."""
        if is_log(self.color_space):
            return np.maximum(primaries.acescct_decoded(shown), np.float32(0))
        return shown if holds_light(self.color_space) else colour.srgb_decode(shown)

    def colors_of(self, light: F32) -> F32:
        """(..., 3) colours in the splats' space of linear light (..., 3), the inverse of :meth:`light`."""
        if is_log(self.color_space):
            return primaries.acescct_encoded(light)
        return light if holds_light(self.color_space) else colour.srgb_encode(light)

    @property
    def too_far(self) -> str:
        """Why single precision is too coarse where the splats lie, in words that follow "it"; empty where it is not."""
        means = self.means[:: max(1, len(self) // _SAMPLE)].astype(np.float64)
        if not len(means):
            return ""
        low, high = np.quantile(means, [0.01, 0.99], axis=0)
        return _too_far(low, high)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SplatFile(ArrayHolder):
    """One of the files that a cloud is read from."""

    path: Path
    world_from_file: F64 = field(default_factory=lambda: np.eye(4))  # (4, 4) similarity
    lod: int | None = None  # level of detail, where the format has several
    color_space: SplatColorSpace | None = None  # of its splats, where somebody knows better than the file

    def __post_init__(self) -> None:
        freeze(self, "world_from_file", (4, 4), np.float64)


Wrap: TypeAlias = Literal["repeat", "mirror", "clamp"]  # what a texture shows outside 0..1
Wraps: TypeAlias = tuple[Wrap, Wrap]  # along u and v


MIRROR = "mirror"  # name of the material of mirrors


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Material(ArrayHolder):
    """What a proxy's own file says of its surface. It glows always; its base colour is used where the albedo comes from
    the file; all else where it is an inserted object's. Textures are (h, w, 3) linear, row 0 at v = 0 (glTF: top)."""

    name: str = "default"
    base_color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear factor
    base_color_texture: F32 | None = None  # multiplies base_color
    base_color_wrap: Wraps = ("repeat", "repeat")
    emissive: F64 = field(default_factory=lambda: np.zeros(3))  # (3,) linear radiance, strength multiplied in
    emissive_texture: F32 | None = None  # multiplies emissive
    emissive_wrap: Wraps = ("repeat", "repeat")
    metallic: float = 0.0  # 0 a dielectric of an index of refraction of 1.5, 1 a metal
    roughness: float = 1.0  # 0 a mirror
    finish_texture: F32 | None = None  # multiplies roughness by its green, metallic by its blue
    finish_wrap: Wraps = ("repeat", "repeat")
    normal_texture: F32 | None = None  # 2 x - 1 is a normal: along u, against v, outwards
    normal_wrap: Wraps = ("repeat", "repeat")
    normal_scale: float = 1.0  # of the first two
    specular: F64 = field(default_factory=lambda: np.full(3, 0.04))  # (3,) reflectance of what is no metal, from above
    specular_weight: float = 1.0  # and at grazing angles; `specular` has it multiplied in
    specular_texture: F32 | None = None  # (h, w, 4): multiplies the first by all, the second by its alpha
    specular_wrap: Wraps = ("repeat", "repeat")
    clearcoat: float = 0.0  # strength of a coat of lacquer
    clearcoat_roughness: float = 0.0
    transmission: float = 0.0  # share of what is neither reflected nor metal that goes straight on, tinted
    layer_texture: F32 | None = None  # multiplies lacquer, its roughness and transmission by red, green and blue
    layer_wrap: Wraps = ("repeat", "repeat")
    alpha: float = 1.0  # how much of it is there
    alpha_texture: F32 | None = None  # multiplies it
    ignored: tuple[str, ...] = ()  # what its file says of it that is not followed
    cutoff: float | None = None  # alpha below which nothing is there, and above which all; None: as much as alpha says

    def __post_init__(self) -> None:
        freeze(self, "base_color", (3,), np.float64)
        freeze(self, "base_color_texture", (None, None, 3))
        freeze(self, "emissive_texture", (None, None, 3))
        for name in ("finish_texture", "normal_texture", "alpha_texture", "layer_texture"):
            freeze(self, name, (None, None, 3))
        freeze(self, "specular_texture", (None, None, 4))
        freeze(self, "specular", (3,), np.float64)
        freeze(self, "emissive", (3,), np.float64)

    @property
    def is_mirror(self) -> bool:
        """Whether it is a mirror that the capture shows: a smooth metal of that name. Splats show what it mirrors as if
        that lay behind it; in lobes, which have no colours of their own, it has no part."""
        return self.name == MIRROR and self.metallic == 1 and self.roughness == 0

    def __repr__(self) -> str:
        maps = {"base colour": self.base_color_texture, "emissive": self.emissive_texture}
        textures = [f"{name} texture {x.shape[1]} x {x.shape[0]}" for name, x in maps.items() if x is not None]
        factors = f"base colour {shown.point(self.base_color)}, emissive {shown.point(self.emissive)}"
        return f"Material({', '.join([repr(self.name), factors, *textures])})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProxyMesh(ArrayHolder):
    """The triangle mesh that stands for the captured scene, in world space. Lit from both sides."""

    vertices: F32  # (V, 3) world units
    faces: I32  # (F, 3) indices into vertices
    normals: F32 | None = None  # (V, 3) unit shading normals; None: flat
    uvs: F32 | None = None  # (V, 2) glTF: v = 0 is the texture's top row
    vertex_colors: F32 | None = None  # (V, 3) linear
    face_materials: I32 | None = None  # (F,) index into materials; None: all 0
    materials: tuple[Material, ...] = (Material(),)
    face_nodes: I32 | None = None  # (F,) index into nodes; None: all 0
    nodes: tuple[str, ...] = ("proxy",)  # names of the file's objects, where it has some
    albedo: F64 | None = field(default_factory=lambda: np.full(3, 0.5))  # (3,) linear; None: the file's own colours

    def __post_init__(self) -> None:
        v = len(self.vertices)
        freeze(self, "vertices", (v, 3))
        freeze(self, "faces", (None, 3), np.int32)
        for name, width in (("normals", 3), ("uvs", 2), ("vertex_colors", 3)):
            freeze(self, name, (v, width))
        freeze(self, "face_materials", (len(self.faces),), np.int32)
        freeze(self, "face_nodes", (len(self.faces),), np.int32)
        freeze(self, "albedo", (3,), np.float64)
        if len(self.faces) and not (int(self.faces.min()) >= 0 and int(self.faces.max()) < v):
            raise ValueError(f"ProxyMesh.faces: an index outside 0..{v - 1}")

    @property
    def mirrors(self) -> NDArray[np.bool_] | None:
        """(F,) which faces are a capture's mirrors; None: none are."""
        kinds = np.array([x.is_mirror for x in self.materials])
        if not kinds.any():
            return None
        found: NDArray[np.bool_] = kinds[self.owners]
        return found if found.any() else None

    def with_mirrors(self, faces: NDArray[np.bool_]) -> ProxyMesh:
        """The same with faces (F,) that mirror, where there are any."""
        if not faces.any():
            return self
        mirror = Material(name=MIRROR, metallic=1.0, roughness=0.0)
        owners = np.where(faces, len(self.materials), self.owners).astype(np.int32)
        return replace(self, materials=(*self.materials, mirror), face_materials=owners)

    @property
    def owners(self) -> I32:
        """(F,) index of each face's material."""
        return np.zeros(len(self.faces), np.int32) if self.face_materials is None else self.face_materials

    def __repr__(self) -> str:
        corners = f", {' to '.join(map(shown.point, self.bounds))}" if len(self.vertices) else ""
        albedo = "the file's colours" if self.albedo is None else f"albedo {shown.point(self.albedo)}"
        return f"ProxyMesh({len(self.faces):,} faces, {len(self.vertices):,} vertices, {albedo}{corners})"

    @property
    def too_far(self) -> str:
        """As :attr:`SplatCloud.too_far`; a mesh has no strays, so its bounds tell."""
        if not len(self.vertices):
            return ""
        low, high = self.bounds
        return _too_far(low.astype(np.float64), high.astype(np.float64))

    @property
    def bounds(self) -> tuple[F32, F32]:
        """Lowest and highest corner, (3,) each."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    def turned(self, turn: F64, vertices: F64) -> ProxyMesh:
        """With vertices (V, 3) elsewhere, where a rotation (3, 3) brought them: normals are turned along."""
        normals = None if self.normals is None else (self.normals @ turn.T).astype(np.float32)
        return replace(self, vertices=vertices.astype(np.float32), normals=normals)


def holds_light(space: SplatColorSpace) -> bool:
    """Whether composites of splats in a space are linear light, as they blend in it or are decoded then."""
    return space != "srgb_rec709_display"


def is_log(space: SplatColorSpace) -> bool:
    """Whether colours in a space are logarithms of light, which blend as they are and are decoded then."""
    return space == "ACEScct"


def _too_far(low: F64, high: F64) -> str:
    """Why single precision is too coarse in a box, in words that follow "it"; empty where it is not."""
    size, far = float(np.linalg.norm(high - low)), float(np.abs((low + high) / 2).max())
    if not 0 < _COARSEST * size < float(np.spacing(np.float32(far))):
        return ""
    return f"lies {far:.3g} units from the origin and is {size:.3g} in size: single precision is too coarse there"
