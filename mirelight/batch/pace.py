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

_LEAST = 1.0  # first frames of cameras that warm processes must have made before they count
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
        now: when the run begins.
    """

    def __init__(self, frames: Mapping[Hashable, int], now: float) -> None:
        self._count = dict(frames)
        self._made: dict[Hashable, int] = defaultdict(int)
        self._began = now
        self._last: dict[Hashable, float] = {}  # by camera that has a frame, when its last one was made
        self._first: list[float] = []  # when cameras' first frames were made
        self._later: dict[int, list[float]] = defaultdict(list)  # by place, what other frames took
        self._parts: dict[Hashable, float] = {}  # by camera, how much of its first frame is done
        self._heard: dict[Hashable, tuple[float, float]] = {}  # when its samples were first heard of, how many
        self._traced: float | None = None  # seconds that all samples of a cold process's frame take

    def part(self, camera: Hashable, share: float, now: float) -> None:
        """So much of a frame of a camera is done, 0 to 1."""
        if camera in self._last:
            return
        self._parts[camera] = share
        began, before = self._heard.setdefault(camera, (now, share))
        if share - before >= _SPAN and not self._first:
            self._traced = (now - began) / (share - before)

    def made(self, camera: Hashable, now: float) -> None:
        """A frame of a camera was made."""
        self._parts.pop(camera, None)
        if camera in self._last:
            self._later[self._made[camera]].append(now - self._last[camera])
        else:
            self._first.append(now)
        self._made[camera] += 1
        self._last[camera] = now

    def found(self, camera: Hashable) -> None:
        """A frame of a camera need not be made, or cannot."""
        self._count[camera] = self._count.get(camera, 0) - 1

    def left(self, processes: int, now: float) -> float | None:
        """Seconds until all is made by so many processes; None while nothing is known."""
        costs = self._costs(processes, now)
        if costs is None:
            return None
        cameras = [(count, self._made[camera]) for camera, count in self._count.items() if count > self._made[camera]]
        busy = sum(share * costs.at(0) for share in self._parts.values()) + self._underway(costs, now)
        return max(0.0, costs.left(cameras, processes) - busy / processes)

    def _underway(self, costs: Costs, now: float) -> float:
        """Seconds of work in later frames that are in progress."""
        return sum(
            min(now - at, costs.at(self._made[camera]))
            for camera, at in self._last.items()
            if self._count[camera] > self._made[camera]
        )

    def _costs(self, processes: int, now: float) -> Costs | None:
        cold = self._first[:processes]
        begun = sum(self._parts.values()) if len(cold) == processes else 0.0
        warm = len(self._first) - len(cold) + begun
        if warm >= _LEAST:  # all the time of processes that had made a frame, but for what they spent on others
            spent = sum(now - at for at in cold) - sum(sum(x) for x in self._later.values())
            first = max(spent - self._underway(Costs.mean(self._later, spent / warm), now), 0.0) / warm
        elif cold:
            first = _mean([at - self._began for at in cold])
            first = first if self._traced is None else min(first, self._traced)
        elif self._traced is not None:
            first = self._traced
        else:
            return None
        return Costs.mean(self._later, first)


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)
