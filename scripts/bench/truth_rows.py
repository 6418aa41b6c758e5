"""The rows of scripts/bench truth: one capture relit every way, and how close each comes to the truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from PIL import Image

from bench.common import side_by_side
from bench.truth_captures import Captured
from bench.truth_scores import F32, Bool, Score, edges_of, mean, score
from bench.truth_seen import seen_of
from bench.truth_store import Store
from mirelight import estimate, proxy, relighting
from mirelight.base.colour import srgb_decode, srgb_encode
from mirelight.base.errors import InputError
from mirelight.compositor import Compositor
from mirelight.io.cameras.pictures import view_size
from mirelight.lighting import Tracer, captured_level, colored_by, splat_light
from mirelight.lighting.denoise import denoise
from mirelight.model import (
    Camera,
    Deferred,
    DirectionalLight,
    Indirect,
    Lighting,
    LightingBuffer,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    SplatLayer,
    SunLight,
    SurfaceCache,
    digest,
)
from mirelight.pipeline import captured_sun
from mirelight.proxy.capture_views import capture_views
from mirelight.proxy.tidy import compact
from mirelight.proxy.types import Soup

Surface = Literal[
    "exact",
    "solid",
    "decimated 10x",
    "decimated 50x",
    "moved 1 %",
    "moved 1 %, fitted",
    "exact, unseen left out",
    "exact, unseen closed as own",
    "own",
    "own, cameras known",
]
Known = Literal["known", "estimated"]

AWAY = np.array([1.0, 0.8, -0.6]) / np.sqrt(2.0)  # which way a proxy is moved
ORDER: tuple[Surface, ...] = get_args(Surface)
BOUNDS: tuple[Surface, ...] = ("exact, unseen left out", "exact, unseen closed as own")
MORE: tuple[Surface, ...] = (*BOUNDS, "own")  # proxies that no goal is set for
FEW: tuple[Surface, ...] = ("exact", *BOUNDS, "own, cameras known")  # of captures not `whole`
ESTIMATED: tuple[Surface, ...] = ("exact", "own, cameras known")  # with the light estimated too


@dataclass(frozen=True, slots=True)
class Way:
    """How a frame's light is found."""

    indirect: Indirect
    scale: int  # lighting pixels per pixel of the frame, along each axis
    spp: int  # per lighting pixel

    @property
    def label(self) -> str:
        """In a table."""
        apart = f" as {self.scale}x{self.scale} of {self.spp}" if self.scale > 1 else ""
        return f"`{self.indirect}`, {self.spp * self.scale**2} samples{apart}"


WHOLE_PIXEL = 0.999  # coverage by surfaces, from which no sky is in it
REPAIRED = "ratio, repaired"
BEST = Way("traced", 2, 32)  # by which proxies are compared
KEPT = replace(BEST, indirect="surface")
WAYS = tuple(Way(way, *cut) for way in ("traced", "surface") for cut in ((1, 16), (2, 4), (1, 64), (2, 16), (2, 32)))


@dataclass(frozen=True, slots=True)
class Row:
    """One way to relight, on one capture."""

    capture: str
    mode: str  # unchanged, tint, ratio; `REPAIRED`: ratio with relight.repair
    proxy: Surface
    light: Known
    way: Way
    denoised: bool
    score: Score  # mean over the capture's lightings
    by_lighting: tuple[tuple[str, float], ...]  # light alone
    trace: float  # CPU seconds a frame, new and captured light, median; NaN where nothing is traced
    fill: float  # CPU seconds of all lightings' caches, once for all cameras
    clean: float  # CPU seconds a frame of denoising
    triangles: int


