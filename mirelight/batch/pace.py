"""How long the rest of a run will take, from what has been made.

A camera's first frame composites and traces, a later one may only mix what has been traced, so costs are kept by place
among a camera's frames; and the first camera of each process compiles kernels, so its first frame does not count once
others have been made.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass

from mirelight.store import Row
from mirelight.store.planned import PlannedFrame

_SPAN = 0.2  # share of a frame's samples from which its speed is told


@dataclass(frozen=True, slots=True)
class Costs:
    """Seconds that one process takes for a camera's frames, by place among them; the last one for all that follow."""

    places: tuple[float, ...]

    @staticmethod
    def mean(seen: Mapping[int, list[float]], first: float) -> Costs:
        """From what frames took, by place; of places between that were not seen the mean of all later ones."""
        later = [x for place, values in seen.items() if place for x in values]
        usual = _mean(later) if later else first
        last = max(seen, default=0)
        places = [_mean(seen[k]) if seen.get(k) else usual for k in range(1, last + 1)]
        return Costs((first, *places, usual))

    def at(self, place: int) -> float:
        """Of the frame at a place."""
        return self.places[min(place, len(self.places) - 1)]

    def left(self, cameras: Iterable[tuple[int, int]], processes: int) -> float:
        """Seconds until all is made.

        Args:
            cameras: of each, how many frames it has and how many of them have been made.
            processes: that work at once, each on one camera.
        """
        each = [sum(self.at(k) for k in range(made, count)) for count, made in cameras]
        return max(sum(each) / processes, max(each, default=0.0))

    @staticmethod
    def of(made: Iterable[Iterable[Row]], wanted: Mapping[str, PlannedFrame]) -> Costs | None:
        """From a journal, by process; None where it tells nothing of the wanted frames, by name.

        Frames of which not all files were written do not count.
        """
        cold: list[float] = []
        seen: dict[int, list[float]] = defaultdict(list)
        for rows in made:
            groups: dict[str, int] = defaultdict(int)
            for row in rows:
                frame = wanted.get(row.frame)
                if frame is None or row.error or {s: x.key for s, x in row.files.items()} != frame.files:
                    continue
                place = groups[frame.group]
                (cold if place == 0 and len(groups) == 1 else seen[place]).append(row.seconds)
                groups[frame.group] += 1
        if not cold:
            return None
        return Costs.mean(seen, _mean(seen[0] or cold))


class Pace:
    """Learns from frames as they are made; times in seconds, of any one clock.

    Args:
        frames: by camera, how many are to be made.
    """

    def __init__(self, frames: Mapping[Hashable, int]) -> None:
        self._count = dict(frames)
        self._made: dict[Hashable, int] = defaultdict(int)
        self._last: dict[Hashable, float] = {}  # by camera that has a frame, when its last one was made
        self._first: list[float] = []  # what cameras' first frames took
        self._later: dict[int, list[float]] = defaultdict(list)  # by place, what other frames took
        # by camera, how much of its first frame is done, and when
        self._parts: dict[Hashable, tuple[float, float]] = {}
        self._grown: dict[Hashable, tuple[float, float]] = {}  # by camera, a share of it, and the seconds that it took
        self._traced: float | None = None  # seconds that all samples of a frame take, as the newest has it

    def part(self, camera: Hashable, share: float, now: float) -> None:
        """So much of a frame of a camera is done, 0 to 1. While that stands still, what all frames share is made."""
        if camera in self._last:
            return
        if camera in self._parts:
            before, at = self._parts[camera]
            grown, took = self._grown.get(camera, (0.0, 0.0))
            if share > before > 0:  # before the first samples comes what cannot be told apart
                grown, took = self._grown[camera] = grown + share - before, took + now - at
            if grown >= _SPAN:
                self._traced = took / grown
        self._parts[camera] = share, now

    def made(self, camera: Hashable, seconds: float, now: float) -> None:
        """A frame of a camera was made, in so many seconds besides what all frames share."""
        self._parts.pop(camera, None)
        (self._later[self._made[camera]] if camera in self._last else self._first).append(seconds)
        self._made[camera] += 1
        self._last[camera] = now

    def found(self, camera: Hashable) -> None:
        """A frame of a camera need not be made, or cannot."""
        self._count[camera] = self._count.get(camera, 0) - 1

    def left(self, processes: int, now: float) -> float | None:
        """Seconds until all is made by so many processes; None while nothing is known."""
        cold, warm = self._first[:processes], self._first[processes:]
        known = [_mean(warm or cold)] if self._first else []
        if self._traced is not None and not warm:
            known.append(self._traced)
        if not known:
            return None
        costs = Costs.mean(self._later, min(known))
        cameras = [(count, self._made[camera]) for camera, count in self._count.items() if count > self._made[camera]]
        busy = sum(share * costs.at(0) for share, _ in self._parts.values())
        busy += sum(min(now - self._last[x], costs.at(k)) for x in self._last if (k := self._made[x]) < self._count[x])
        return max(0.0, costs.left(cameras, processes) - busy / processes)


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)
