"""How close relit frames come to path-traced truth: proxies, captured light, indirect light, samples, denoising.

A fixed protocol: five captures (a courtyard under a soft and a hard sun, a stage between soft boxes, a room with the
sun through its windows and under clouds), three new lightings each, one camera each that no splat was made from. Every
frame is made by mirelight's own calls in mode `ratio` with the splats' colours on the proxy.

    python scripts/bench_truth.py [--quick] [--json FILE] [--pictures DIR] [--cache DIR]

True pictures and proxies are kept in the cache folder (out/bench_truth). Needs the extras `scenes`, `denoise`,
`compare`.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeVar

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
    "exact", "without bars", "solid", "decimated 10x", "decimated 50x", "moved 1 %", "moved 1 %, fitted", "own"
]
Known = Literal["known", "estimated"]

FULL = Size(160, 90, truth_spp=256)
QUICK = Size(96, 54, truth_spp=64, most=1)
SPP = 64
AWAY = np.array([1.0, 0.8, -0.6]) / np.sqrt(2.0)  # which way a proxy is moved
SURFACES: tuple[Surface, ...] = ("exact", "decimated 10x", "decimated 50x", "moved 1 %", "moved 1 %, fitted", "own")
FEW: tuple[Surface, ...] = ("exact", "own")  # of a scene's second capture; and with the light estimated
ORDER: tuple[Surface, ...] = ("exact", "without bars", "solid", *SURFACES[1:])
PLAIN: Surface = "solid"  # on which ways are compared, as the nearest to a proxy that people have
WAYS: tuple[tuple[Indirect, int], ...] = tuple((way, spp) for way in ("traced", "surface", "near") for spp in (16, 64))


@dataclass(frozen=True, slots=True)
class Row:
    """One way to relight, on one capture."""

    capture: str
    mode: str  # unchanged, tint, ratio
    proxy: Surface
    light: Known
    indirect: Indirect
    spp: int
    denoised: bool
    score: Score  # mean over the capture's lightings
    by_lighting: tuple[tuple[str, float], ...]  # light alone
    trace: float  # CPU seconds a frame, new and captured light, median; NaN where nothing is traced
    fill: float  # CPU seconds of all lightings' caches, once for all cameras
    clean: float  # CPU seconds a frame of denoising
    triangles: int


def timed(make: Callable[[], T]) -> tuple[T, float]:
    """What it makes, and the CPU seconds that it takes."""
    start = time.process_time()
    made = make()
    return made, time.process_time() - start


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
        exact, splats = self.capture.exact, self.capture.splats
        match surface:
            case "exact":
                return exact
            case "without bars":
                assert self.capture.without_bars is not None
                return self.capture.without_bars
            case "solid":
                return self.capture.solid
            case "decimated 10x":
                return self.capture.simplified(len(self.capture.solid.faces) // 10)
            case "decimated 50x":
                return self.capture.simplified(len(self.capture.solid.faces) // 50)
            case "moved 1 %":
                return self._moved
            case "moved 1 %, fitted":
                return self._store.mesh(f"{self.capture.scene}.fitted", lambda: proxy.register(splats, self._moved))
            case "own":  # made of the splats' places and shapes, so one for all captures of a scene
                return self._store.mesh(f"{self.capture.scene}.own", lambda: proxy.make(splats).mesh)

    def rows(self, quick: bool) -> Iterator[Row]:
        """All rows of the capture."""
        yield from self._without_light()
        if self.capture.first:
            yield from self._ways(quick)
        bars: tuple[Surface, ...] = ("without bars",) if self.capture.without_bars is not None else ()
        for surface in (*bars, *SURFACES) if self.capture.first and not quick else FEW:
            mesh = self.mesh(surface)
            yield from self._traced(surface, mesh, "known", self.capture.light)
            if surface in FEW:
                found = estimate.estimate(self.capture.splats, mesh, RenderSettings()).lighting
                yield from self._traced(surface, mesh, "estimated", found)

    def _without_light(self) -> Iterator[Row]:
        """The capture as it is, and the engine's tint on a gray proxy."""
        exact = self.capture.exact
        unlit = [np.ones_like(self.splats.color) for _ in self.capture.lightings]
        tracer = Tracer(exact, RenderSettings(spp=SPP), layers=False, aovs=False)
        lit = [tracer.trace(x, self.capture.camera) for x in self.capture.lightings]
        yield self._row("unchanged", "exact", "known", "traced", 0, False, unlit, len(exact.faces))
        tint = [relighting.apply(self.splats, x, RelightSettings(mode="tint"), noise=False).factor for x in lit]
        yield self._row("tint", "exact", "known", "traced", SPP, False, [_there(x) for x in tint], len(exact.faces))

    def _ways(self, quick: bool) -> Iterator[Row]:
        """Indirect light, samples and denoising, under known light."""
        capture = self.capture
        mesh = colored_by(capture.splats, self.mesh(PLAIN), capture.light, RenderSettings())
        level = captured_level(capture.splats, mesh, capture.light, RenderSettings())
        tracer = Tracer(mesh, RenderSettings(), layers=False, aovs=False)
        cells, found = timed(lambda: tracer.cells([capture.camera]))
        caches, filled = timed(lambda: [tracer.fill(cells, x) for x in (capture.light, *capture.lightings)])
        self._say(f"  {len(cells):,} cells of {cells.size:.3g}; found and filled in {found + filled:.0f} CPU s")
        for indirect, spp in WAYS[:3] if quick else WAYS:
            tracer.settings = RenderSettings(spp=spp, indirect=indirect)
            read = caches if indirect != "traced" else [None] * len(caches)
            yield from self._frames(PLAIN, "known", tracer, mesh, level, capture.light, read, found + filled)

    def _traced(self, surface: Surface, mesh: ProxyMesh, known: Known, light: Lighting) -> Iterator[Row]:
        """64 samples, traced."""
        settings = RenderSettings(spp=SPP)
        colored = colored_by(self.capture.splats, mesh, light, settings)
        level = captured_level(self.capture.splats, colored, light, settings)
        tracer = Tracer(colored, settings, layers=False, aovs=False)
        yield from self._frames(surface, known, tracer, colored, level, light, [None] * 9, 0.0)

    def _frames(
        self,
        surface: Surface,
        known: Known,
        tracer: Tracer,
        mesh: ProxyMesh,
        level: float,
        light: Lighting,
        caches: Sequence[SurfaceCache | None],
        fill: float,
    ) -> Iterator[Row]:
        """Two rows: noisy and denoised."""
        capture, settings = self.capture, RelightSettings(mode="ratio")
        made = [
            timed(lambda x=x, cache=cache: tracer.trace(x, capture.camera, cache=cache))  # type: ignore[misc]
            for x, cache in zip((light, *capture.lightings), caches, strict=False)
        ]
        cost = made[0][1] + float(np.median([seconds for _, seconds in made[1:]]))
        noisy = [buffer for buffer, _ in made]
        clean = [timed(lambda x=x: denoise(x, layers=False)) for x in noisy]  # type: ignore[misc]
        washing = clean[0][1] + float(np.median([seconds for _, seconds in clean[1:]]))
        for buffers, denoised in ((noisy, False), ([x for x, _ in clean], True)):
            factors = [
                _there(
                    relighting.apply(
                        self.splats, x, settings, captured=buffers[0], captured_level=level, noise=False
                    ).factor
                )
                for x in buffers[1:]
            ]
            way, spp = tracer.settings.indirect, tracer.settings.spp
            row = self._row("ratio", surface, known, way, spp, denoised, factors, len(mesh.faces))
            filled = fill if way != "traced" else 0.0
            yield replace(row, trace=cost, fill=filled, clean=washing if denoised else 0.0)

    def _row(
        self,
        mode: str,
        surface: Surface,
        known: Known,
        indirect: Indirect,
        spp: int,
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
                name = f"{capture.name}.{lighting.name}.{mode}.{surface}.{known}.{indirect}.{spp}.{denoised}"
                parts = [(before[0] + before[1]) / 2, before[0] * factor, unlit * factor, (truth[0] + truth[1]) / 2]
                _write(self._pictures / f"{name.replace(' ', '-').replace('%', 'p')}.png", parts)
        made = mean(scores)
        self._say(
            f"  {capture.name} {mode} {surface} {known} {indirect} {spp} {'denoised' if denoised else ''}: "
            f"{made.light:.1f} dB light alone, {made.psnr:.1f} dB"
        )
        nan = math.nan
        own = tuple((x.name, y.light) for x, y in zip(capture.lightings, scores, strict=True))
        return Row(capture.name, mode, surface, known, indirect, spp, denoised, made, own, nan, 0.0, 0.0, triangles)


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


def tables(rows: Sequence[Row]) -> str:
    """What docs/truth.md shows."""

    def proxy_label(row: Row) -> str:
        return row.mode if row.mode != "ratio" else f"{row.proxy}, light {row.light}"

    def way_label(row: Row) -> str:
        return f"`{row.indirect}`, {row.spp} samples{', denoised' if row.denoised else ''}"

    ways = [r for r in rows if r.mode == "ratio" and r.proxy == PLAIN]
    most = max((r.spp for r in ways), default=SPP)
    plain = [r for r in ways if r.denoised and r.indirect == "traced" and r.spp == most]
    proxies = [r for r in rows if r.mode != "ratio" or (r.denoised and r.proxy != PLAIN)]
    order = {"unchanged": 0, "tint": 1, "ratio": 2}
    best = sorted([*proxies, *plain], key=lambda r: (order[r.mode], r.light == "estimated", ORDER.index(r.proxy)))
    return "\n\n".join([table("proxy and light, denoised", best, proxy_label), table("way", ways, way_label)])


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
    print(tables(rows))


if __name__ == "__main__":
    main()
