"""What can be said of a splat file without loading it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mirelight.base.sh import COEFFICIENTS
from mirelight.io.splats.builder import cloud_bytes
from mirelight.model import Sort, SplatColorSpace


@dataclass(frozen=True, slots=True, kw_only=True)
class SplatFileInfo:
    """A splat file's head. Counts are what the file claims; reading may still find it damaged."""

    path: Path
    format: str  # e.g. "INRIA PLY"
    count: int  # splats that `read` would give, before any are dropped
    sh_degree: int  # 0 to 3
    antialiased: bool = False  # trained with opacity compensation
    color_space: SplatColorSpace = "srgb_rec709_display"
    sort: Sort | None = None  # the order of splats, where the format says it
    cutoff: float | None = None  # standard deviations where splats end, where the format says it
    levels: tuple[int, ...] = ()  # streamed SOG: splats of each level, finest first
    notes: tuple[str, ...] = ()  # what is left out or special, a line each

    @property
    def memory(self) -> int:
        """Bytes of the SplatCloud that `read` would give."""
        return cloud_bytes(self.count, COEFFICIENTS[self.sh_degree])
