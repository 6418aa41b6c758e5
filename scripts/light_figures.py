"""Each kind of light on a small set, beside its formula and what the tracer measures: docs/pictures/lights.png.

    python scripts/light_figures.py                      # 14 pictures, three minutes of CPU
    python scripts/light_figures.py --spp 16 --only sun  # a quick look

Curves are written out here from the formulas; dots are the tracer's irradiance, direct light alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from light_tiles import FLOOR, PAPER, Figure, Series, join, quad, tile
from numpy.typing import NDArray
from PIL import Image

from mirelight.base import conventions
from mirelight.base.colour import luminance
from mirelight.io.atomic import atomic_path
from mirelight.lighting import Tracer
from mirelight.lighting.sunsky import resolved
from mirelight.model import (
    AreaLight,
    Camera,
    DirectionalLight,
    Environment,
    Lighting,
    Material,
    PointLight,
    ProxyMesh,
    RenderSettings,
    SkyModel,
    SpotLight,
    SunLight,
)

Array = NDArray[np.float64]
MARGIN, COLUMNS = 12, 2
HEIGHT_OF_LAMP = 2.0
X = np.linspace(-4, 4, 161)  # where curves are drawn along the floor

# --- what the tracer measures ----------------------------------------------------------------------------------------


def along_floor(lighting: Lighting, proxy: ProxyMesh = FLOOR, eye: float = 0.05, half: float = 4.0) -> Series:
    """Luminance-weighted direct irradiance at 32 places of the floor's x axis, from just above it."""
    count = 32
    pose = conventions.look_at([0, eye, 0], [0, 0, 0], [0, 0, -1])
    scale = count / (2 * half)
    camera = Camera(
        world_from_camera=pose,
        width=count,
        height=1,
        fx=scale,
        fy=scale * 50,
        cx=count / 2,
        cy=0.5,
        projection="orthographic",
        near=1e-4,
    )
    buffer = Tracer(proxy, RenderSettings(spp=4096, max_depth=1)).trace(lighting, camera)
    places = np.asarray((np.arange(count) + 0.5 - count / 2) / scale, np.float64)
    return places, irradiance(buffer.beauty[0])


def by_angle(lighting: Lighting, axis: Array) -> Series:
    """Direct irradiance of plates whose normals stand at 0 to 180 degrees to an axis."""
    angles, found = np.linspace(0, 180, 19), []
    side = conventions.unit(np.cross(axis, [0.3, 0.2, 1.0]))
    for angle in np.radians(angles):
        normal = np.cos(angle) * axis + np.sin(angle) * side
        x = conventions.unit(np.cross(normal, [0.13, 0.7, 0.21]))
        plate = quad([0, 0, 0], x.tolist(), np.cross(normal, x).tolist())
        camera = Camera.look_at(3 * normal, [0, 0, 0], 8, 8, yfov=4)
        buffer = Tracer(plate, RenderSettings(spp=64, max_depth=1)).trace(lighting, camera)
        found.append(irradiance(buffer.beauty).mean())
    return angles, np.asarray(found)


def irradiance(radiance: NDArray[np.float32]) -> Array:
    """Of a Lambert surface of albedo 0.5, weighted to luminance."""
    return np.asarray(luminance(radiance) * np.pi / 0.5)


# --- the formulas ----------------------------------------------------------------------------------------------------


def lamp_law(intensity: float, x: Array = X) -> tuple[Array, Array, Array]:
    """Irradiance of a lamp two units above x = 0, its distance, and the cosine to its axis."""
    d = np.hypot(x, HEIGHT_OF_LAMP)
    cosine = HEIGHT_OF_LAMP / d
    return intensity * cosine / d**2, d, cosine


def polygon_law(corners: Array, radiance: float) -> Array:
    """Irradiance of a polygon along the floor (Lambert, Photometria, 1760)."""
    out = []
    for x in X:
        to = corners - [x, 0, 0]
        to = to / np.linalg.norm(to, axis=1, keepdims=True)
        across = np.cross(to, np.roll(to, -1, axis=0))
        sine = np.linalg.norm(across, axis=1)
        angle = np.arctan2(sine, np.sum(to * np.roll(to, -1, axis=0), axis=1))
        out.append(radiance * abs(np.sum(angle * across[:, 1] / sine)) / 2)
    return np.asarray(out)


