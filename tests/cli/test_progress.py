"""Counting, time left and wording, with a clock that the test turns."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest

from mirelight.batch.pace import Costs, Pace
from mirelight.cli.progress import Bar, Lines, Tally, duration, samples_of
from mirelight.model import Camera
from mirelight.pipeline.frame_clock import FrameClock, for_all_frames
from mirelight.pipeline.plan import FrameTask
from mirelight.store.journal import FileRow, Row
from mirelight.store.planned import PlannedFrame


class Clock:
    """Stands in for time.monotonic."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr(time, "monotonic", lambda: self.now)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def task(name: str) -> FrameTask:
    camera = Camera.perspective(np.eye(4), 4, 4, yfov=45)
    return FrameTask(camera=camera, lighting=None, name=name, files={})


def state(tally: Tally) -> tuple[int, float, float | None]:
    """Frames there, share of the one in progress, seconds left."""
    return tally.there, tally.begun, tally.left


def test_time_left_counts_what_was_made_and_not_what_was_found(clock: Clock) -> None:
    tally = Tally()
    frames = [task(f"f{i}") for i in range(5)]
    tally.started(frames)
    tally.finished(frames[0], None)
    assert state(tally) == (1, 0.0, None)
    clock.now += 300  # previews, say
    tally.samples(frames[1], 32, 64)
    assert state(tally) == (1, 0.5, None)  # of what came before the samples nothing is known
    clock.now += 10
    tally.finished(frames[1], 20.0)
    assert state(tally) == (2, 0.0, 60.0)
    clock.now += 60
    for frame in frames[2:]:
        tally.finished(frame, 20.0)
    assert state(tally) == (5, 0.0, 0.0)
    assert (tally.rendered, tally.skipped) == (4, 1)


def test_lines_for_logs(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    lines = Lines()
    frames = [task("a.day"), task("b.day"), task("c.day")]
    clock.now += 5  # reading the job is not part of the first frame
    lines.started(frames)
    lines.finished(frames[0], None)
    clock.now += 12
    lines.finished(frames[1], 9.0)
    clock.now += 8
    lines.finished(frames[2], 8.0)
    assert capsys.readouterr().err.splitlines() == [
        "[2/3] b.day: made in 12 s, about 9.0 s left",
        "[3/3] c.day: made in 8.0 s",
    ]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.04, "0.0 s"), (9.94, "9.9 s"), (9.96, "10 s"), (59.6, "1 min 0 s"), (185, "3 min 5 s"), (7800, "2 h 10 min")],
)
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("done", "total", "text"),
    [(0, 0, ""), (12, 64, "12/64 samples"), (98_000_000, 157_286_400, "98/157 M samples")],
)
def test_samples(done: int, total: int, text: str) -> None:
    assert samples_of(done, total) == text


# --- the estimate on recorded durations ------------------------------------------------------------------------------

# Seconds that frames of the courtyard took in one process: 20 cameras under 4 lightings, of which the first two are
# traced and the others mixed, 160x90, 8 samples, on a machine with other work. What comes before them (reading,
# kernels, captured light) took 118 s.
PREPARED = 118.0
TAKEN = (
    (1.4, 1.3, 0.3, 0.3), (1.38, 1.15, 0.27, 0.28), (1.4, 1.48, 0.32, 0.32), (1.45, 1.14, 0.28, 0.26),
    (1.34, 1.11, 0.27, 0.29), (1.51, 1.02, 0.33, 0.22), (1.21, 1.1, 0.26, 0.25), (1.24, 0.95, 0.35, 0.31),
    (1.26, 0.98, 0.27, 0.28), (1.23, 0.92, 0.25, 0.26), (1.07, 0.93, 0.22, 0.27), (1.32, 1.07, 0.3, 0.22),
    (1.34, 0.91, 0.31, 0.34), (1.33, 0.91, 0.24, 0.26), (1.48, 1.35, 0.39, 0.26), (1.26, 1.02, 0.29, 0.25),
    (1.27, 1.04, 0.26, 0.26), (1.7, 1.28, 0.28, 0.35), (1.4, 1.12, 0.31, 0.3), (1.56, 1.26, 0.26, 0.23),
)  # fmt: skip


def events(workers: int, taken: Sequence[Sequence[float]]) -> list[tuple[float, int, float | None, float]]:
    """When cameras' frames are made by so many processes, and what each took; or when first frames' samples are heard
    of, and the share. Each process takes the next camera, and its first frame comes after what it prepares."""
    free = [(0.0, PREPARED)] * workers
    found: list[tuple[float, int, float | None, float]] = []
    for camera, frames in enumerate(taken):
        free.sort()
        now, prepared = free[0]
        now += prepared
        found += [(now + frames[0] * 0.35, camera, None, 0.5), (now + frames[0] * 0.7, camera, None, 1.0)]
        for seconds in frames:
            now += seconds
            found.append((now, camera, seconds, 1.0))
        free[0] = now, 0.0
    return sorted(found, key=lambda x: x[0])


