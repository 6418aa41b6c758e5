"""Thresholds that a comparison must hold, for use in CI."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, cast

from mirelight.base.errors import InputError
from mirelight.compare.types import Comparison, RegionName

FIGURES = ("psnr", "ssim", "flip", "hdr_flip", "rel_mse", "delta_e", "delta_e_p99", "max_error")
_FORM = re.compile(r"(?:(all|covered|silhouette)\.)?(\w+)\s*(<=|>=|<|>)\s*([-+.\deE]+)")


@dataclass(frozen=True, slots=True)
class Requirement:
    """A bound on one figure of one region, for every pair."""

    region: RegionName
    figure: str
    comparison: Literal["<=", ">=", "<", ">"]
    bound: float

    def __str__(self) -> str:
        return f"{self.region}.{self.figure}{self.comparison}{self.bound:g}"

    def unmet(self, result: Comparison) -> str | None:
        """What is wrong, in one line; None where the bound holds."""
        scores = next((s for s in result.regions if s.region == self.region), None)
        value = None if scores is None else getattr(scores, self.figure)
        if value is None:
            return f"{result.name}: {self} cannot be checked (this pair has no such figure)"
        held = {
            "<=": value <= self.bound,
            ">=": value >= self.bound,
            "<": value < self.bound,
            ">": value > self.bound,
        }[self.comparison]
        return None if held else f"{result.name}: {self} is not met ({value:.4g})"


def parse_requirement(text: str) -> Requirement:
    """A requirement such as ``psnr>=30`` or ``silhouette.flip<=0.1`` (region: all, unless named).

    Raises:
        InputError: another form or an unknown figure.
    """
    match = _FORM.fullmatch(text.strip())
    if match is None or match[2] not in FIGURES:
        raise InputError("--require", repr(text), f"write FIGURE>=NUMBER; figures: {', '.join(FIGURES)}")
    try:
        bound = float(match[4])
    except ValueError:
        raise InputError("--require", repr(text), f"{match[4]!r} is not a number") from None
    return Requirement(
        region=cast(RegionName, match[1] or "all"),
        figure=match[2],
        comparison=cast(Literal["<=", ">=", "<", ">"], match[3]),
        bound=bound,
    )


def unmet(results: Sequence[Comparison], requirements: Sequence[Requirement]) -> tuple[str, ...]:
    """One line for each bound that a pair does not hold."""
    lines = (requirement.unmet(result) for requirement in requirements for result in results)
    return tuple(line for line in lines if line is not None)
