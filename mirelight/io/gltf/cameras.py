"""Cameras of a glTF file (glTF §3.10)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from mirelight.base import conventions
from mirelight.io.gltf.document import Document
from mirelight.io.gltf.fields import Fields
from mirelight.io.gltf.names import unique_names
from mirelight.io.gltf.nodes import Matrix, Node
from mirelight.model import Camera


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GltfCamera:
    """A camera as the file has it, placed; a job adds the image size."""

    name: str
    node: int  # index of the node that carries it
    projection: Literal["perspective", "orthographic"]
    world: Matrix  # (4, 4) world_from_camera, with whatever scale the hierarchy has
    aspect: float | None  # width / height that the file asks for; None: it does not say
    yfov: float | None  # rad, perspective only
    ymag: float | None  # world units, half of the view's height, orthographic only
    znear: float  # world units
    zfar: float  # world units; inf where the file gives none

    @property
    def shutter(self) -> tuple[float, float]:
        """glTF has none: (0, 0)."""
        return 0.0, 0.0

    def to_camera(self, width: int, height: int, world: Matrix | None = None) -> Camera:
        """The camera on a pixel grid.

        The vertical extent is kept and pixels are square, as three.js and PlayCanvas do; `aspect` says which image
        shape shows what the author framed. Scale in the hierarchy is ignored (glTF §3.10.1).

        Args:
            width: px.
            height: px.
            world: another pose (4, 4), e.g. of an animation.

        Raises:
            ValueError: an image without pixels.
        """
        pose = conventions.rigid_part(self.world if world is None else world)
        near = max(self.znear, 1e-6)  # an orthographic znear may be 0
        if self.yfov is not None:
            scale = height / (2 * math.tan(self.yfov / 2))
        else:
            assert self.ymag is not None
            scale = height / (2 * self.ymag)
        return Camera(
            name=self.name,
            world_from_camera=pose,
            width=width,
            height=height,
            fx=scale,
            fy=scale,
            cx=width / 2,
            cy=height / 2,
            projection=self.projection,
            near=near,
            far=self.zfar,
        )


def read_node_cameras(document: Document, nodes: Iterable[Node]) -> tuple[GltfCamera, ...]:
    """The cameras of the placed nodes, in node order; names are the node's, else the camera's, made unique.

    Raises:
        InputError: a value outside the specification, with its field.
    """
    found = [
        (node, document.entry("cameras", node.fields.integer("camera"), node.fields, "camera"))
        for node in nodes
        if "camera" in node.fields
    ]
    names = unique_names([(camera.text("name", ""), node.name, "camera") for node, camera in found])
    return tuple(_camera(camera, node, name) for (node, camera), name in zip(found, names, strict=True))


def _camera(camera: Fields, node: Node, name: str) -> GltfCamera:
    try:
        conventions.rigid_part(node.world)
    except ValueError:
        raise node.fields.fail("", "a camera on a node scaled to zero", "give it a scale") from None
    kind = camera.text("type")
    if kind == "perspective":
        view = camera.child("perspective")
        yfov = _positive(view, "yfov")
        if yfov >= math.pi:
            raise view.fail("yfov", f"{yfov:g}", "it must be below pi (radians)")
        aspect = _positive(view, "aspectRatio") if "aspectRatio" in view else None
        ymag, near = None, _positive(view, "znear")
    elif kind == "orthographic":
        view = camera.child("orthographic")
        ymag = _positive(view, "ymag")
        aspect = _positive(view, "xmag") / ymag
        yfov, near = None, view.number("znear")
        if near < 0:
            raise view.fail("znear", f"{near:g}", "it must not be negative")
        view.number("zfar")
    else:
        raise camera.fail("type", f"{kind[:40]!r}", "expected perspective or orthographic")
    far = view.number("zfar", math.inf)
    if far <= max(near, 1e-6):
        raise view.fail("zfar", f"{far:g}", f"it must be above znear {near:g}")
    return GltfCamera(
        name=name,
        node=node.index,
        projection="perspective" if kind == "perspective" else "orthographic",
        world=node.world,
        aspect=aspect,
        yfov=yfov,
        ymag=ymag,
        znear=near,
        zfar=far,
    )


def _positive(fields: Fields, name: str) -> float:
    value = fields.number(name)
    if value <= 0:
        raise fields.fail(name, f"{value:g}", "it must be positive")
    return value
