"""Where the difference from real time comes from: a ladder of frames from the engine's to the physical one.

Each rung changes exactly one thing of the rung before. What a step contributes is its projection on the whole
difference, so the contributions add up to the whole. See docs/guides/compare.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np

from mirelight.compare import metrics
from mirelight.compare.types import NOISE_MARGIN, CompareSettings
from mirelight.io.atomic import write_file
from mirelight.model import F32, F64


@dataclass(frozen=True, slots=True)
class Cause:
    """One reason why a real-time frame is not the physical one."""

    title: str  # what the real-time frame does
    change: str  # what the step puts in its place


CAUSES: Mapping[str, Cause] = MappingProxyType(
    {
        "float": Cause(
            "Coarse frame buffer",
            "The engine blends in 8 bits (in its linear pipeline in 11-bit floats): after every splat the colour is "
            "rounded, and in 8 bits cut at white. This step blends in floating point.",
        ),
        "model": Cause(
            "Not explained: mirelight's model of the engine",
            "From here on mirelight computes what the engine would show. This step is what that model misses.",
        ),
        "corners": Cause(
            "Splat corners on a coarse grid",
            "The software rasteriser that ran the engine snaps the corners of every splat's quad to sixteenths of a "
            "pixel (a graphics card: to 256ths). This step leaves them where they are.",
        ),
        "order": Cause(
            "Splats sorted by buckets",
            "The engine sorts splats into buckets of depth, and blends those of one bucket in the file's order. This "
            "step sorts by exact depth.",
        ),
        "buffer": Cause(
            "Compact work buffer",
            "The engine packs each splat's size, rotation, colour and opacity into a few bits. This step reads them "
            "as half floats.",
        ),
        "shadows": Cause(
            "Shadow maps",
            "The engine looks shadows up in maps of limited resolution, with a blur. This step casts a ray to every "
            "light, from the point that the engine looks up.",
        ),
        "bias": Cause(
            "Shadows looked up off the surface",
            "Against speckles, the engine looks shadows up at points that are moved along the normal, so that light "
            "leaks in where surfaces meet. This step starts the rays at the surface itself.",
        ),
        "scale": Cause(
            "Small lighting texture",
            "The lighting is computed on fewer pixels than the frame and stretched. This step computes it for every "
            "pixel.",
        ),
        "units": Cause(
            "Light falloffs and units",
            "The engine dims lamps by 16 / (d² + 1) with a squared range window and a smooth cone edge. This step uses "
            "the inverse square law and the cones of KHR_lights_punctual.",
        ),
        "prefilter": Cause(
            "Prefiltered environment",
            "The engine blurs the environment into 64 x 32 pixels of 8 bits, at most 64 bright. This step sums the "
            "whole map by the cosine law.",
        ),
        "occlusion": Cause(
            "Environment without shadows",
            "In the engine the sky shines through walls. This step traces which part of it each point sees.",
        ),
        "size": Cause(
            "Lights without size",
            "Light comes from a point and every pixel is lit or not. This step gives lights their size and averages "
            "over each pixel, so that shadow edges are soft.",
        ),
        "indirect": Cause(
            "No indirect light",
            "In the engine light is reflected once. This step adds the light that surfaces throw on each other, and "
            "surfaces that glow.",
        ),
        "coverage": Cause(
            "Hard silhouettes of the lighting",
            "A pixel of the lighting texture is either covered by the proxy or not, the proxy's back faces are "
            "missing, and splats that reach past it keep their captured light. This step averages over the pixel, "
            "shows both sides and continues the light past the proxy.",
        ),
        "tint": Cause(
            "Tint of display values",
            "The engine multiplies display-encoded colours by linear light. This step decodes the colour (sRGB), "
            "multiplies light by light, and encodes the result.",
        ),
        "blending": Cause(
            "Splats blended in linear light",
            "The linear pipeline decodes splats before it blends them, but they were trained to be blended as display "
            "values. This step blends them so.",
        ),
        "kernel": Cause(
            "The engine's splat footprint",
            "The engine draws splats sharper than the rasteriser that they were trained with (a low-pass of 0.075 "
            "instead of 0.3 px²), cuts their tails, and drops small ones. This step draws them as trained.",
        ),
        "tone": Cause(
            "Tone curve per splat",
            "The engine tone maps each splat before it is lit and blended. This step tone maps the finished frame.",
        ),
        "ratio": Cause(
            "The captured light stays in",
            "A tint multiplies colours that still hold the light of the capture. This step divides that light out: the "
            "job names it.",
        ),
    }
)


@dataclass(frozen=True, slots=True, eq=False)
class Rung:
    """One frame of the ladder."""

    name: str  # "engine" for the first, else the key of the cause that is taken away here
    title: str  # what is shown, for a person
    change: str  # what differs from the rung before
    frame: F32  # (H, W, 3) display values 0..1
    again: F32 | None = None  # the same by independent samples, where paths were traced

    @property
    def independent(self) -> F32:
        """(H, W, 4) the frame by independent samples; itself where nothing was sampled."""
        return self.frame if self.again is None else self.again


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """What one cause contributes, on the way from the rung before."""

    name: str  # key of CAUSES
    share: float  # of the whole squared difference; all shares add up to 1 (0 where nothing differs)
    squared: float  # share times the ladder's mean squared difference
    brightness: float  # mean change of display luma, -1..1; adds up over the ladder too
    rms: float  # root mean square of the step itself, display values
    psnr: float  # dB, of the step itself
    flip: float  # mean FLIP between its two rungs
    noise: float | None = None  # root mean square that the tracing's noise alone gives it; None: nothing was traced

    @property
    def noise_psnr(self) -> float | None:
        """dB that the step would show if it were nothing but noise."""
        return None if self.noise is None else metrics.psnr(self.noise**2)

    @property
    def within_noise(self) -> bool:
        """The step is not larger than noise explains."""
        return self.noise is not None and 0 < self.rms**2 <= NOISE_MARGIN * self.noise**2


@dataclass(frozen=True, eq=False)
class Ladder:
    """Frames from the real-time one to the physical one, one cause at a time."""

    name: str  # "camera.lighting"
    rungs: tuple[Rung, ...]  # at least two
    absent: tuple[tuple[str, str], ...]  # causes that are not in play here, and why
    engine: str  # what rendered the first rung
    really_rendered: bool  # by the engine itself
    warnings: tuple[str, ...] = ()  # what of the job the engine cannot follow

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """One for each rung after the first.

        With D the difference of the last and the first frame and d a step's own, the step's share is <d, D> / <D, D>:
        how far it moves the picture along the way from real time to physical. The steps add up to D, so the shares
        add up to 1. A share below 0 leads away: the engine's error hid another one.

        Raises:
            MirelightError: a package of the extra `compare` is missing.
        """
        frames = [rung.frame.astype(np.float64) for rung in self.rungs]
        whole = frames[-1] - frames[0]
        energy = float(np.sum(whole * whole))
        out = []
        for k in range(1, len(frames)):
            before, rung = self.rungs[k - 1], self.rungs[k]
            own = frames[k] - frames[k - 1]
            along = float(np.sum(own * whole))
            square = float(np.mean(own * own))
            out.append(
                Step(
                    name=rung.name,
                    share=along / energy if energy > 0 else 0.0,
                    squared=along / whole.size,
                    brightness=_luma_change(before.frame, rung.frame),
                    rms=square**0.5,
                    psnr=metrics.psnr(square),
                    flip=_mean_flip(before.frame, rung.frame),
                    noise=None if rung.again is None else _noise(own, rung.independent, before.independent),
                )
            )
        return tuple(out)

    @cached_property
    def whole(self) -> Step:
        """The first frame against the last, as one step; its `name` is empty."""
        first, last = self.rungs[0].frame, self.rungs[-1].frame
        square = float(np.mean((last.astype(np.float64) - first) ** 2))
        return Step(
            name="",
            share=1.0 if square > 0 else 0.0,
            squared=square,
            brightness=_luma_change(first, last),
            rms=square**0.5,
            psnr=metrics.psnr(square),
            flip=_mean_flip(first, last),
            noise=None if self.rungs[-1].again is None else _noise(last - first, self.rungs[-1].independent, first),
        )


def _luma_change(before: F32, after: F32) -> float:
    return float(np.mean(metrics.luma(after).astype(np.float64) - metrics.luma(before)))


def _noise(step: F64 | F32, after: F32, before: F32) -> float:
    """Root mean square of a step's noise, from the same step by independent samples: half of their squared difference.

    What both rungs have in common drops out, as it does in the step itself.
    """
    return float(np.sqrt(np.mean((step - (after.astype(np.float64) - before)) ** 2) / 2))


def _mean_flip(reference: F32, test: F32) -> float:
    return float(metrics.flip(reference, test, CompareSettings()).mean(dtype=np.float64))


# --- what a ladder says ----------------------------------------------------------------------------------------------


def summary(ladder: Ladder) -> str:
    """A table in plain text, in the ladder's order."""
    rows: list[Sequence[str]] = [("", "cause", "share", "brightness", "PSNR", "noise", "FLIP", "")]
    for k, step in enumerate((*ladder.steps, ladder.whole)):
        title = CAUSES[step.name].title if step.name else "all together"
        number = str(k + 1) if step.name else ""
        noise = "-" if step.noise_psnr is None else f"{step.noise_psnr:.1f}"
        figures = (f"{step.share:+.1%}", f"{step.brightness * 255:+.2f}", f"{step.psnr:.1f}", noise, f"{step.flip:.4f}")
        rows.append((number, title, *figures, "noise" if step.within_noise else ""))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    left = 2  # the number and the title are text
    return "\n".join(
        "  ".join(
            cell.ljust(width) if k < left else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    )


def as_json(ladder: Ladder) -> dict[str, object]:
    """All figures of a ladder as JSON values; infinity is null."""
    import math
    from dataclasses import asdict

    def figures(step: Step) -> dict[str, object]:
        every = {**asdict(step), "noise_psnr": step.noise_psnr, "within_noise": step.within_noise}
        return {k: None if isinstance(v, float) and math.isinf(v) else v for k, v in every.items()}

    return {
        "name": ladder.name,
        "engine": ladder.engine,
        "really_rendered": ladder.really_rendered,
        "whole": figures(ladder.whole),
        "steps": [{**figures(step), "title": CAUSES[step.name].title} for step in ladder.steps],
        "absent": dict(ladder.absent),
        "warnings": list(ladder.warnings),
    }


def write_json(path: Path, ladder: Ladder) -> None:
    """All figures of a ladder.

    Raises:
        OutputError: the file cannot be written.
    """
    import json

    write_file(path, json.dumps(as_json(ladder), indent=1) + "\n")
