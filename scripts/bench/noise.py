"""What layers, AOVs and a noise target cost, and whether error bars are true, on procedural scenes.

    python scripts/bench noise [--only cost|layers|bars|target]

cost: CPU time of a frame with all layers and AOVs against the same sampling with neither, interleaved.
layers: error of each layer against that of its light rendered alone, at equal samples.
bars: predicted / true variance, and the spread of (picture - truth) / predicted deviation, of beauty and layers.
target: a noise target by samples where the noise is, against equal samples everywhere: error reached, CPU time, and the
    difference of the means in standard errors.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from bench.common import Table, error2, table, timed
from bench.scenes import BOUNCES, BenchScene, scenes
from mirelight.lighting import Tracer
from mirelight.lighting.adaptive import window_sum
from mirelight.model import Lighting, LightingBuffer, RenderSettings


def tracer(scene: BenchScene, *, spp: int, noise: float | None = None) -> Tracer:
    """One that is warm."""
    made = Tracer(scene.proxy, RenderSettings(max_depth=BOUNCES, spp=spp, noise=noise))
    made.trace(scene.lighting, scene.camera)
    return made


def seeded(made: Tracer, lighting: Lighting, scene: BenchScene, seed: int) -> tuple[LightingBuffer, float]:
    """A frame, and the CPU seconds that it took."""
    made.settings = replace(made.settings, seed=seed)
    return timed(lambda: made.trace(lighting, scene.camera))


def cost(scene: BenchScene, spp: int, seeds: int) -> dict[str, Any]:
    """Layers and AOVs against neither: there all lights share a group, so that they are sampled alike."""
    settings = RenderSettings(max_depth=BOUNCES, spp=spp)
    joined = replace(scene.lighting, lights=tuple(replace(x, group="all") for x in scene.lighting.lights))
    both = [(Tracer(scene.proxy, settings), scene.lighting), (Tracer(scene.proxy, settings, aovs=False), joined)]
    seconds = [[seeded(made, lighting, scene, seed)[1] for made, lighting in both] for seed in range(seeds + 1)]
    everything, neither = np.array(seconds[1:]).T
    return {"cpu": float(np.median(everything)), "ratio": float(np.median(everything / neither))}


def layers(scene: BenchScene, spp: int, seeds: int) -> dict[str, Any]:
    """The largest and the median ratio of deviations, layer in the frame / light alone."""
    made = tracer(scene, spp=spp)
    ratios = {}
    together = [seeded(made, scene.lighting, scene, seed)[0] for seed in range(seeds)]
    for k, light in enumerate(scene.lighting.lights):
        alone = [seeded(made, Lighting(lights=(light,)), scene, 100 + seed)[0] for seed in range(seeds)]
        own = [x.layers[0].total.astype(np.float64) for x in alone]
        shared = [x.layers[k].total.astype(np.float64) for x in together]
        mean = np.mean(own + shared, axis=0)
        ratios[light.name] = float(np.sqrt(error2(shared, mean) / error2(own, mean)))
    return {"worst": max(ratios.values()), "median": float(np.median(list(ratios.values())))}


def bars(scene: BenchScene, spp: int, seeds: int) -> dict[str, Any]:
    """Error bars against the spread over seeds."""
    made = tracer(scene, spp=spp)
    frames = [seeded(made, scene.lighting, scene, seed)[0] for seed in range(seeds)]

    def compared(
        picture: Callable[[LightingBuffer], Any], variance: Callable[[LightingBuffer], Any]
    ) -> dict[str, float]:
        stack = np.stack([picture(x).astype(np.float64) for x in frames])
        mean, true = stack.mean(axis=0), stack.var(axis=0, ddof=1)
        seen = mean.max(axis=-1) > 1e-3 * mean.max()
        weight = 1 / (mean[seen] ** 2 + 0.01 * mean[seen].mean() ** 2)
        predicted = np.mean([np.mean(variance(x)[seen] * weight) for x in frames])
        first = frames[0]
        around = [window_sum(np.where(seen, variance(first)[..., c], 0).astype(np.float64), 1) for c in range(3)]
        smooth = np.stack(around, axis=-1) / np.maximum(window_sum(seen.astype(np.float64), 1), 1)[..., None]
        others = (stack.sum(axis=0) - stack[0]) / (seeds - 1)
        z = (stack[0] - others)[seen] / np.sqrt(np.maximum(smooth[seen] * (1 + 1 / (seeds - 1)), 1e-30))
        low, high = np.quantile(z, (0.1587, 0.8413))  # half of what lies between is the spread of a normal variable
        ratio = float(predicted / np.mean(true[seen] * weight))
        return {"predicted/true": ratio, "z spread": float((high - low) / 2)}

    out = {"beauty": compared(lambda x: x.beauty, lambda x: x.variance)}
    for k, layer in enumerate(frames[0].layers):
        out[layer.name] = compared(lambda x, k=k: x.layers[k].total, lambda x, k=k: x.layers[k].variance)  # type: ignore[misc]
    ratios = [v["predicted/true"] for k, v in out.items() if k != "beauty"]
    spreads = [v["z spread"] for k, v in out.items() if k != "beauty"]
    return {
        **out["beauty"],
        "layers predicted/true": [min(ratios), max(ratios)],
        "layers z spread": [min(spreads), max(spreads)],
    }


def target(scene: BenchScene, noise: float, seeds: int) -> dict[str, Any]:
    """Samples where the noise is against samples everywhere."""
    aimed = tracer(scene, spp=16, noise=noise)
    found = [seeded(aimed, scene.lighting, scene, 1 + seed) for seed in range(seeds)]
    samples = [x.samples for x, _ in found if x.samples is not None]
    spp = max(16, round(float(np.mean(samples)) / 16) * 16)
    even = tracer(scene, spp=spp)
    plain = [seeded(even, scene.lighting, scene, 1000 + seed) for seed in range(seeds)]
    pictures = [[x.beauty.astype(np.float64) for x, _ in some] for some in (found, plain)]
    mean = np.mean(pictures[0] + pictures[1], axis=0)
    errors = [error2(some, mean) for some in pictures]
    cpu = [float(np.median([t for _, t in some])) for some in (found, plain)]
    totals = [np.array([x.mean() for x in some]) for some in pictures]
    z = (totals[0].mean() - totals[1].mean()) / np.sqrt(sum(t.var(ddof=1) / seeds for t in totals))
    return {
        "said": float(np.mean([x.relative_noise for x, _ in found])),
        "error": float(np.sqrt(errors[0])),
        "samples": [
            float(min(s.min() for s in samples)),
            float(np.mean(samples)),
            float(max(s.max() for s in samples)),
        ],
        "error2 x cpu against even": errors[0] * cpu[0] / (errors[1] * cpu[1]),
        "error2 x samples against even": errors[0] * float(np.mean(samples)) / (errors[1] * spp),
        "means differ by z": float(z),
    }


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--only", choices=["cost", "layers", "bars", "target"])


def run(chosen: argparse.Namespace) -> list[Table]:
    """The tables of the parts that were asked for."""
    width, height, cells, seeds = (64, 36, 20, 4) if chosen.quick else (240, 135, 120, 8)
    parts: dict[str, Callable[[BenchScene], dict[str, Any]]] = {
        "cost": lambda scene: cost(scene, 16, seeds),
        "layers": lambda scene: layers(scene, 16, seeds),
        "bars": lambda scene: bars(scene, 64, seeds),
        "target": lambda scene: target(scene, {"interior": 0.2}.get(scene.name, 0.025), seeds),
    }
    found = []
    for name, part in parts.items():
        if chosen.only in (None, name):
            rows = [
                (scene.name, figure, value)
                for scene in scenes(width, height, cells)
                for figure, value in part(scene).items()
            ]
            found.append(table(f"Noise: {name}", ("scene", "figure", "value"), rows))
    return found
