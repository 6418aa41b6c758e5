"""The values of a sweep's axis, each with a short word for the lighting's name."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path, PurePosixPath
from typing import Any

from mirelight.base import colour
from mirelight.io.job.sweep_tables import AxisTable, BallTable

_GOLDEN = math.pi * (3 - math.sqrt(5))  # rad between neighbours of a Fibonacci lattice


@dataclass(frozen=True, slots=True)
class Value:
    """One value of an axis."""

    word: str  # letters, digits, "_" and "-" alone
    value: Any  # as the job file would have it


def values(axis: AxisTable, seed: int, folder: Path) -> list[Value]:
    """The values in order. Draws depend on seed, field and their number alone, so a longer draw keeps its first ones.

    Args:
        axis: the table.
        seed: the sweep's.
        folder: that the pattern of `files` starts from.
    """
    field = re.findall(r"[A-Za-z_]\w*", axis.field)
    prefix = plain(axis.name or (field[-1] if field else axis.field))
    if axis.values is not None:
        return [Value(f"{prefix}{_word(x, i)}", x) for i, x in enumerate(axis.values)]
    if axis.files is not None:
        return [Value(plain(PurePosixPath(x).stem), x) for x in _files(axis.files, folder)]
    count = axis.draws or axis.steps or 0
    if axis.are_seeds:
        return [Value(f"{prefix}{i:04d}", _stream(axis, seed, i).getrandbits(31)) for i in range(count)]
    shares = [_shares(axis, seed, i) for i in range(count)]
    made = [_at(axis, share, i, count) for i, share in enumerate(shares)]
    return [Value(f"{prefix}{f'{i:04d}' if axis.draws else _word(x, i)}", x) for i, x in enumerate(made)]


def plain(name: str) -> str:
    """A name of letters, digits, "_" and "-": loaders of data sets cut names at dots and spaces."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", name) or "_"


def _word(value: Any, index: int) -> str:
    match value:
        case bool():
            return str(value).lower()
        case int() | float():
            return f"{value:.6g}".replace("+", "").replace("-", "m").replace(".", "p")
        case datetime():
            return value.strftime("%Y%m%dT%H%M%S")
        case str():
            return f"-{plain(PurePosixPath(value).stem)}"
        case _:
            return f"{index:04d}"


def _files(pattern: str, folder: Path) -> list[str]:
    """Names of the files that fit, as the job file would write them."""
    pure = Path(pattern)
    try:
        found = [x for x in (folder / pure.anchor).glob(str(pure.relative_to(pure.anchor))) if x.is_file()]
    except (ValueError, OSError):  # no pattern, or a folder that cannot be read
        return []
    return sorted((x.relative_to(folder) if x.is_relative_to(folder) else x).as_posix() for x in found)


def _shares(axis: AxisTable, seed: int, index: int) -> list[float] | None:
    """Uniform numbers in [0, 1) of one draw; None for even steps."""
    if axis.draws is None:
        return None
    stream = _stream(axis, seed, index)
    return [stream.random() for _ in range(max(2, len(_list(axis.range[0])) if axis.range else 0))]


def _stream(axis: AxisTable, seed: int, index: int) -> random.Random:
    return random.Random(f"{seed} {axis.field} {index}")  # a stream that Python promises to keep


def _at(axis: AxisTable, draws: list[float] | None, index: int, count: int) -> Any:
    even = index / max(1, count - 1)
    share = draws[0] if draws else even
    if axis.range is not None:
        return _between(axis.range, draws or even, axis.log)
    if axis.kelvin is not None:
        low, high = (1 / x for x in axis.kelvin)
        return [float(x) for x in colour.blackbody(1 / (low + (high - low) * share))]
    ball, bottom = (axis.dome, 0.0) if axis.dome is not None else (axis.sphere, -1.0)
    assert ball is not None
    height = draws[0] if draws else (index + 0.5) / count
    around = 2 * math.pi * draws[1] if draws else _GOLDEN * index
    return _on(ball, bottom + (1 - bottom) * height, around, axis.field.endswith("direction"))


def _on(ball: BallTable, height: float, around: float, inwards: bool) -> list[float]:
    """A place by the sine of its elevation and its azimuth in radians: equal areas for equal steps of height."""
    flat = math.sqrt(max(0.0, 1 - height * height))
    out = (flat * math.sin(around), height, flat * math.cos(around))
    if inwards:
        return [-x for x in out]
    return [c + ball.radius * x for c, x in zip(ball.center, out, strict=True)]


def _between(ends: Sequence[Any], share: float | list[float], log: bool) -> Any:
    low, high = ends
    first = share if isinstance(share, float) else share[0]
    if isinstance(low, datetime):
        return low + (high - low) * first
    if not isinstance(low, list):
        return _mixed(low, high, first, log)
    shares = [share] * len(low) if isinstance(share, float) else share
    return [_mixed(a, b, s, log) for a, b, s in zip(low, high, shares, strict=False)]


def _mixed(low: float, high: float, share: float, log: bool) -> float:
    return float(low * (high / low) ** share) if log else float(low + (high - low) * share)


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]