@pytest.mark.parametrize("workers", [1, 2, 3, 4])
@pytest.mark.parametrize(("lightings", "turns"), [(4, 1), (1, 3)])
def test_the_time_left_is_right_after_a_tenth(workers: int, lightings: int, turns: int) -> None:
    """Within 20 % from a tenth of the frames on, until few are left and each counts for much."""
    taken = [frames[:lightings] for frames in TAKEN * turns]
    every = events(workers, taken)
    pace, made, total = Pace(dict.fromkeys(range(len(taken)), lightings)), 0, len(taken) * lightings
    looked = 0
    for now, camera, seconds, share in every:
        if seconds is None:
            pace.part(camera, share, now)
        else:
            pace.made(camera, seconds, now)
            made += 1
        if 0.1 * total <= made <= 0.6 * total:
            left = pace.left(workers, now)
            assert left == pytest.approx(every[-1][0] - now, rel=0.2), made
            looked += 1
    assert looked > 0.5 * total


def test_frames_that_need_not_be_made_take_no_time() -> None:
    pace = Pace({"a": 2, "b": 2, "c": 1})
    for _ in range(2):
        pace.found("b")
    pace.made("a", 60.0, 60.0)
    pace.made("a", 2.0, 62.0)
    pace.made("c", 8.0, 70.0)
    assert pace.left(1, 70.0) == 0.0


def test_what_all_frames_share_is_not_taken_for_a_frame_s_time() -> None:
    """Light is gathered for four minutes before the first frame's samples, and for as long before its second light."""
    pace = Pace(dict.fromkeys(range(12), 1))
    for now, share in ((0.0, 0.0), (240.0, 0.25), (242.0, 0.5), (482.0, 0.5), (486.0, 1.0)):
        pace.part(0, share, now)
    assert pace.left(1, 486.0) == 11 * 8.0
    pace.made(0, 9.0, 489.0)
    assert pace.left(1, 489.0) == 11 * 8.0  # without its kernels
    pace.made(1, 7.0, 496.0)
    assert pace.left(1, 496.0) == 10 * 7.0


def test_a_frame_s_clock_stands_while_what_all_frames_share_is_made(clock: Clock) -> None:
    class Scene:
        def __init__(self) -> None:
            self.clock = FrameClock()

        @cached_property
        @for_all_frames
        def light(self) -> int:
            clock.now += 100
            return self.mesh()

        @for_all_frames
        def mesh(self) -> int:
            clock.now += 1000
            return 7

    scene = Scene()
    began = scene.clock.now()
    clock.now += 3
    assert scene.light == scene.light == 7
    clock.now += 4
    assert scene.clock.now() - began == 7


def test_costs_from_a_journal() -> None:
    """The first row of each process is its cold one; failed and half-written frames do not count."""
    keys = {".exr": "e", ".png": "p"}
    wanted = {f"{c}{i}": PlannedFrame(f"{c}{i}", c, "", keys, c) for c in "abcd" for i in range(3)}

    def row(name: str, seconds: float, **changed: Any) -> Row:
        return Row(name, {s: FileRow(key, 1, 1, "") for s, key in keys.items()}, seconds, **changed)

    one = [row("a0", 99.0), row("a1", 2.0), row("a2", 1.0), row("b0", 10.0), row("b1", 4.0)]
    two = [
        row("c0", 77.0),
        replace(row("c1", 55.0), files={}),
        row("d0", 20.0),
        row("d9", 5.0),
        row("d1", 0.0, error="x"),
    ]
    costs = Costs.of([one, two], wanted)
    assert costs is not None and costs.places[:3] == (15.0, 3.0, 1.0)
    assert costs.left([(3, 0), (3, 2)], 1) == 20.0 and costs.left([(3, 0), (3, 0), (3, 0)], 2) == 28.5
    assert Costs.of([], wanted) is None


def test_a_bar_shows_what_all_frames_share_and_how_long_it_took(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = io.StringIO()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    monkeypatch.setenv("COLUMNS", "120")
    frame = task("a.day")
    with Bar() as bar:
        bar.started([frame])
        bar.making("taking depth maps", 0.3)
        bar._bar.refresh()
        bar.finished(frame, 1.0)
    shown = terminal.getvalue()
    assert "taking depth maps" in shown and "0:00:0" in shown and "1/1 frames" in shown
