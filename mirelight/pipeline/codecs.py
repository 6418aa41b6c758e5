"""Kinds of artefacts: how each is told in named arrays, and where it belongs. NumPy only."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from mirelight.model import (
    Camera,
    CellLight,
    Light,
    LightingBuffer,
    LightLayer,
    Matte,
    Profile,
    ProxyMesh,
    SplatLayer,
    SurfaceCells,
    SurfaceTransport,
)
from mirelight.model.planes import OBJECT_MATTE

if TYPE_CHECKING:
    from mirelight.estimate import Estimate

T = TypeVar("T")
Place: TypeAlias = Literal["scene", "surface", "view"]  # what an artefact is made for

_OBJECTS = "objects."  # before the names of arrays of what inserted objects show
_TRUST = "confidence."  # and of those of what speaks for an estimate
_KINDS = ("lights", "environment", "emission")  # of `CellLight`


@dataclass(frozen=True, slots=True, eq=False)
class Packed:
    """An artefact as named arrays, and what is said about them."""

    arrays: Mapping[str, NDArray[Any]]
    about: Mapping[str, Any] = field(default_factory=dict)  # JSON values

    @property
    def nbytes(self) -> int:
        """Size of all arrays in bytes."""
        return sum(x.nbytes for x in self.arrays.values())


@dataclass(frozen=True, slots=True, eq=False)
class Codec(Generic[T]):
    """One kind of artefact. `unpack` may raise anything where the arrays are no such thing."""

    place: Place
    pack: Callable[[T], Packed]
    unpack: Callable[[Packed], T]


# --- of a scene ------------------------------------------------------------------------------------------------------


ARRAY: Codec[NDArray[Any]] = Codec("scene", lambda x: Packed({"values": x}), lambda packed: packed.arrays["values"])


def _pack_mesh(mesh: ProxyMesh) -> Packed:
    mirrors = mesh.mirrors
    return Packed({"vertices": mesh.vertices, "faces": mesh.faces} | ({} if mirrors is None else {"mirrors": mirrors}))


def _unpack_mesh(packed: Packed) -> ProxyMesh:
    mesh = ProxyMesh(vertices=packed.arrays["vertices"], faces=packed.arrays["faces"])
    return mesh.with_mirrors(packed.arrays["mirrors"]) if "mirrors" in packed.arrays else mesh


MESH: Codec[ProxyMesh] = Codec("scene", _pack_mesh, _unpack_mesh)  # vertices, faces and which mirror, and no more


def _pack_cameras(cameras: tuple[Camera, ...]) -> Packed:
    poses = np.array([x.world_from_camera for x in cameras], np.float64).reshape(-1, 4, 4)
    lenses = [(x.width, x.height, x.fx, x.fy, x.cx, x.cy, x.near) for x in cameras]
    return Packed({"poses": poses, "lenses": np.array(lenses, np.float64).reshape(-1, 7)})


def cameras_named(name: str) -> Codec[tuple[Camera, ...]]:
    """Pinholes that see endlessly far, called by that name and their number."""

    def unpack(packed: Packed) -> tuple[Camera, ...]:
        both = zip(packed.arrays["poses"], packed.arrays["lenses"].tolist(), strict=True)
        return tuple(_pinhole(pose, lens, f"{name}-{i}") for i, (pose, lens) in enumerate(both))

    return Codec("scene", _pack_cameras, unpack)


def _pinhole(pose: NDArray[Any], lens: list[float], name: str) -> Camera:
    width, height, fx, fy, cx, cy, near = lens
    return Camera(
        name=name, world_from_camera=pose, width=int(width), height=int(height), fx=fx, fy=fy, cx=cx, cy=cy, near=near
    )


def array_of(shape: Sequence[int]) -> Codec[NDArray[Any]]:
    """An array of one shape."""

    def unpack(packed: Packed) -> NDArray[Any]:
        values = ARRAY.unpack(packed)
        if values.shape != tuple(shape):
            raise ValueError(f"values of shape {values.shape}")
        return values

    return replace(ARRAY, unpack=unpack)


def estimate_of(lights: Sequence[Light]) -> Codec[Estimate]:
    """An estimate of captured light, and all that speaks for it; of the lights that it was given what was found."""

    def pack(found: Estimate) -> Packed:
        named = np.array([[*x.color, x.intensity] for x in found.named], np.float64).reshape(-1, 4)
        own = {x: np.asarray(getattr(found, x)) for x in ("to_sun", "sun", "sun_diameter", "lamps", "radiance")}
        trust = {_TRUST + f.name: np.asarray(getattr(found.confidence, f.name)) for f in fields(found.confidence)}
        return Packed({**own, **trust, "named": named})

    def unpack(packed: Packed) -> Estimate:
        from mirelight.estimate import Confidence, Estimate

        own = dict(packed.arrays)
        trust: dict[str, Any] = {x.removeprefix(_TRUST): own.pop(x).tolist() for x in list(own) if x.startswith(_TRUST)}
        trust = {name: tuple(x) if isinstance(x, list) else x for name, x in trust.items()}
        both = zip(lights, own.pop("named").tolist(), strict=True)
        named = tuple(replace(light, color=np.array(rgb), intensity=strength) for light, (*rgb, strength) in both)
        diameter = float(own.pop("sun_diameter"))
        return Estimate(sun_diameter=diameter, named=named, confidence=Confidence(**trust), **own)

    return Codec("scene", pack, unpack)


# --- of a surface ----------------------------------------------------------------------------------------------------

CELLS: Codec[SurfaceCells] = Codec(
    "surface",
    lambda cells: Packed(_own_arrays(cells), {"size": cells.size}),
    lambda packed: SurfaceCells(size=float(packed.about["size"]), **packed.arrays),
)


def transport_between(count: int) -> Codec[SurfaceTransport]:
    """How light goes between so many cells."""

    def unpack(packed: Packed) -> SurfaceTransport:
        made = SurfaceTransport(seed=int(packed.about["seed"]), **packed.arrays)
        if made.cells != count:
            raise ValueError("transport between other cells")
        return made

    return Codec("surface", lambda transport: Packed(_own_arrays(transport), {"seed": transport.seed}), unpack)


def lights_on(count: int) -> Codec[tuple[CellLight, ...]]:
    """Light on so many cells."""

    def pack(lights: tuple[CellLight, ...]) -> Packed:
        arrays = {f"{i}.{name}": x for i, light in enumerate(lights) for name, x in _own_arrays(light).items()}
        arrays["cells"] = np.array([count], np.int64)
        about = {"names": [x.name for x in lights], "kinds": [x.kind for x in lights], "rays": [x.rays for x in lights]}
        return Packed(arrays, about)

    def unpack(packed: Packed) -> tuple[CellLight, ...]:
        return tuple(_cell_light(packed, i, count) for i in range(len(packed.about["names"])))

    return Codec("surface", pack, unpack)


def _cell_light(packed: Packed, index: int, count: int) -> CellLight:
    kind = packed.about["kinds"][index]
    if kind not in _KINDS:
        raise ValueError(f"light of kind {kind}")
    names = [f.name for f in fields(CellLight) if f"{index}.{f.name}" in packed.arrays]
    arrays: dict[str, Any] = {"first_bounce": None} | {name: packed.arrays[f"{index}.{name}"] for name in names}
    made = CellLight(name=packed.about["names"][index], kind=kind, rays=int(packed.about["rays"][index]), **arrays)
    if made.direct.shape[1] != count or made.indirect.shape != made.direct.shape:
        raise ValueError("light on other cells")
    return made


# --- of a view -------------------------------------------------------------------------------------------------------


def light_of(camera: Camera) -> Codec[LightingBuffer]:
    """A traced buffer of the view of a camera, whatever that is called."""
    return Codec("view", _pack_buffer, lambda packed: _buffer(packed, camera))


def composite_of(camera: Camera, profile: Profile, linear: bool) -> Codec[SplatLayer]:
    """The splats as a camera sees them."""

    def unpack(packed: Packed) -> SplatLayer:
        return SplatLayer(camera=camera, profile=profile, linear=linear, **packed.arrays)

    return Codec("view", lambda splats: Packed(_own_arrays(splats)), unpack)


def matte_of(names: tuple[str, ...]) -> Codec[Matte]:
    """Which of the job's objects, by these names, a camera sees where."""

    def unpack(packed: Packed) -> Matte:
        return Matte(name=OBJECT_MATTE, names=names, index=packed.arrays["index"], share=packed.arrays["share"])

    return Codec("view", lambda matte: Packed(_own_arrays(matte)), unpack)