class Bench:
    """One capture, and what its rows share.

    `more`: with rows that no goal is set for, too.
    """

    def __init__(
        self, capture: Captured, store: Store, say: Callable[[str], None], pictures: Path | None, more: bool
    ) -> None:
        self.capture, self._store, self._say, self._pictures, self._more = capture, store, say, pictures, more

    @cached_property
    def splats(self) -> SplatLayer:
        """Composited once."""
        return Compositor(self.capture.splats).composite(self.capture.camera, depth=False)

    @cached_property
    def _views(self) -> tuple[SplatLayer, ...]:
        """What the capture's cameras took, where splats were trained on it."""
        capture = self.capture
        pictures = [Deferred.of(_as_read(x)) for x in capture.pictures]
        return capture_views(capture.splats, capture.orbit, pictures, report=self._say) if pictures else ()

    @cached_property
    def _surface(self) -> LightingBuffer:
        """The true surface, for where it is."""
        tracer = Tracer(self.capture.exact, RenderSettings(spp=16, max_depth=1), layers=False, aovs=False)
        return tracer.trace(self.capture.light, self.capture.camera)

    @cached_property
    def edges(self) -> Bool:
        """Silhouettes of the true surface."""
        return edges_of(self._surface.coverage, self._surface.depth)

    @cached_property
    def scored(self) -> Bool | None:
        """Pixels that count; None: all."""
        return np.asarray(self._surface.coverage > WHOLE_PIXEL) if self.capture.sky else None

    @cached_property
    def size(self) -> float:
        """What one percent is of: the diagonal of the box that holds the splats but strays."""
        low, high = np.quantile(self.capture.splats.means.astype(np.float64), [0.002, 0.998], axis=0)
        return float(np.linalg.norm(high - low))

    @cached_property
    def _moved(self) -> ProxyMesh:
        exact = self.capture.exact
        return replace(exact, vertices=(exact.vertices + 0.01 * self.size * AWAY).astype(np.float32))

    def mesh(self, surface: Surface) -> ProxyMesh:
        """A proxy without colours."""
        capture, splats = self.capture, self.capture.splats
        match surface:
            case "exact":
                return capture.exact
            case "solid":
                return capture.solid
            case "decimated 10x":
                return capture.simplified(len(capture.solid.faces) // 10)
            case "decimated 50x":
                return capture.simplified(len(capture.solid.faces) // 50)
            case "moved 1 %":
                return self._moved
            case "moved 1 %, fitted":
                name = f"{capture.cloud}.fitted"
                return self._store.mesh(name, "fitted proxies", lambda: proxy.register(splats, self._moved))
            case "exact, unseen left out":
                return seen_of(capture.exact, splats, self.size)
            case "exact, unseen closed as own":
                own, seen = self._own
                closing = compact(_soup(own, slice(seen, None)))
                return _soup(seen_of(capture.exact, splats, self.size)).beside(closing).mesh()
            case "own":
                own, seen = self._own
                return compact(_soup(own, slice(seen))).mesh()
            case "own, cameras known":
                return self._own[0]

    @cached_property
    def _own(self) -> tuple[ProxyMesh, int]:
        """And how many of its faces were seen; the rest close unseen space. Made of the splats' places and shapes, so
        one for all captures of a cloud."""
        capture = self.capture

        def pack() -> F32:
            try:
                made = proxy.make(capture.splats, cameras=capture.orbit)
            except InputError as refused:
                self._say(f"  {capture.name}: {refused}; its own proxy is made without them")
                made = proxy.make(capture.splats)
            mesh = made.mesh
            sizes = [[len(mesh.vertices), len(mesh.faces) - made.unseen, 0]]
            return np.concatenate([sizes, mesh.vertices, mesh.faces]).astype(np.float32)

        rows = self._store.array(f"{capture.cloud}.own", "own proxies", pack, "proxies")
        count, seen = (int(x) for x in rows[0, :2])
        return ProxyMesh(vertices=rows[1 : 1 + count], faces=rows[1 + count :].astype(np.int32)), seen

    def rows(self, quick: bool) -> Iterator[Row]:
        """All rows of the capture; `quick`: the exact proxy alone."""
        yield from self._kept("without light", (self.capture.exact, BEST), self._without_light)
        all_of_them = [x for x in (ORDER if self.capture.whole else FEW) if x not in MORE or self._more]
        for surface in ORDER[:1] if quick else all_of_them:
            mesh = self.mesh(surface)
            yield from self._relit(surface, "known", mesh, self.capture.light, self._ways(surface))
            if surface in ESTIMATED and not quick:
                yield from self._relit(surface, "estimated", mesh, self._estimated(surface, mesh), (BEST,))

    def _ways(self, surface: Surface) -> Sequence[Way]:
        if not (self._more and surface == "exact"):
            return (BEST,)
        return WAYS if self.capture.whole else (BEST, KEPT)

    def _relit(
        self, surface: Surface, known: Known, mesh: ProxyMesh, light: Lighting, ways: Sequence[Way]
    ) -> Iterator[Row]:
        made = partial(self._frames, surface, known, mesh, light, ways)
        return self._kept(f"{surface}.{known}", (mesh, light, self._more, *ways), made)

    def _kept(self, name: str, of: tuple[object, ...], make: Callable[[], Iterator[Row]]) -> Iterator[Row]:
        """Rows made unless they are kept; with pictures to write they are made in any case."""
        if self._pictures is not None:
            yield from make()
            return
        name = f"{self.capture.name}.{name}"
        kept = self._store.table(name, lambda: [asdict(row) for row in make()], (self._all_rows, *of))
        yield from (row_of(values) for values in kept)

    @cached_property
    def _all_rows(self) -> str:
        """Digest of what all rows of the capture are made from."""
        c = self.capture
        return digest(
            c.splats,
            c.camera,
            c.orbit,
            c.pictures,
            c.lightings,
            *(x for name in sorted(c.truth) for x in c.truth[name]),
        )

    def _estimated(self, surface: Surface, mesh: ProxyMesh) -> Lighting:
        splats = self.capture.splats

        def pack() -> F32:
            made = estimate.estimate(splats, mesh, RenderSettings(), views=self._views)
            return made.packed().astype(np.float32)

        name = f"{self.capture.name}.{surface}.light"
        packed = self._store.array(name, "light estimated", pack, "light", (splats, mesh, self._views))
        return estimate.lighting_of(packed.astype(np.float64))

    def _without_light(self) -> Iterator[Row]:
        """The capture as it is, and the engine's tint on a gray proxy."""
        exact = self.capture.exact
        unlit = [np.ones_like(self.splats.color) for _ in self.capture.lightings]
        tracer = Tracer(exact, RenderSettings(spp=BEST.spp), layers=False, aovs=False)
        lit = [tracer.trace(x, self._seen(BEST)) for x in self.capture.lightings]
        yield self._row("unchanged", "exact", "known", BEST, False, unlit, len(exact.faces))
        settings = RelightSettings(mode="tint", texture_scale=BEST.scale)
        tint = [_there(relighting.apply(self.splats, x, settings, noise=False).factor) for x in lit]
        yield self._row("tint", "exact", "known", BEST, False, tint, len(exact.faces))

    def _seen(self, way: Way) -> Camera:
        camera = self.capture.camera
        return camera.resized(camera.width * way.scale, camera.height * way.scale)

    def _frames(
        self, surface: Surface, known: Known, mesh: ProxyMesh, light: Lighting, ways: Sequence[Way]
    ) -> Iterator[Row]:
        """Two rows of every way: noisy and denoised; of the one by which proxies are compared the denoised one."""
        capture, cost, splats, views = self.capture, self._store.cost, self.capture.splats, self._views
        colored = cost("colours of proxies", lambda: colored_by(splats, mesh, light, RenderSettings(), views))
        level = cost("captured levels", lambda: captured_level(splats, colored, light, RenderSettings(), views))
        tracer = cost("frames", lambda: Tracer(colored, RenderSettings(), layers=False, aovs=False))
        lightings = (light, *capture.lightings)
        caches: Sequence[SurfaceCache | None] = [None] * len(lightings)
        fill = 0.0
        if any(way.indirect == "surface" for way in ways):
            caches, fill = self._store.timed("light on surfaces", partial(_filled, tracer, lightings))
        for way in ways:
            tracer.settings = RenderSettings(spp=way.spp, indirect=way.indirect)
            read = caches if way.indirect == "surface" else [None] * len(lightings)
            seen = self._seen(way)
            traced = [
                self._store.timed("frames", partial(tracer.trace, x, seen, cache=cache))
                for x, cache in zip(lightings, read, strict=True)
            ]
            cleaned = [self._store.timed("denoising", partial(denoise, x, layers=False)) for x, _ in traced]
            noisy, clean = [x for x, _ in traced], [x for x, _ in cleaned]
            trace, wash = (sum(seconds for _, seconds in x) for x in (traced, cleaned))
            settings = RelightSettings(mode="ratio", texture_scale=way.scale)
            for buffers, denoised in ((noisy, False), (clean, True)) if len(ways) > 1 else ((clean, True),):
                factors = self._factors(buffers[0], buffers[1:], settings, level)
                row = self._row("ratio", surface, known, way, denoised, factors, len(mesh.faces))
                share = 2 / len(lightings)  # a frame needs its new and the captured light
                filled = fill if way.indirect == "surface" else 0.0
                yield replace(row, trace=trace * share, clean=wash * share if denoised else 0.0, fill=filled)
            if surface in ESTIMATED and way == BEST:
                shown = cost("captured light as shown", partial(self._repaired, tracer, light, clean[0]))
                factors = self._factors(shown, clean[1:], settings, level)
                yield self._row(REPAIRED, surface, known, way, True, factors, len(mesh.faces))

    def _factors(
        self, captured: LightingBuffer, lit: Sequence[LightingBuffer], settings: RelightSettings, level: float
    ) -> list[F32]:
        """That of each new light."""

        def factor(new: LightingBuffer) -> F32 | None:
            made = relighting.apply(self.splats, new, settings, captured=captured, captured_level=level, noise=False)
            return made.factor

        return [_there(factor(x)) for x in lit]

    def _repaired(self, tracer: Tracer, light: Lighting, captured: LightingBuffer) -> LightingBuffer:
        """The captured light as the splats' picture shows it."""
        lamps = [x for x in light.lights if isinstance(x, DirectionalLight | SunLight)]
        lamp = max(lamps, key=lambda x: x.intensity * float(x.color.mean()), default=None)
        sun = None
        if lamp is not None:
            alone = splat_light.lamps_in_view(tracer, Lighting(name="sun", lights=(lamp,)), captured.camera)
            sun = captured_sun.sun_of(lamp, denoise(alone, layers=False).beauty, np.ones(3, np.float32))
        return relighting.repaired(captured, sun, relighting.unlit_rgba(self.splats))

    def _row(
        self,
        mode: str,
        surface: Surface,
        known: Known,
        way: Way,
        denoised: bool,
        factors: Sequence[F32],
        triangles: int,
    ) -> Row:
        capture = self.capture
        unlit = relighting.unlit_rgba(self.splats)[..., :3]
        before = capture.truth[capture.light.name]
        scores = []
        for lighting, factor in zip(capture.lightings, factors, strict=True):
            truth = capture.truth[lighting.name]
            scores.append(score(factor, unlit * factor, before, truth, self.edges, self.scored))
            if self._pictures is not None:
                cut = f"{way.indirect}.{way.scale}x{way.spp}.{denoised}"
                name = f"{capture.name}.{lighting.name}.{mode}.{surface}.{known}.{cut}"
                parts = [(before[0] + before[1]) / 2, before[0] * factor, unlit * factor, (truth[0] + truth[1]) / 2]
                path = self._pictures / f"{name.replace(' ', '-').replace('%', 'p')}.png"
                side_by_side(path, [np.asarray(srgb_encode(np.clip(x, 0, 1))) for x in parts])
        made = mean(scores)
        self._say(
            f"  {capture.name} {mode} {surface} {known} {way.label} {'denoised' if denoised else ''}: "
            f"{made.light:.1f} dB light alone, {made.psnr:.1f} dB"
        )
        nan = math.nan
        own = tuple((x.name, y.light) for x, y in zip(capture.lightings, scores, strict=True))
        return Row(capture.name, mode, surface, known, way, denoised, made, own, nan, 0.0, 0.0, triangles)


def _as_read(picture: F32) -> F32:
    """(h, w, 4) linear, on the smaller grid that a job reads a picture (H, W, 3) on; all of it counts."""
    size = view_size(picture.shape[1], picture.shape[0])
    linear = np.moveaxis(srgb_decode(picture), 2, 0).astype(np.float32)
    small = [np.asarray(Image.fromarray(x).resize(size, Image.Resampling.BOX)) for x in linear]
    return np.stack([*small, np.ones_like(small[0])], axis=2)


def _soup(mesh: ProxyMesh, faces: slice = slice(None)) -> Soup:
    """Some of a mesh's faces."""
    return Soup(mesh.vertices.astype(np.float64), mesh.faces[faces].astype(np.int64))


def row_of(values: dict[str, Any]) -> Row:
    """A row from its plain values."""
    by_lighting = tuple((str(name), float(light)) for name, light in values["by_lighting"])
    plain = values | {"way": Way(**values["way"]), "score": Score(**values["score"]), "by_lighting": by_lighting}
    return Row(**plain)


def _filled(tracer: Tracer, lightings: Sequence[Lighting]) -> Sequence[SurfaceCache]:
    """Light on the surface of every lighting, along the same rays."""
    cells = tracer.cells()
    transport = tracer.transport(cells)
    return [tracer.fill(cells, x, transport=transport) for x in lightings]


def _there(factor: F32 | None) -> F32:
    assert factor is not None
    return factor
