"""One frame as data sets hold it: its pictures are made when they are asked for."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour, conventions
from mirelight.base.conventions import Matrix
from mirelight.base.errors import InputError
from mirelight.base.names import FreeNames
from mirelight.dataset.layouts.world import scale_of
from mirelight.io.cameras.colmap_write import Points
from mirelight.io.cameras.reading import FLIP
from mirelight.io.cameras.transforms import Z_UP
from mirelight.io.png import encode_straight
from mirelight.io.views import curve_of
from mirelight.model import F32, Camera, DisplaySettings
from mirelight.model.arrays import freeze
from mirelight.relighting.surroundings import Surroundings

Split: TypeAlias = Literal["train", "val", "test"]
Part: TypeAlias = Literal["seen", "novel_view", "novel_light", "novel_both"]
U8: TypeAlias = NDArray[np.uint8]

SPLITS: tuple[Split, ...] = ("train", "val", "test")
PARTS: tuple[Part, ...] = ("seen", "novel_view", "novel_light", "novel_both")
_MILLIMETRES = 1000.0  # in a world unit, which is a metre
_MOST = 65535  # steps of a 16-bit depth
SAME = 1e-6  # relative, of lenses


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Geometry:
    """What a camera sees of the proxy, in mirelight's world."""

    depth: F32  # (H, W) along the view axis; 0 where there is nothing
    coverage: F32  # (H, W) 0 to 1
    normal: F32  # (H, W, 3) unit
    albedo: F32  # (H, W, 3) linear

    def __post_init__(self) -> None:
        size = self.depth.shape
        for name in ("depth", "coverage"):
            freeze(self, name, size)
        for name in ("normal", "albedo"):
            freeze(self, name, (*size, 3))


class Pixels:
    """The pixels of a frame, made when they are asked for and kept as long as this is.

    Args:
        mixed: gives (H, W, 4) linear, premultiplied.
        geometry: gives what the camera sees; None: it is not known at the frame's size.
        display: exposure and tone curve of 8-bit pictures.
        shares: gives (n, H, W) how much of each pixel inserted objects are seen to cover; None: there are none.
        shadow: gives (H, W, 3) what they do to the light beside them; None: it is not known.
    """

    def __init__(
        self,
        mixed: Callable[[], F32],
        geometry: Callable[[], Geometry] | None = None,
        display: DisplaySettings | None = None,
        shares: Callable[[], F32] | None = None,
        shadow: Callable[[], F32 | None] | None = None,
    ) -> None:
        self._mixed, self._geometry, self._display, self._shares = mixed, geometry, display, shares
        self._shadow = shadow

    @cached_property
    def linear(self) -> F32:
        """(H, W, 4) linear, premultiplied, whatever the exposure."""
        return self._mixed()

    @cached_property
    def straight(self) -> F32:
        """(H, W, 4) linear, not multiplied by alpha; black where alpha is 0."""
        alpha = self.linear[..., 3]
        return np.concatenate([colour.straight(self.linear[..., :3], alpha), alpha[..., None]], axis=-1)

    @cached_property
    def rgba(self) -> U8:
        """(H, W, 4) sRGB, straight alpha."""
        return encode_straight(self.linear, self._display or DisplaySettings())

    @cached_property
    def rgb(self) -> U8:
        """(H, W, 3) sRGB over black."""
        light = self.linear[..., :3] * np.float32(2.0**self._stops)
        view = curve_of(self._display) if self._display else None
        return _bytes(colour.displayed(light, "srgb", self._tone, view))

    @property
    def alpha(self) -> U8:
        """(H, W) the alpha of the picture."""
        return _bytes(self.linear[..., 3])

    @property
    def mask(self) -> U8:
        """(H, W) 255 where alpha is above a half, else 0."""
        return np.where(self.linear[..., 3] > 0.5, 255, 0).astype(np.uint8)

    @cached_property
    def geometry(self) -> Geometry:
        """What the camera sees; only where `has_geometry`."""
        assert self._geometry is not None
        return self._geometry()

    @property
    def shares(self) -> F32:
        """(n, H, W) how much of each pixel inserted objects are seen to cover."""
        return np.zeros((0, *self.linear.shape[:2]), np.float32) if self._shares is None else self._shares()

    @property
    def shadow(self) -> F32 | None:
        """(H, W, 3) light beside inserted objects over the same without them; None where that is not known."""
        return None if self._shadow is None else self._shadow()

    def forget(self) -> None:
        """Let go of what was made."""
        for name in ("linear", "straight", "rgba", "rgb", "geometry"):
            self.__dict__.pop(name, None)

    @property
    def has_geometry(self) -> bool:
        """Whether depth and normals of the view are known."""
        return self._geometry is not None

    @property
    def _stops(self) -> float:
        return self._display.exposure if self._display else 0.0

    @property
    def _tone(self) -> Literal["none", "aces", "neutral", "agx"]:
        return self._display.tone if self._display else "none"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """One frame of a data set."""

    camera: Camera  # in mirelight's world
    view: str  # a file name of the camera, another one for each
    lighting: str = ""  # a file name of the lighting; "": the set has one, without a folder of its own
    number: int = 0  # of the camera in its job
    part: Part = "seen"
    key: str = ""  # digest of what the pixels are made from; "": unknown
    view_key: str = ""  # the same of geometry and mask
    objects: tuple[Labelled, ...] = ()  # that stand in the capture, in the order of the pixels' shares
    arrangement: int | None = None  # number of how they stand; None: they do so in all pictures
    pixels: Pixels

    @property
    def split(self) -> Split:
        """Where it goes in a layout that knows no more: to train on, or to test with."""
        return "train" if self.part == "seen" else "test"

    @property
    def within(self) -> str:
        """The folder of its lighting, with "/"."""
        return f"{self.lighting}/" if self.lighting else ""

    @property
    def out(self) -> str:
        """From that folder to the data set's, with "/"."""
        return "../" if self.lighting else ""


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """A point light in the data set's world."""

    position: Matrix  # (3,)
    candela: Matrix  # (3,) linear


