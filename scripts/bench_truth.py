"""How close relit frames come to path-traced truth: proxies, captured light, indirect light, samples, denoising.

A fixed protocol: five captures (a courtyard under a soft and a hard sun, a stage between soft boxes, a room with the
sun through its windows and under clouds), three new lightings each, one camera each that no splat was made from. Every
frame is made by mirelight's own calls in mode `ratio` with the splats' colours on the proxy.

    python scripts/bench_truth.py [--quick] [--only NAME] [--json FILE] [--pictures DIR] [--cache DIR]

True pictures and proxies are kept in the cache folder (out/bench_truth), under digests of the code that makes them.
Needs the extras `scenes`, `denoise`, `compare`.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Literal, TypeVar, get_args

import numpy as np
from bench_truth_captures import ROOT, Captured, Size, Store, captures
from bench_truth_scores import F32, Score, edges_of, mean, score
from PIL import Image

from mirelight import estimate, proxy, relighting
from mirelight.colour import srgb_encode
from mirelight.compositor import Compositor
from mirelight.lighting import Tracer, captured_level, colored_by
from mirelight.lighting.denoise import denoise
from mirelight.model import (
    Camera,
    Indirect,
    Lighting,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    SplatLayer,
    SurfaceCache,
)

T = TypeVar("T")
Surface = Literal[
    "exact",
    "without bars",
    "solid",
    "decimated 10x",
    "decimated 50x",
    "moved 1 %",
    "moved 1 %, fitted",
    "own",
    "own, cameras known",
]
Known = Literal["known", "estimated"]

FULL = Size(96, 54, truth_spp=256)
QUICK = Size(96, 54, truth_spp=64, most=1)
AWAY = np.array([1.0, 0.8, -0.6]) / np.sqrt(2.0)  # which way a proxy is moved
ORDER: tuple[Surface, ...] = get_args(Surface)
SURFACES = tuple(x for x in ORDER if x not in ("without bars", "solid"))
FEW: tuple[Surface, ...] = (
    "exact",
    "own, cameras known",
)  # of captures that are not `whole`; and with the light estimated


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


BEST = Way("traced", 2, 16)  # by which proxies are compared
WAYS = tuple(Way(way, *cut) for way in ("traced", "surface") for cut in ((1, 16), (2, 4), (1, 64), (2, 16)))


@dataclass(frozen=True, slots=True)
class Row:
    """One way to relight, on one capture."""

    capture: str
    mode: str  # unchanged, tint, ratio
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
    """One capture, and what its rows share."""

    def __init__(self, capture: Captured, store: Store, say: Callable[[str], None], pictures: Path | None) -> None:
        self.capture, self._store, self._say, self._pictures = capture, store, say, pictures

    @cached_property
    def splats(self) -> SplatLayer:
        """Composited once."""
        return Compositor(self.capture.splats).composite(self.capture.camera, depth=False)

    @cached_property
    def edges(self) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Silhouettes of the true surface."""
        tracer = Tracer(self.capture.exact, RenderSettings(spp=16, max_depth=1), layers=False, aovs=False)
        seen = tracer.trace(self.capture.light, self.capture.camera)
        return edges_of(seen.coverage, seen.depth)

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
            case "without bars":
                assert capture.without_bars is not None
                return capture.without_bars
            case "solid":
                return capture.solid
            case "decimated 10x":
                return capture.simplified(len(capture.solid.faces) // 10)
            case "decimated 50x":
                return capture.simplified(len(capture.solid.faces) // 50)
            case "moved 1 %":
                return self._moved
            case "moved 1 %, fitted":
                name = f"{capture.scene}.fitted"
                return self._store.mesh(name, "fitted proxies", lambda: proxy.register(splats, self._moved))
            case "own":  # made of the splats' places and shapes, so one for all captures of a scene
                return self._store.mesh(f"{capture.scene}.own", "own proxies", lambda: proxy.make(splats).mesh)
            case "own, cameras known":
                name, closed = f"{capture.scene}.closed", partial(proxy.make, splats, cameras=capture.orbit)
                return self._store.mesh(name, "own proxies", lambda: closed().mesh)

    def rows(self, quick: bool) -> Iterator[Row]:
        """All rows of the capture."""
        cost = self._store.cost
        yield from self._without_light()
        bars: tuple[Surface, ...] = ("without bars",) if self.capture.without_bars is not None else ()
        all_of_them = (*bars, "solid", *SURFACES) if self.capture.whole else FEW
        for surface in ("exact",) if quick else all_of_them:
            mesh = self.mesh(surface)
            ways = WAYS if surface == "exact" and self.capture.whole else (BEST,)
            yield from self._frames(surface, "known", mesh, self.capture.light, ways[:2] if quick else ways)
            if surface in FEW and not quick:
                found = cost("light estimated", partial(self._estimated, mesh))
                yield from self._frames(surface, "estimated", mesh, found, (BEST,))

    def _estimated(self, mesh: ProxyMesh) -> Lighting:
        return estimate.estimate(self.capture.splats, mesh, RenderSettings()).lighting

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
        capture, cost = self.capture, self._store.cost
        colored = cost("colours of proxies", lambda: colored_by(capture.splats, mesh, light, RenderSettings()))
        level = captured_level(capture.splats, colored, light, RenderSettings())
        tracer = Tracer(colored, RenderSettings(), layers=False, aovs=False)
        lightings = (light, *capture.lightings)
        caches: Sequence[SurfaceCache | None] = [None] * len(lightings)
        before = self._store.spent.get("light on surfaces", 0.0)
        if any(way.indirect == "surface" for way in ways):
            cells = cost("light on surfaces", lambda: tracer.cells([capture.camera]))
            caches = [cost("light on surfaces", partial(tracer.fill, cells, x)) for x in lightings]
            self._say(f"  {len(cells):,} cells of {cells.size:.3g}")
        fill = self._store.spent.get("light on surfaces", 0.0) - before
        for way in ways:
            tracer.settings = RenderSettings(spp=way.spp, indirect=way.indirect)
            read = caches if way.indirect == "surface" else [None] * len(lightings)
            seen = self._seen(way)
            traced = [
                self._timed("frames", partial(tracer.trace, x, seen, cache=cache))
                for x, cache in zip(lightings, read, strict=True)
            ]
            cleaned = [self._timed("denoising", partial(denoise, x, layers=False)) for x, _ in traced]
            noisy, clean = [x for x, _ in traced], [x for x, _ in cleaned]
            trace, wash = (sum(seconds for _, seconds in x) for x in (traced, cleaned))
            settings = RelightSettings(mode="ratio", texture_scale=way.scale)
            for buffers, denoised in ((noisy, False), (clean, True)) if len(ways) > 1 else ((clean, True),):
                factors = [
                    _there(
                        relighting.apply(
                            self.splats, x, settings, captured=buffers[0], captured_level=level, noise=False
                        ).factor
                    )
                    for x in buffers[1:]
                ]
                row = self._row("ratio", surface, known, way, denoised, factors, len(mesh.faces))
                share = 2 / len(lightings)  # a frame needs its new and the captured light
                filled = fill if way.indirect == "surface" else 0.0
                yield replace(row, trace=trace * share, clean=wash * share if denoised else 0.0, fill=filled)

    def _timed(self, part: str, make: Callable[[], T]) -> tuple[T, float]:
        """What it makes, and the CPU seconds that it takes."""
        before = self._store.spent.get(part, 0.0)
        made = self._store.cost(part, make)
        return made, self._store.spent[part] - before

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
            scores.append(score(factor, unlit * factor, before, truth, self.edges))
            if self._pictures is not None:
                cut = f"{way.indirect}.{way.scale}x{way.spp}.{denoised}"
                name = f"{capture.name}.{lighting.name}.{mode}.{surface}.{known}.{cut}"
                parts = [(before[0] + before[1]) / 2, before[0] * factor, unlit * factor, (truth[0] + truth[1]) / 2]
                _write(self._pictures / f"{name.replace(' ', '-').replace('%', 'p')}.png", parts)
        made = mean(scores)
        self._say(
            f"  {capture.name} {mode} {surface} {known} {way.label} {'denoised' if denoised else ''}: "
            f"{made.light:.1f} dB light alone, {made.psnr:.1f} dB"
        )
        nan = math.nan
        own = tuple((x.name, y.light) for x, y in zip(capture.lightings, scores, strict=True))
        return Row(capture.name, mode, surface, known, way, denoised, made, own, nan, 0.0, 0.0, triangles)


def _there(factor: F32 | None) -> F32:
    assert factor is not None
    return factor


def _write(path: Path, parts: Sequence[F32]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    shown = np.concatenate([np.asarray(srgb_encode(np.clip(x, 0, 1))) for x in parts], axis=1)
    Image.fromarray(np.round(255 * shown).astype(np.uint8)).save(path)


# --- tables ----------------------------------------------------------------------------------------------------------


def table(title: str, rows: Sequence[Row], of: Callable[[Row], str]) -> str:
    """Markdown: light alone by capture, then the means of all figures."""
    names = list(dict.fromkeys(row.capture for row in rows))
    lines = [
        f"| {title} | {' | '.join(names)} | **mean** | edges | frame | SSIM | FLIP | CPU s |",
        "|---" * (len(names) + 7) + "|",
    ]
    for label in dict.fromkeys(of(row) for row in rows):
        own = {row.capture: row for row in rows if of(row) == label}
        cells = [f"{own[n].score.light:.1f}" if n in own else "" for n in names]
        whole = mean([row.score for row in own.values()])
        cost = float(np.mean([row.trace + row.clean for row in own.values()]))
        cells += [f"**{whole.light:.1f}**", f"{whole.light_edges:.1f}", f"{whole.psnr:.1f}", f"{whole.ssim:.3f}"]
        cells += [f"{whole.flip:.3f}" if whole.flip == whole.flip else "", f"{cost:.1f}" if cost == cost else ""]
        lines.append(f"| {label} | {' | '.join(cells)} |")
    return "\n".join(lines)


def tables(rows: Sequence[Row], spent: dict[str, float]) -> str:
    """What docs/truth.md is made from."""

    def proxy_label(row: Row) -> str:
        return row.mode if row.mode != "ratio" else f"{row.proxy}, light {row.light}"

    def way_label(row: Row) -> str:
        return f"{row.way.label}{', denoised' if row.denoised else ''}"

    compared = {row.capture for row in rows if row.way != BEST}
    known = [r for r in rows if r.mode == "ratio" and r.proxy == "exact" and r.light == "known"]
    ways = [r for r in known if r.capture in compared and (r.denoised or r.way.scale == 1)]
    proxies = [r for r in rows if r.mode != "ratio" or (r.denoised and r.way == BEST)]
    order = {"unchanged": 0, "tint": 1, "ratio": 2}
    best = sorted(proxies, key=lambda r: (order[r.mode], r.light == "estimated", ORDER.index(r.proxy)))
    parts = "\n".join(f"| {part} | {seconds:.0f} |" for part, seconds in spent.items())
    costs = f"| part | CPU s |\n|---|---|\n{parts}"
    return "\n\n".join(
        [table("proxy and light", best, proxy_label), table("exact proxy, light known", ways, way_label), costs]
    )


def main() -> None:
    """Run the protocol."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="two captures, small: to see that it runs")
    parser.add_argument("--json", type=Path, help="write all rows here")
    parser.add_argument("--pictures", type=Path, help="captured | x factor | frame | truth, of every frame")
    parser.add_argument("--cache", type=Path, default=ROOT / "out" / "bench_truth", help="true pictures and proxies")
    parser.add_argument("--only", default="", help="captures whose name holds this")
    chosen = parser.parse_args()
    start = time.monotonic()

    def say(text: str) -> None:
        print(
            f"{time.monotonic() - start:6.0f} s, {time.process_time():6.0f} CPU s  {text}", file=sys.stderr, flush=True
        )

    store = Store(chosen.cache)
    rows: list[Row] = []
    for capture in captures(QUICK if chosen.quick else FULL, store, say, quick=chosen.quick, only=chosen.only):
        for row in Bench(capture, store, say, chosen.pictures).rows(chosen.quick):
            rows.append(row)
            if chosen.json is not None:
                chosen.json.write_text(json.dumps([asdict(x) for x in rows], indent=1), encoding="utf-8")
    say("done")
    print(tables(rows, store.spent))


if __name__ == "__main__":
    main()
