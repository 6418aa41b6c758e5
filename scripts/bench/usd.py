"""OpenUSD: what every light of UsdLux gives beside its documented closed form, and one panorama in four primaries.

    python scripts/bench usd

One stage holds every kind of light; their irradiance is traced at a point of a small card on their axis, facing them.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

import mirelight
from bench.common import Table, table
from mirelight.base.primaries import PRIMARIES, REC709, Chromaticities, converted
from mirelight.io.environment import read_environment
from mirelight.io.exr import CHROMATICITIES, write_exr
from mirelight.model import F32, Environment, Lighting, ProxyMesh, RenderSettings
from mirelight.pipeline.stages import frame

SCENE = Path(__file__).resolve().parents[2] / "scenes" / "courtyard"

HEAD = '#usda 1.0\n(\n    metersPerUnit = {unit}\n    upAxis = "{up}"\n)\n'
FAR = 3.0  # units from each light to what it lights, along its -Z
_COMMON = "float inputs:intensity = 2\nfloat inputs:exposure = 3\nfloat inputs:diffuse = 0.5\n"
LUMINANCE = 2 * 2**3 * 0.5  # cd/m²
_TUBE = "float inputs:length = 1.5\nfloat inputs:radius = 0.2"
_WARM = "float inputs:radius = 0.4\nbool inputs:enableColorTemperature = 1\nfloat inputs:colorTemperature = 3000"
_POWER = "\nbool inputs:normalize = 1"
_SHAPED = '(\nprepend apiSchemas = ["ShapingAPI"]\n)'


def light_prim(kind: str, name: str, body: str, api: str = "") -> str:
    return f'def {kind} "{name}" {api}\n{{\n{_COMMON}{body}\n}}\n'


STAGE = "".join(
    [
        light_prim("DistantLight", "sun", "float inputs:angle = 2"),
        light_prim("DistantLight", "sun_lux", "float inputs:angle = 2" + _POWER),
        light_prim("DistantLight", "parallel", "float inputs:angle = 0"),
        light_prim("SphereLight", "ball", "float inputs:radius = 0.4"),
        light_prim("SphereLight", "ball_power", "float inputs:radius = 0.4" + _POWER),
        light_prim("SphereLight", "dot", "float inputs:radius = 0.4\nbool treatAsPoint = 1"),
        light_prim("SphereLight", "dot_power", "float inputs:radius = 0\nbool treatAsPoint = 1" + _POWER),
        light_prim("DiskLight", "disk", "float inputs:radius = 0.7"),
        light_prim("DiskLight", "disk_power", "float inputs:radius = 0.7" + _POWER),
        light_prim("RectLight", "rect", "float inputs:width = 2\nfloat inputs:height = 1"),
        light_prim("RectLight", "rect_power", "float inputs:width = 2\nfloat inputs:height = 1" + _POWER),
        light_prim("CylinderLight", "tube", _TUBE),
        light_prim("CylinderLight", "tube_power", _TUBE + _POWER),
        light_prim("SphereLight", "cone", "float inputs:radius = 0.1\nfloat inputs:shaping:cone:angle = 20", _SHAPED),
        light_prim(
            "SphereLight",
            "soft",
            "float inputs:radius = 0.1\nfloat inputs:shaping:cone:angle = 40\nfloat inputs:shaping:cone:softness = 0.5",
            _SHAPED,
        ),
        light_prim("DiskLight", "focused", "float inputs:radius = 0.1\nfloat inputs:shaping:focus = 4", _SHAPED),
        light_prim("SphereLight", "warm", _WARM + "\nrel collection:lightLink:includes = </rect>"),
        light_prim("DomeLight", "dome", "color3f inputs:color = (1, 0.5, 0.25)"),
    ]
)


def closed_forms() -> Iterator[tuple[str, float]]:
    """Irradiance at `FAR` along -Z, by the light's name, in a stage's own units."""
    d = FAR
    half = math.radians(1)
    yield "sun", LUMINANCE * math.pi * math.sin(half) ** 2
    yield "sun_lux", LUMINANCE
    yield "parallel", LUMINANCE
    ball = math.pi * (0.4 / d) ** 2
    yield "ball", LUMINANCE * ball
    yield "ball_power", LUMINANCE / (4 * math.pi * 0.4**2) * ball
    yield "dot", LUMINANCE * ball
    yield "dot_power", LUMINANCE / 4 / d**2
    disk = math.pi * 0.7**2 / (0.7**2 + d**2)
    yield "disk", LUMINANCE * disk
    yield "disk_power", LUMINANCE / (math.pi * 0.7**2) * disk
    a, b = 1 / d, 0.5 / d
    p, q = math.hypot(1, a), math.hypot(1, b)
    rect = 2 * (a / p * math.atan(b / p) + b / q * math.atan(a / q))
    yield "rect", LUMINANCE * rect
    yield "rect_power", LUMINANCE / 2 * rect
    tube = _tube(1.5, 0.2, d)
    yield "tube", LUMINANCE * tube
    yield "tube_power", LUMINANCE / (2 * math.pi * 0.2 * 1.5) * tube
    yield "cone", LUMINANCE * math.pi * (0.1 / d) ** 2
    yield "soft", LUMINANCE * math.pi * (0.1 / d) ** 2
    yield "focused", LUMINANCE * math.pi * 0.1**2 / d**2


def _tube(length: float, radius: float, far: float) -> float:
    """Projected solid angle of a cylinder's side from beside its middle, by quadrature over what is seen of it."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    edge = math.acos(radius / far)
    phi, x = nodes[:, None] * edge, nodes * length / 2
    across, toward = radius * np.sin(phi), far - radius * np.cos(phi)
    square = x**2 + across**2 + toward**2
    leaving = toward * np.cos(phi) - across * np.sin(phi)
    area = weights[:, None] * edge * radius * weights * length / 2
    return float((area * leaving * toward / square**2).sum())


