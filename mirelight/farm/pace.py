"""How long the rest of a run will take, from what has been made.

A camera's first frame traces its light, the others mix it, so their costs are kept apart; and the first frame of each
process compiles kernels, so it does not count once others have been made.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from mirelight.store import Row
from mirelight.store.planned import PlannedFrame

_LEAST = 0.3  # of a camera's first frame that must be made by warm processes before it counts
_SPAN = 0.2  # share of a frame's samples from which its speed is told


@dataclass(frozen=True, slots=True)
class Costs:
    """Seconds of one process."""

    first: float  # of a camera's first frame
    later: float  # of each other frame of it

    def left(self, frames: Iterable[tuple[int, bool]], processes: int) -> float:
        """Seconds until all is made.

        Args:
            frames: of each camera how many frames are left, and whether its first has been made.
            processes: that work at once, each on one camera.
        """
        each = [count * self.later + (0 if begun else self.first - self.later) for count, begun in frames if count]
        return max(sum(each) / processes, max(each, default=0.0))

    @staticmethod
    def of(made: Iterable[Iterable[Row]], wanted: Mapping[str, PlannedFrame]) -> Costs | None:
        """From a journal, by process; None where it tells nothing of the wanted frames, by name.

        Frames of which not all files were written do not count.
        """
        cold: list[float] = []
        firsts: list[float] = []
        laters: list[float] = []
        for rows in made:
            groups: set[str] = set()
            for row in rows:
                frame = wanted.get(row.frame)
                if frame is None or row.error or {s: x.key for s, x in row.files.items()} != frame.files:
                    continue
                if frame.group in groups:
                    laters.append(row.seconds)
                else:
                    (firsts if groups else cold).append(row.seconds)
                groups.add(frame.group)
        firsts = firsts or cold
        if not firsts:
            return None
        first = _mean(firsts)
        return Costs(first, _mean(laters) if laters else first)


class Pace:
    """Learns from frames as they are made; times in seconds, of any one clock.

    Args:
        frames: by camera, how many are to be made.
        now: when the run begins.
    """

    def __init__(self, frames: Mapping[str, int], now: float) -> None:
        self._left = dict(frames)
        self._began = now
        self._last: dict[str, float] = {}  # by camera that has a frame, when its last one was made
        self._first: list[float] = []  # when cameras' first frames were made
        self._later = 0.0
        self._laters = 0
        self._parts: dict[str, float] = defaultdict(float)  # by camera, how much of its first frame is done
        self._heard: dict[str, tuple[float, float]] = {}  # by camera, when its samples were first heard of, how many
        self._traced: list[float] = []  # seconds that all samples of a frame take, from those parts

    def part(self, camera: str, share: float, now: float) -> None:
        """So much of a frame of a camera is done, 0 to 1."""
        if camera in self._last:
            return
        self._parts[camera] = share
        began, before = self._heard.setdefault(camera, (now, share))
        if share - before >= _SPAN and not self._first:
            self._traced = [(now - began) / (share - before)]

    def made(self, camera: str, now: float) -> None:
        """A frame of a camera was made."""
        self._parts.pop(camera, None)
        self.found(camera)
        if camera in self._last:
            self._later += now - self._last[camera]
            self._laters += 1
        else:
            self._first.append(now)
        self._last[camera] = now

    def found(self, camera: str) -> None:
        """A frame of a camera need not be made, or cannot."""
        self._left[camera] = max(0, self._left.get(camera, 0) - 1)

    def left(self, processes: int, now: float) -> float | None:
        """Seconds until all is made by so many processes; None while nothing is known."""
        costs = self._costs(processes, now)
        if costs is None:
            return None
        frames = [(count, camera in self._last) for camera, count in self._left.items() if count > 0]
        busy = sum(share * costs.first for share in self._parts.values())
        for camera, at in self._last.items():
            if self._left[camera] > 0:
                busy += min(now - at, costs.later)
        return max(0.0, costs.left(frames, processes) - busy / processes)

    def _costs(self, processes: int, now: float) -> Costs | None:
        cold = self._first[:processes]
        begun = sum(self._parts.values())
        warm = len(self._first) - len(cold) + (begun if len(cold) == processes else 0.0)
        later = self._later / self._laters if self._laters else None
        if warm >= _LEAST:
            underway = [at for camera, at in self._last.items() if self._left[camera] > 0]
            others = self._later + sum(min(now - at, later or 0.0) for at in underway)
            first = max(sum(now - at for at in cold) - others, 0.0) / warm
        elif cold:
            first = _mean([at - self._began for at in cold])
            if self._traced:
                first = min(first, self._traced[0])
        elif begun > 0:
            first = (now - self._began) * processes / begun
            if self._traced:
                first = min(first, self._traced[0])
        else:
            return None
        return Costs(first, min(later, first) if later is not None else first)


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)