@dataclass(frozen=True, slots=True, eq=False)
class Labelled:
    """An inserted object, which detectors are to find."""

    name: str
    category: str
    box: Matrix  # (4, 4) mirelight's world from the cube of side 1 about 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Shared:
    """What all pictures of a data set have in common."""

    name: str = "set"  # a file name of it
    source: Path = Path("set")  # that what cannot be held is said of
    world: Matrix = field(default_factory=lambda: Z_UP)  # from mirelight's world (Y up) to the data set's
    points: Points | None = None  # in mirelight's world; what trainers start from
    surroundings: Mapping[str, Surroundings] = field(default_factory=dict)  # by a lighting's file name
    lamps: Mapping[str, Lamp] = field(default_factory=dict)  # by it, where one point or spot light is all there is
    near_far: tuple[float, float] | None = None  # depths of all that cameras see, in the data set's world
    training: str = ""  # file name of the first lighting that is not held out
    exposure: float = 0.0  # stops, of 8-bit pictures
    hdr: bool = True  # linear pictures, too, where loaders take them
    spp: int = 0  # of the traced light
    objects: tuple[str, ...] = ()  # names of all that are put into the capture

    @property
    def scale(self) -> float:
        """How the world scales lengths."""
        return scale_of(self.world)

    def depth(self, pixels: Pixels) -> F32:
        """(H, W) along the view axis, the data set's units; 0 where there is nothing."""
        return np.asarray(pixels.geometry.depth * np.float32(self.scale), dtype=np.float32)

    def normal(self, pixels: Pixels) -> F32:
        """(H, W, 3) unit, in the data set's world."""
        turn = (self.world[:3, :3] / self.scale).T.astype(np.float32)
        return np.asarray(pixels.geometry.normal @ turn, dtype=np.float32)


def opencv_pose(camera: Camera, world: Matrix) -> Matrix:
    """(4, 4) rigid, of a camera in a data set's world (4, 4): +Z ahead and +Y down, as OpenCV has them."""
    return np.asarray(conventions.rigid_part(world @ camera.world_from_camera) @ FLIP)


def millimetres(depth: F32) -> NDArray[np.uint16]:
    """(H, W) depth in millimetres; 0, which loaders take as unknown, where there is none and beyond 65.5 m."""
    return depth_steps(depth, _MILLIMETRES)


def depth_steps(depth: F32, per_unit: float) -> NDArray[np.uint16]:
    """(H, W) depth in steps, so many to a unit of the world; 0 where there is none and beyond 65535 steps."""
    steps = np.rint(np.nan_to_num(depth, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float64) * per_unit)
    return np.where((steps > 0) & (steps <= _MOST), steps, 0).astype(np.uint16)


def with_alpha(colors: F32, coverage: F32) -> U8:
    """(H, W, 4) values 0 to 1 as 8 bits, with what the proxy covers as alpha."""
    return _bytes(np.concatenate([colors, coverage[..., None]], axis=-1))


def file_names(names: Sequence[str], empty: str) -> dict[str, str]:
    """By each name a different one of letters, digits, "-" and "_", also where a file system tells no capitals."""
    out, free = dict[str, str](), FreeNames()
    for name in names:
        stem = re.sub(r"[^A-Za-z0-9-]+", "_", name).strip("_") or empty
        out[name] = stem + free.take(stem.casefold())[len(stem) :]
    return out


def check_lenses(cameras: Sequence[Camera], shared: Shared, *, square: bool = False) -> None:
    """Refuse what a layout with one angle of view cannot say.

    Args:
        cameras: of the set.
        shared: what the set's pictures have in common.
        square: the layout's loaders know square pictures alone.

    Raises:
        InputError: names the first such camera, and in what it differs.
    """
    remedy = "the layout has one centred angle of view; render such cameras apart, or use the layout colmap"
    for camera in cameras:
        first = cameras[0]
        if camera.cx != camera.width / 2 or camera.cy != camera.height / 2:
            found = "has its principal point off the middle"
        elif abs(camera.fx - camera.fy) > SAME * camera.fx:
            found = "has different focal lengths along x and y"
        elif square and camera.width != camera.height:
            found = f"is {camera.width} x {camera.height} pixels, and the layout's loaders take square ones alone"
            remedy = "render them with resolution = [512, 512], or any other square, or use the layout colmap"
        elif (
            abs(camera.fx * first.width - first.fx * camera.width) > SAME * first.fx * camera.width
            or camera.width * first.height != camera.height * first.width
        ):
            found = f"has another field of view than {first.name!r}"
        else:
            continue
        raise InputError(shared.source, f"camera {camera.name!r} {found}", remedy)


def _bytes(values: F32) -> U8:
    clean = np.clip(np.nan_to_num(values, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    return np.asarray(np.rint(clean * np.float32(255)), dtype=np.uint8)