def options(parser: argparse.ArgumentParser) -> None:
    """None of its own."""


def run(chosen: argparse.Namespace) -> list[Table]:
    """The tables."""
    with tempfile.TemporaryDirectory() as folder:
        return [_lights(Path(folder), 1 << 6 if chosen.quick else 1 << 14), _primaries(Path(folder), chosen.quick)]


def _traced(path: Path, names: Iterable[str], samples: int) -> dict[str, float]:
    """By the names of a stage's lights, in metres, and "dome", their irradiance in lux at the point (0, 0, -FAR)."""
    from mirelight.io.usd.lights import read_lights
    from mirelight.lighting import Tracer

    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32) * 0.01 - [0, 0, FAR]
    card = ProxyMesh(vertices=corners.astype(np.float32), faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    found, tracer = read_lights(path), Tracer(card, RenderSettings(max_depth=1), layers=False)
    assert found.environment is not None
    parts = {name: Lighting(lights=tuple(x for x in found.lights if name in (x.name, x.group))) for name in names}
    parts |= {"dome": Lighting(environment=Environment(radiance=found.environment))}
    point, normal = np.array([[0.001, 0.002, -FAR]]), np.array([[0.0, 0.0, 1.0]])
    return {k: float(tracer.point_layers(x, point, normal, samples).total[0, 0]) for k, x in parts.items()}


def _lights(folder: Path, samples: int) -> Table:
    path = folder / "lights.usda"
    path.write_text(HEAD.format(unit=1, up="Y") + STAGE)
    known = dict(closed_forms())
    found, wanted = _traced(path, known, samples), known | {"dome": math.pi * LUMINANCE}
    rows = [(name, value, found[name], f"{100 * (found[name] / value - 1):+.2f} %") for name, value in wanted.items()]
    return table("Lights of UsdLux", ["light", "closed form, lux", "traced, lux", "difference"], rows)


def _primaries(folder: Path, quick: bool) -> Table:
    """Frames under one panorama, kept in each space: how far they are from that of 32-bit floats in Rec. 709."""
    radiance = read_environment(SCENE / "evening.hdr")
    size = "32, 18" if quick else "160, 90"
    files = {x: (SCENE / x).as_posix() for x in ("splats.compressed.ply", "proxy.glb")}
    (folder / "job.toml").write_text(
        f"""splats = "{files["splats.compressed.ply"]}"
proxy = "{files["proxy.glb"]}"
cameras_from = "proxy"
resolution = [{size}]
environment = {{ path = "sky.exr" }}
render = {{ spp = 16 }}
"""
    )

    def under(space: Chromaticities, half: bool) -> F32:
        write_exr(
            folder / "sky.exr",
            {"": converted(radiance, REC709, space)},
            {CHROMATICITIES: space},
            [""] if half else (),
        )
        job = mirelight.load(folder / "job.toml")
        return frame(mirelight.prepare(job), job.cameras[0], job.lightings[0]).rgba[..., :3]

    plain, rows = under(REC709, False), []
    for half in (False, True):
        for name, space in PRIMARIES.items():
            made = under(space, half)
            apart = np.abs(made - plain) / (plain + np.float32(0.01 * plain.mean()))
            level = abs(made.mean((0, 1), np.float64) / plain.mean((0, 1), np.float64) - 1).max()
            spread = (np.median(apart), np.quantile(apart, 0.99), apart.max(), level)
            rows.append((name, "16 bits" if half else "32 bits", *(f"{x:.1e}" for x in spread)))
    return table(
        "One panorama in four primaries",
        ["primaries", "file", "median", "99 % of values", "largest", "mean of the frame"],
        rows,
    )
