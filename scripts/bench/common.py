"""What the parts of the benchmarks share: tables, clocks, errors."""

from __future__ import annotations

import argparse
import re
import resource
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
Array = NDArray[np.float64]
Timed: TypeAlias = Callable[[int, int], tuple[Array, float]]  # (spp, seed) -> (H, W, 3) and CPU seconds


@dataclass(frozen=True, slots=True)
class Table:
    """Figures as a page shows them."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Table:
    """Cells as they are shown: text as it is, numbers with four digits, of several the first and the last."""

    def shown(x: object) -> str:
        if isinstance(x, list):
            return f"{shown(x[0])} to {shown(x[-1])}"
        return f"{x:.4g}" if isinstance(x, float) else str(x)

    return Table(title, tuple(columns), tuple(tuple(map(shown, row)) for row in rows))


def path(text: str) -> Path:
    """A path as it was given; the empty one, as a variable of a shell that is not set leaves it, would be the working
    folder."""
    if not text:
        raise argparse.ArgumentTypeError("an empty path; name one, or leave the option out")
    return Path(text)


def truth_options(parser: argparse.ArgumentParser, width: int, cache: Path) -> None:
    """Options of a part that holds frames against true pictures: how large, how many samples, what is kept where."""
    parser.add_argument("--spp", type=int, default=64, help="samples of a frame (64)")
    parser.add_argument("--width", type=int, default=width, help=f"pixels ({width})")
    parser.add_argument("--truth-spp", type=int, default=128, help="samples of each of the truth's halves (128)")
    parser.add_argument("--cache", type=path, default=cache, help="where captures and truth are kept")
    parser.add_argument("--pictures", type=path, help="where frames beside truth go as PNG")


def timed(make: Callable[[], T]) -> tuple[T, float]:
    """What it makes, and the CPU seconds that it takes, all threads together."""
    start = time.process_time()
    made = make()
    return made, time.process_time() - start


def median(values: Iterable[float]) -> float:
    return float(statistics.median(values))


def least(call: Callable[[], object], repeats: int) -> float:
    """Least CPU seconds of some calls, after one that does not count."""
    call()
    return min(timed(call)[1] for _ in range(repeats))


def peak_mb() -> float:
    """The most memory that this process has had, in MiB."""
    status = Path("/proc/self/status")
    if not status.exists():  # not Linux; there a child's ru_maxrss starts at its parent's
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 20)
    return int(re.findall(r"VmHWM:\s*(\d+)", status.read_text(encoding="ascii"))[0]) / 1024


def side_by_side(path: Path, pictures: Sequence[NDArray[np.floating]]) -> None:
    """A PNG of pictures (H, W, 3) of display values, from left to right; its folder is made."""
    from PIL import Image  # here alone: some parts measure how much memory they take

    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.rint(255 * np.concatenate(pictures, axis=1)).astype(np.uint8)).save(path)


def averaged(picture: NDArray[np.floating], rows: int, columns: int) -> NDArray[np.floating]:
    """Means (H // rows, W // columns, 3) over blocks of a picture (H, W, 3); what is left over counts for none."""
    h, w = picture.shape[0] // rows, picture.shape[1] // columns
    blocks = picture[: h * rows, : w * columns].reshape(h, rows, w, columns, 3)
    return np.asarray(blocks.mean(axis=(1, 3)))


def relative(mean: Array) -> Array:
    """(H, W, 3) of weights for squared errors, so that their sum is the mean of d² / (mean² + 0.01 level²) over lit
    pixels."""
    lit = mean.max(axis=-1, keepdims=True) > 0
    level = mean[lit[..., 0]].mean()
    return np.asarray(lit / (mean**2 + 0.01 * level**2) / (3 * lit.sum()))


def error2(pictures: Sequence[Array], mean: Array | None = None) -> float:
    """Relative squared error of pictures (H, W, 3) that differ by their seeds alone."""
    stack = np.stack(pictures)
    return float((stack.var(axis=0, ddof=1) * relative(stack.mean(axis=0) if mean is None else mean)).sum())


def interleaved(
    renderers: dict[str, Timed], spp: int, seeds: int
) -> tuple[dict[str, list[Array]], dict[str, list[float]]]:
    """Pictures and CPU seconds of each, by turns, after one that compiles and builds."""
    pictures: dict[str, list[Array]] = {name: [] for name in renderers}
    seconds: dict[str, list[float]] = {name: [] for name in renderers}
    for render in renderers.values():
        render(spp, 9999)
    for seed in range(seeds):
        for name, render in renderers.items():
            picture, spent = render(spp, 1 + seed)
            pictures[name].append(picture)
            seconds[name].append(spent)
    return pictures, seconds