def panel(shape: str, width: float, height: float, intensity: float) -> tuple[Lighting, Array]:
    """An area light two units up that shines down, and its outline."""
    pose = np.array([[1, 0, 0, 0], [0, 0, 1, HEIGHT_OF_LAMP], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)
    turn = np.arange(720) * np.pi / 360
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    if shape == "rectangle":
        around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float64)
    flat = around * [width / 2, height / 2]
    outline = np.stack([flat[:, 0], np.full(len(flat), HEIGHT_OF_LAMP), flat[:, 1]], axis=1)
    light = AreaLight(name="l", shape=shape, world_from_light=pose, size=(width, height), intensity=intensity)  # type: ignore[arg-type]
    return Lighting(lights=(light,)), outline


def above(reach: float = np.inf, radius: float = 0.0) -> Lighting:
    """A point light two units up."""
    position = np.array([0, HEIGHT_OF_LAMP, 0])
    return Lighting(lights=(PointLight(name="l", position=position, intensity=20.0, range=reach, radius=radius),))


# --- the figures -----------------------------------------------------------------------------------------------------


def directional() -> Figure:
    down = conventions.unit([-0.5, -1.0, -0.6])
    lighting = Lighting(lights=(DirectionalLight(name="l", direction=down, intensity=3.0),))
    angle = np.linspace(0, 180, 91)
    law = 3 * np.maximum(np.cos(np.radians(angle)), 0)
    return Figure(
        name="directional, 3 lux",
        formula="E = I cos(t)",
        axis="angle t between normal and light, degrees",
        lighting=lighting,
        curves=((angle, law),),
        measured=(by_angle(lighting, -down),),
    )


def floor_figure(name: str, formula: str, lighting: Lighting, law: Array) -> Figure:
    return Figure(
        name=name,
        formula=formula,
        axis="x along the floor, light 2 above x = 0",
        lighting=lighting,
        curves=((X, law),),
        measured=(along_floor(lighting),),
    )


def point() -> Figure:
    return floor_figure("point, 20 cd", "E = I cos(t) / d^2", above(), lamp_law(20)[0])


def ranged() -> Figure:
    law, d, _ = lamp_law(20)
    window = np.clip(1 - (d / 3.5) ** 4, 0, 1)
    return floor_figure("point, range 3.5", "E = I cos(t) / d^2 max(1 - (d/r)^4, 0)", above(reach=3.5), law * window)


def spot() -> Figure:
    inner, outer = 0.25, 0.7
    light = SpotLight(
        name="l",
        position=np.array([0, HEIGHT_OF_LAMP, 0]),
        direction=np.array([0, -1.0, 0]),
        intensity=20.0,
        inner_cone_angle=inner,
        outer_cone_angle=outer,
    )
    law, _, cosine = lamp_law(20)
    cone = np.clip((cosine - np.cos(outer)) / (np.cos(inner) - np.cos(outer)), 0, 1) ** 2
    return floor_figure("spot, 0.25 to 0.7 rad", "E = I cos(t) / d^2 cone^2", Lighting(lights=(light,)), law * cone)


def soft_point() -> Figure:
    return floor_figure("point of radius 0.3", "E = I cos(t) / d^2, soft shadows", above(radius=0.3), lamp_law(20)[0])


def rectangle() -> Figure:
    lighting, outline = panel("rectangle", 2.0, 0.6, 20.0)
    return floor_figure(
        "rectangle, 20 cd/m2", "E = L/2 sum of edge angles, Lambert", lighting, polygon_law(outline, 20)
    )


def disk() -> Figure:
    lighting, outline = panel("disk", 1.2, 1.2, 20.0)
    return floor_figure("disk, 20 cd/m2", "E = L x projected solid angle", lighting, polygon_law(outline, 20))


def sphere() -> Figure:
    pose = conventions.compose([0, HEIGHT_OF_LAMP, 0])
    light = AreaLight(name="l", shape="sphere", world_from_light=pose, size=(1.0, 1.0), intensity=20.0)
    law = lamp_law(20 * np.pi * 0.5**2)[0]
    return floor_figure("sphere, 20 cd/m2", "E = L pi r^2 cos(t) / d^2", Lighting(lights=(light,)), law)


