"""The set that light_figures.py lights, and the drawing of its tiles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from mirelight.base import colour, conventions
from mirelight.lighting import Tracer
from mirelight.model import Camera, Lighting, ProxyMesh, RenderSettings

Array = NDArray[np.float64]
Series = tuple[Array, Array]  # x and y

WIDTH, HEIGHT = 240, 160  # of a picture, and of a plot
HEADING = 36
INK, QUIET, PAPER, CURVE, DOT = (236, 232, 224), (150, 145, 136), (24, 23, 22), (232, 170, 60), (120, 190, 255)


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One kind of light: the lighting that is shown, its formula, and both series of its plot."""

    name: str
    formula: str
    axis: str
    lighting: Lighting
    curves: tuple[Series, ...]
    measured: tuple[Series, ...]
    glow: ProxyMesh | None = None  # a glowing mesh beside the set


# --- meshes ----------------------------------------------------------------------------------------------------------


def quad(centre: list[float], x: list[float], y: list[float]) -> ProxyMesh:
    """A parallelogram with half edges x and y."""
    c, e, f = (np.asarray(v, np.float64) for v in (centre, x, y))
    corners = np.array([c - e - f, c + e - f, c + e + f, c - e + f], np.float32)
    return ProxyMesh(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def ball(centre: list[float], radius: float, rings: int = 48) -> ProxyMesh:
    """A sphere of triangles."""
    t, f = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.arange(2 * rings) * np.pi / rings, indexing="ij")
    points = np.stack([np.sin(t) * np.cos(f), np.cos(t), np.sin(t) * np.sin(f)], axis=-1).reshape(-1, 3)
    n = 2 * rings
    a = (np.arange(rings)[:, None] * n + np.arange(n)).ravel()
    b = (np.arange(rings)[:, None] * n + (np.arange(n) + 1) % n).ravel()
    faces = np.concatenate([np.stack([a, b, a + n], axis=1), np.stack([b, b + n, a + n], axis=1)])
    return ProxyMesh(vertices=(points * radius + np.asarray(centre)).astype(np.float32), faces=faces.astype(np.int32))


def join(*meshes: ProxyMesh) -> ProxyMesh:
    """One mesh of several, each with its first material."""
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
    blank = [np.zeros((len(m.vertices), 2), np.float32) if m.uvs is None else m.uvs for m in meshes]
    return ProxyMesh(
        vertices=np.concatenate([m.vertices for m in meshes]),
        uvs=np.concatenate(blank),
        faces=np.concatenate([m.faces + s for m, s in zip(meshes, starts, strict=True)]).astype(np.int32),
        materials=tuple(m.materials[0] for m in meshes),
        face_materials=np.repeat(np.arange(len(meshes)), [len(m.faces) for m in meshes]).astype(np.int32),
    )


def box(centre: list[float], half: float, turn: float) -> ProxyMesh:
    """A cube that stands turned about its height."""
    r = conventions.rotation_from_euler([0, turn, 0]) * half
    sides = []
    for axis in range(3):
        out, x, y = r[:, axis], r[:, (axis + 1) % 3], r[:, (axis + 2) % 3]
        sides += [quad((np.asarray(centre) + sign * out).tolist(), x.tolist(), y.tolist()) for sign in (-1, 1)]
    return join(*sides)


FLOOR = quad([0, 0, 0], [60, 0, 0], [0, 0, -60])
SET = join(
    FLOOR, ball([-0.9, 0.5, 0.1], 0.5), box([1.0, 0.4, -0.3], 0.4, 30), quad([0, 1.5, -1.8], [60, 0, 0], [0, 1.5, 0])
)
VIEW = Camera.look_at([0.6, 2.1, 5.2], [0, 0.75, 0], WIDTH, HEIGHT, yfov=36)

# --- drawing ---------------------------------------------------------------------------------------------------------


def picture(figure: Figure, spp: int) -> Image.Image:
    """The set under the light, exposed so that its brightest parts just show."""
    proxy = SET if figure.glow is None else join(SET, figure.glow)
    beauty = Tracer(proxy, RenderSettings(spp=spp)).trace(figure.lighting, VIEW).beauty
    level = float(np.percentile(beauty.max(axis=-1), 97))
    shown = colour.srgb_encode(np.clip(beauty * np.float32(0.8 / level), 0, 1))
    return Image.fromarray(np.rint(shown * 255).astype(np.uint8))


def plot(figure: Figure) -> Image.Image:
    """Curves and dots with their axes."""
    image = Image.new("RGB", (WIDTH, HEIGHT), (34, 33, 31))
    draw, small = ImageDraw.Draw(image), ImageFont.load_default(10)
    left, right, top, bottom = 34, WIDTH - 8, 8, HEIGHT - 30
    every = np.concatenate([y for _, y in (*figure.curves, *figure.measured)])
    xs = np.concatenate([x for x, _ in figure.curves])
    low, high, ceiling = float(xs.min()), float(xs.max()), float(every.max()) * 1.08

    def at(x: float, y: float) -> tuple[float, float]:
        return left + (x - low) / (high - low) * (right - left), bottom - y / ceiling * (bottom - top)

    step = 10 ** np.floor(np.log10(ceiling))
    step *= next(k for k in (0.2, 0.5, 1.0, 2.0) if ceiling / (step * k) <= 5)
    for k in range(int(ceiling / step) + 1):
        _, y = at(low, k * step)
        draw.line([(left, y), (right, y)], fill=(58, 56, 53))
        draw.text((left - 4, y), f"{k * step:g}", fill=QUIET, font=small, anchor="rm")
    for x in np.linspace(low, high, 5):
        draw.text((at(x, 0)[0], bottom + 4), f"{round(float(x), 2):.3g}", fill=QUIET, font=small, anchor="mt")
    draw.text(((left + right) / 2, HEIGHT - 3), figure.axis, fill=QUIET, font=small, anchor="mb")
    for xs, ys in figure.curves:
        draw.line([at(float(a), float(b)) for a, b in zip(xs, ys, strict=True)], fill=CURVE, width=2)
    for xs, ys in figure.measured:
        for a, b in zip(xs, ys, strict=True):
            px, py = at(float(a), float(b))
            draw.ellipse([px - 2, py - 2, px + 2, py + 2], fill=DOT)
    return image


def tile(figure: Figure, spp: int) -> Image.Image:
    """Name and formula over picture and plot."""
    out = Image.new("RGB", (2 * WIDTH + 6, HEADING + HEIGHT), PAPER)
    draw = ImageDraw.Draw(out)
    draw.text((2, 2), figure.name, fill=INK, font=ImageFont.load_default(15))
    draw.text((2, 20), figure.formula, fill=CURVE, font=ImageFont.load_default(12))
    out.paste(picture(figure, spp), (0, HEADING))
    out.paste(plot(figure), (WIDTH + 6, HEADING))
    return out