def _pack_buffer(buffer: LightingBuffer) -> Packed:
    """Every array of a buffer by its name: "depth", "layers.0.direct"."""
    arrays = _own_arrays(buffer)
    for group, layers in (("layers", buffer.layers), ("noisy", buffer.noisy)):
        for i, layer in enumerate(layers):
            values = {f.name: getattr(layer, f.name) for f in fields(layer)}
            arrays |= {f"{group}.{i}.{name}": x for name, x in values.items() if isinstance(x, np.ndarray)}
    about = {
        "spp": buffer.spp,
        "rays": buffer.cell_rays,
        "layers": [x.name for x in buffer.layers],
        "noisy": [x.name for x in buffer.noisy],
    }
    if buffer.objects is None:
        return Packed(arrays, about)
    objects = _pack_buffer(buffer.objects)
    arrays |= {f"{_OBJECTS}{name}": x for name, x in objects.arrays.items()}
    return Packed(arrays, {**about, "objects": objects.about})


def _buffer(packed: Packed, camera: Camera) -> LightingBuffer:
    there = packed.arrays

    def layer(group: str, index: int, name: str) -> LightLayer:
        names = [f.name for f in fields(LightLayer) if f"{group}.{index}.{f.name}" in there]
        return LightLayer(name=name, **{n: there[f"{group}.{index}.{n}"] for n in names})

    def layers(group: str) -> tuple[LightLayer, ...]:
        return tuple(layer(group, i, name) for i, name in enumerate(packed.about[group]))

    arrays: dict[str, Any] = {f.name: there[f.name] for f in fields(LightingBuffer) if f.name in there}
    objects = None
    if "objects" in packed.about:
        own = {name.removeprefix(_OBJECTS): x for name, x in there.items() if name.startswith(_OBJECTS)}
        objects = _buffer(Packed(own, packed.about["objects"]), camera)
    return LightingBuffer(
        camera=camera,
        spp=int(packed.about["spp"]),
        cell_rays=int(packed.about["rays"]),
        layers=layers("layers"),
        noisy=layers("noisy"),
        objects=objects,
        **arrays,
    )


def _own_arrays(
    of: LightingBuffer | SplatLayer | SurfaceCells | SurfaceTransport | CellLight | Matte,
) -> dict[str, NDArray[Any]]:
    return {f.name: x for f in fields(of) if isinstance(x := getattr(of, f.name), np.ndarray)}
