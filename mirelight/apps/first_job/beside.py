"""What lies beside a capture: a proxy that fits it, lights."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from mirelight.base import colour
from mirelight.base.errors import InputError, one_line, printable
from mirelight.io.suffixes import GLTF, MESHES
from mirelight.model import F64, ProxyMesh, SplatCloud

MOST_LIGHTS = 3  # files of lights that are taken, and lines on others
NO_LIGHT = "give sun, point, an .hdr or .exr panorama, or a glTF with lights"
_PANORAMAS = (".hdr", ".exr")
_MADE = "one is made in its place"
_POINTS = 5_000
_FEWEST = 10  # opaque splats, by which a fit can be told
_NEAR = 0.02  # of the capture's size: so near does its proxy lie to most splats
_MOST = 0.8
_SUN = 3.5  # lux that a light of a file is brought to at the capture's middle

LightKind = Literal["panorama", "glTF"]


@dataclass(frozen=True, slots=True)
class Proxy:
    """A mesh file that fits the splats."""

    path: Path
    turned: bool  # it lies in the splats' own axes, so that it takes their transform


@dataclass(frozen=True, slots=True)
class Misfit:
    """A file of a mesh, cameras or lights that was looked at and is not taken; its text is a line that says so."""

    path: Path
    why: str  # words that follow its name
    instead: str  # what is done without it

    def __str__(self) -> str:
        return f"{printable(self.path.name)} beside the capture {self.why}; {self.instead}."


@dataclass(frozen=True, slots=True)
class Lights:
    """A file of lights, and the factor that brings it to the capture's exposure."""

    path: Path
    kind: LightKind
    intensity: float


def proxy(capture: Path, cloud: SplatCloud, turn: F64) -> tuple[Proxy | None, Misfit | None]:
    """The first mesh beside a capture that fits it, and else the first that does not.

    Args:
        capture: the splat file.
        cloud: as the file has it.
        turn: (3, 3) rotation from its axes to the world.
    """
    from mirelight.io.mesh import read_mesh

    misfit: Misfit | None = None
    for path in _meshes(capture):
        try:
            mesh = read_mesh(path, textures=False)
        except InputError as refused:
            if path.stem.lower() != _stem(capture):  # of the same name may be the same splats in another format
                misfit = misfit or Misfit(path, why(refused), _MADE)
            continue
        fits = list[_Fit]()
        for turned, axes in ((False, turn), (True, np.eye(3))):
            fits.append(_fit(cloud, mesh, axes))
            if not fits[-1].why:
                return Proxy(path, turned and not np.allclose(turn, np.eye(3))), None
        misfit = misfit or Misfit(path, f"does not fit it: {max(fits, key=lambda x: x.near).why}", _MADE)
    return None, misfit


def lights(capture: Path, middle: F64, taken: Path | None) -> tuple[tuple[Lights, ...], tuple[Misfit, ...]]:
    """Files of lights beside a capture, and the first of those that cannot be used.

    Args:
        capture: the splat file.
        middle: (3,) of the capture, in the world.
        taken: the proxy's file, whose lights are left alone.
    """
    found, misfits = list[Lights](), list[Misfit]()
    meshes = _meshes(capture)  # by their names, of which :func:`proxy` tells
    for path in sorted(capture.parent.iterdir()):
        if len(found) == MOST_LIGHTS:
            break
        if path in (capture, taken) or path.name.startswith("."):
            continue
        try:
            one = of_file(path, middle)
        except InputError as refused:
            needs_more = refused.field == "extensionsRequired"  # splats or a mesh, and sound
            if path not in meshes and not needs_more and len(misfits) < MOST_LIGHTS:
                misfits.append(Misfit(path, why(refused), "no light is taken from it"))
            continue
        if one is not None:
            found.append(one)
    return tuple(found), tuple(misfits)


def of_file(path: Path, middle: F64) -> Lights | None:
    """A file's light, brought to about the exposure of the capture; None where there is none in it.

    Raises:
        InputError: it cannot be read, or is a picture of another shape than a panorama's.
    """
    suffix = path.suffix.lower()
    if suffix in _PANORAMAS:
        from mirelight.io.environment import read_environment

        picture = read_environment(path)
        height, width = picture.shape[:2]
        if width != 2 * height:
            found = f"{width} x {height} pixels, and a panorama is twice as wide as high"
            raise InputError(path, found, NO_LIGHT)
        rows = np.sin((np.arange(len(picture)) + 0.5) / len(picture) * np.pi)
        mean = float(np.average(colour.luminance(picture).mean(axis=1), weights=rows))
        return Lights(path, "panorama", 1 / mean) if mean > 0 else None
    if suffix in GLTF:
        from mirelight.io.gltf.scene import read_lights
        from mirelight.model.light_classes import punctual

        total = 0.0
        for light in map(punctual, read_lights(path)):
            strength = light.intensity * float(colour.luminance(np.asarray(light.color)))
            if light.place is not None:
                strength /= max(float(np.sum((light.place - middle) ** 2)), 1e-12)
            total += strength
        return Lights(path, "glTF", _SUN / total) if total > 0 else None
    return None


def _meshes(capture: Path) -> list[Path]:
    """Files that may be the proxy, the likeliest first."""
    stem = _stem(capture)
    names = [f"{stem}.proxy", "proxy", f"{stem}.mesh", "mesh", stem]
    there = [p for p in sorted(capture.parent.iterdir()) if p.suffix.lower() in MESHES and p != capture]
    return [p for name in names for p in there if p.stem.lower() == name]


def why(refused: InputError) -> str:
    """Words for a :class:`Misfit` of a file that was refused."""
    return one_line(f"cannot be used: {refused.field and f'{refused.field}: '}{refused.found}")


def _stem(capture: Path) -> str:
    return capture.name.split(".")[0].lower()


@dataclass(frozen=True, slots=True)
class _Fit:
    """How a mesh lies to the splats."""

    near: float  # share of the splats that lie near it
    why: str  # why it does not fit; empty where it does


def _fit(cloud: SplatCloud, mesh: ProxyMesh, turn: F64) -> _Fit:
    """Whether most splats lie near a mesh, and the mesh near the splats."""
    from scipy.spatial import cKDTree

    from mirelight.proxy.sampling import spread

    solid = cloud.means[cloud.opaque].astype(np.float64)
    if len(solid) < _FEWEST:
        return _Fit(0.0, f"too few splats show to tell ({len(solid)})")
    means = solid[:: max(1, len(solid) // _POINTS)] @ turn.T
    low, high = np.quantile(means, [0.01, 0.99], axis=0)
    size = float(np.linalg.norm(high - low))
    points = spread(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64), 4 * _POINTS)
    there, back = cKDTree(points).query(means)[0], cKDTree(means).query(points)[0]
    near, met = float((there < _NEAR * size).mean()), float((back < 2 * _NEAR * size).mean())
    if not near > _MOST:
        away = f"{1 - near:.0%} of the splats lie off it, half of all {np.median(there):.3g} units and more"
        return _Fit(near, f"{away} (`mirelight proxy --fit` can register it)")
    return _Fit(near, "" if met > _MOST / 2 else f"{1 - met:.0%} of it has no splats near")