def emissive() -> Figure:
    _, outline = panel("rectangle", 1.0, 0.5, 20.0)
    glow = replace(
        quad([0, HEIGHT_OF_LAMP, 0], [0.5, 0, 0], [0, 0, 0.25]), materials=(Material(emissive=np.full(3, 20.0)),)
    )
    return Figure(
        name="glowing faces, 20 cd/m2",
        formula="E = L/2 sum of edge angles, Lambert",
        axis="x along the floor, faces 2 above x = 0",
        lighting=Lighting(),
        curves=((X, polygon_law(outline, 20)),),
        measured=(along_floor(Lighting(), join(FLOOR, glow)),),
        glow=glow,
    )


def textured() -> Figure:
    """Glowing faces with an emissive texture, against the sum over 400 x 40 places of them."""
    stripes = np.array([[[1, 1, 1], [0, 0, 0], [1, 0.1, 0.05], [0, 0, 0], [0.1, 0.3, 1], [0, 0, 0]]], np.float32)
    material = Material(
        emissive=np.full(3, 40.0), emissive_texture=np.repeat(stripes, 2, axis=0), emissive_wrap=("clamp", "clamp")
    )
    half, depth = 1.5, 0.25
    glow = replace(
        quad([0, HEIGHT_OF_LAMP, 0], [half, 0, 0], [0, 0, depth]),
        uvs=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32),
        materials=(material,),
    )
    u, z = (np.arange(400) + 0.5) / 400, ((np.arange(40) + 0.5) / 20 - 1) * depth
    at = u * 6 - 0.5
    radiance = 40 * luminance(np.stack([np.interp(at, np.arange(6), stripes[0, :, k]) for k in range(3)], axis=1))
    law = []
    for x in X:
        d2 = ((2 * u - 1) * half - x)[:, None] ** 2 + HEIGHT_OF_LAMP**2 + z**2
        law.append(np.sum(radiance[:, None] * HEIGHT_OF_LAMP**2 / d2**2) * (2 * half * 2 * depth) / (400 * 40))
    return Figure(
        name="glowing texture",
        formula="E = integral of L cos cos / d^2 over the faces",
        axis="x along the floor, faces 2 above x = 0",
        lighting=Lighting(),
        curves=((X, np.asarray(law)),),
        measured=(along_floor(Lighting(), join(FLOOR, glow)),),
        glow=glow,
    )


def sun() -> Figure:
    """The shadow edge of a slab that ends at x = 0, one unit up: the share of the disc above the edge."""
    diameter = 6.0

    def lit_from(direction: Array) -> Lighting:
        return Lighting(lights=(SunLight(name="l", direction=direction, intensity=3.0, angular_diameter=diameter),))

    x, tangent = np.linspace(-0.1, 0.1, 161), np.tan(np.radians(diameter / 2))
    t = np.clip(x / tangent, -1, 1)
    law = 3 * (0.5 + (np.arcsin(t) + t * np.sqrt(1 - t * t)) / np.pi)
    slab = join(FLOOR, quad([-5, 1, 0], [5, 0, 0], [0, 0, 20]))
    return Figure(
        name="sun, 3 lux, 6 degrees",
        formula="E = I x share of the disc that is seen",
        axis="x past a slab's edge, one unit below it",
        lighting=lit_from(conventions.unit([-0.5, -1.0, -0.6])),
        curves=((x, law),),
        measured=(along_floor(lit_from(np.array([0, -1.0, 0])), slab, half=0.1),),
    )


def environment() -> Figure:
    """A panorama linear in the cosine to an axis: E = pi a + 2/3 pi b cos."""
    axis, a, b = conventions.unit([0.6, 0.7, 0.4]), 0.6, 0.5
    v, u = np.meshgrid((np.arange(128) + 0.5) / 128, (np.arange(256) + 0.5) / 256, indexing="ij")
    theta, phi = np.pi * v, 2 * np.pi * (u - 0.5)
    way = np.stack([np.cos(phi) * np.sin(theta), np.cos(theta), np.sin(phi) * np.sin(theta)], axis=-1)
    radiance = (a + b * (way @ axis))[..., None] * np.ones(3)
    lighting = Lighting(environment=Environment(radiance=radiance.astype(np.float32)))
    angle = np.linspace(0, 180, 91)
    law = np.pi * a + 2 * np.pi / 3 * b * np.cos(np.radians(angle))
    return Figure(
        name="panorama, L = a + b cos(t)",
        formula="E = pi a + 2/3 pi b cos(t)",
        axis="angle t between normal and the map's axis",
        lighting=lighting,
        curves=((angle, law),),
        measured=(by_angle(lighting, axis),),
    )


