"""Lightings over time: lights of animated files at one moment, at many, or at the times of the job's cameras."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from mirelight.io.job.assets import Assets
from mirelight.io.job.light_tables import AT_CAMERAS, MOST_MOMENTS, LightsFromTable, Lit
from mirelight.io.job.lighting import lighting
from mirelight.io.job.mistakes import Mistake
from mirelight.io.job.positions import Path
from mirelight.io.job.tables import JobTable
from mirelight.model import Camera, Lighting

_MOST_LIGHTS = 1_000_000  # over all moments of a lighting
Cameras = Callable[[], Sequence[Camera]]  # of the job; found when first asked for


def of_table(name: str, table: Lit, at: Path, files: Assets, cameras: Cameras, wrong: list[Mistake]) -> list[Lighting]:
    """The lightings of a table: one, or as many as its lights have moments, all with one name.

    Args:
        name: of the lighting.
        table: what it holds.
        at: where it stands in the job.
        files: reads what it names.
        cameras: the job's; those of animated files know their times.
        wrong: gets what is wrong.
    """
    places = [(*at, "lights_from", i) for i in range(len(table.lights_from))]
    moving = [(one, place) for one, place in zip(table.lights_from, places, strict=True) if moves(one)]
    if not moving:
        return [lighting(name, table, at, files, wrong)]
    whole = _Moving(name, table, at, files, moving, wrong)
    return whole.of_cameras(cameras()) if any(one.time == AT_CAMERAS for one, _ in moving) else whole.of_files()


@dataclass(frozen=True, slots=True)
class _Moving:
    """A lighting whose lights move."""

    name: str
    table: Lit
    at: Path
    files: Assets
    moving: list[tuple[LightsFromTable, Path]]  # its files that do, and where they stand in the job
    wrong: list[Mistake]

    def of_files(self) -> list[Lighting]:
        """At the moments that each file gives by itself."""
        times = [self.files.light_times(one.path, one.fps, one.frames) for one, _ in self.moving]
        for (_, place), own in zip(self.moving, times, strict=True):
            if len(own) > MOST_MOMENTS:
                self.wrong.append(Mistake(place, f"{len(own):,} moments", f"at most {MOST_MOMENTS:,}"))
                return []
            if len(own) != len(times[0]):
                found = f"{len(own)} moments, and the first file of this lighting has {len(times[0])}"
                self.wrong.append(Mistake(place, found, "give both the same frames"))
                return []
        return self._all_at([[t[k] for t in times] for k in range(len(times[0]))])

    def of_cameras(self, cameras: Sequence[Camera]) -> list[Lighting]:
        """At the times of the job's cameras."""
        for one, place in self.moving:
            if one.time != AT_CAMERAS:
                remedy = f'give all of them time = "{AT_CAMERAS}"'
                self.wrong.append(Mistake(place, "moments of its own beside lights at the cameras' times", remedy))
                return []
        still = next((x.name for x in cameras if x.time is None), None)
        if still is not None:
            found = f'"{AT_CAMERAS}", and the camera {still!r} is of no animation'
            remedy = "give cameras_from its fps or frames, or the lights a time"
            self.wrong.append(Mistake((*self.moving[0][1], "time"), found, remedy))
            return []
        times = sorted({x.time for x in cameras if x.time is not None})
        made = self._all_at([[t] * len(self.moving) for t in times])
        return [replace(one, time=t) for one, t in zip(made, times, strict=False)]

    def _all_at(self, moments: Sequence[Sequence[float]]) -> list[Lighting]:
        """At each moment, by the times of the moving files; none, and a mistake, where that is too much."""
        out: list[Lighting] = []
        for times in moments:
            out.append(self._at(times))
            if len(out[0].lights) * len(moments) > _MOST_LIGHTS:
                found = f"{len(moments):,} moments of {len(out[0].lights):,} lights"
                remedy = f"take fewer: {_MOST_LIGHTS:,} in all are the most"
                self.wrong.append(Mistake((*self.at, "lights_from"), found, remedy))
                return []
        return out

    def _at(self, times: Sequence[float]) -> Lighting:
        """With each moving file at its time."""
        left = iter(times)
        still = {"fps": None, "frames": None}
        files = self.table.lights_from
        tables = [x.model_copy(update={**still, "time": next(left)}) if moves(x) else x for x in files]
        found: list[Mistake] = []
        table = self.table.model_copy(update={"lights_from": tables})
        made = lighting(self.name, table, self.at, self.files, found)
        self.wrong.extend([x for x in found if x not in self.wrong])  # each moment would say the same
        return made


def moves(table: LightsFromTable) -> bool:
    """Whether the lights of a file have more moments than one."""
    return table.time == AT_CAMERAS or table.fps is not None or table.frames is not None


def numbered(lightings: Sequence[Lighting], moments: Sequence[bool]) -> tuple[Lighting, ...]:
    """Lightings with names of their own: the moments of one are counted from 1."""
    counts: dict[str, int] = {}
    out = []
    for one, is_moment in zip(lightings, moments, strict=True):
        counts[one.name] = counts.get(one.name, 0) + 1
        out.append(replace(one, name=f"{one.name}-{counts[one.name]:04d}") if is_moment else one)
    return tuple(out)


def mistakes(table: JobTable) -> Iterator[Mistake]:
    """What a job with lights that move cannot have."""
    moving_files = [one for lit in (table, *table.lightings) for one in lit.lights_from if moves(one)]
    captured = table.captured
    for i, one in enumerate(captured.lights_from if captured is not None else ()):
        if moves(one):
            found = "captured light that moves"
            yield Mistake(("captured", "lights_from", i), found, "give the time at which the capture was made")
    if not moving_files:
        return
    moving = {one.name for one in table.lightings if any(moves(x) for x in one.lights_from)}
    if captured is not None and captured.lighting in moving:
        yield Mistake(("captured",), "a lighting that moves", "name one whose lights_from has a time")
    if table.sweep is not None:
        yield Mistake(("sweep",), "a sweep of lights that move", "give lights_from a time")
    if any(one.time == AT_CAMERAS for one in moving_files):
        if table.output.store == "layers":
            found = '"layers", and lights at the cameras\' times'
            yield Mistake(("output", "store"), found, 'every camera has lights of its own: give "both" or "frames"')
        if table.dataset.layouts:
            found = "data sets of lights at the cameras' times"
            yield Mistake(("dataset", "layouts"), found, "they have every camera under every lighting: leave it out")