def constant() -> Figure:
    """The floor beside an endless black wall one unit high."""
    lighting = Lighting(environment=Environment(radiance=np.full((1, 1, 3), 1.0, np.float32)))
    walled = join(FLOOR, quad([0, 0.5, 0], [0, 0, 400], [0, 0.5, 0]))
    law = np.pi * (1 + np.abs(X) / np.hypot(X, 1)) / 2
    return Figure(
        name="constant, 1 cd/m2",
        formula="E = pi L (1 + cos(elevation of the wall's top)) / 2",
        axis="x across a wall one unit high at x = 0",
        lighting=lighting,
        curves=((X, law),),
        measured=(along_floor(lighting, walled),),
    )


def sunsky() -> Figure:
    """Horizontal illuminance over the sun's elevation: the sun's lux times the sine, and the sky by quadrature."""

    def at(elevation: float) -> Lighting:
        e = np.radians(elevation)
        return Lighting(sky=SkyModel(to_sun=np.array([0.5 * np.cos(e), np.sin(e), 0.866 * np.cos(e)]), intensity=1e-3))

    elevations = np.array([0.001, 2, 5, 10, 15, 20, 30, 40, 50, 60, 70, 80, 90])
    laws: list[list[float]] = [[], []]
    dots: list[list[float]] = [[], []]
    camera = replace(Camera.look_at([0, 1, 0], [0, 0, 0], 8, 8), near=1e-3)
    tracer = Tracer(FLOOR, RenderSettings(spp=256, max_depth=1))
    for elevation in elevations:
        lighting = resolved(at(float(elevation)))
        sky = lighting.environment
        assert sky is not None
        theta = np.pi * (np.arange(len(sky.pixels) // 2) + 0.5) / len(sky.pixels)
        rows = luminance(sky.pixels[: len(theta)].mean(axis=1, dtype=np.float64)) * sky.intensity
        laws[0].append(lighting.lights[0].intensity * np.sin(np.radians(elevation)))
        laws[1].append(float(np.sum(rows * np.cos(theta) * np.sin(theta)) * 2 * np.pi * np.pi / len(sky.pixels)))
        for found, layer in zip(dots, tracer.trace(at(float(elevation)), camera).layers, strict=True):
            found.append(irradiance(layer.direct).mean())
    return Figure(
        name="sun and sky, turbidity 3",
        formula="on the ground, klx: sun (upper), sky (lower)",
        axis="elevation of the sun, degrees",
        lighting=at(35),
        curves=tuple((elevations, np.asarray(law)) for law in laws),
        measured=tuple((elevations, np.asarray(found)) for found in dots),
    )


FIGURES: dict[str, Callable[[], Figure]] = {
    "directional": directional,
    "point": point,
    "range": ranged,
    "spot": spot,
    "soft": soft_point,
    "sun": sun,
    "rectangle": rectangle,
    "disk": disk,
    "sphere": sphere,
    "environment": environment,
    "constant": constant,
    "sunsky": sunsky,
    "emissive": emissive,
    "textured": textured,
}


def deviation(figure: Figure) -> float:
    """Largest distance of a dot from its curve, as a share of the curve's largest value."""
    return max(
        float(np.max(np.abs(np.interp(x, cx, cy) - y)) / cy.max())
        for (cx, cy), (x, y) in zip(figure.curves, figure.measured, strict=True)
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--only", choices=FIGURES, nargs="*")
    parser.add_argument("--out", type=Path, default=Path("docs/pictures/lights.png"))
    chosen = parser.parse_args()
    tiles = []
    for name in chosen.only or FIGURES:
        figure = FIGURES[name]()
        print(f"{name:12} dots within {100 * deviation(figure):.2f} % of the curve's height")
        tiles.append(tile(figure, chosen.spp))
    columns = min(COLUMNS, len(tiles))
    rows = -(-len(tiles) // columns)
    w, h = tiles[0].width + MARGIN, tiles[0].height + MARGIN
    sheet = Image.new("RGB", (columns * w + MARGIN, rows * h + MARGIN), PAPER)
    for k, one in enumerate(tiles):
        sheet.paste(one, (MARGIN + k % columns * w, MARGIN + k // columns * h))
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(chosen.out) as path:
        sheet.save(path, format="PNG", optimize=True)


if __name__ == "__main__":
    main()
