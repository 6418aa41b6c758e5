"""Counting, time left and wording, with a clock that the test turns."""

from __future__ import annotations

import time

import numpy as np
import pytest

from mirelight.cli.progress import Lines, Tally, duration, samples_of
from mirelight.model import Camera
from mirelight.plan import FrameTask


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
    tally.finished(frames[0], True)
    assert state(tally) == (1, 0.0, None)
    clock.now += 10
    tally.samples(frames[1], 32, 64)
    assert state(tally) == (1, 0.5, 70.0)  # half a frame in 10 s: 3.5 frames are left
    clock.now += 10
    tally.finished(frames[1], False)
    assert state(tally) == (2, 0.0, 60.0)
    clock.now += 60
    for frame in frames[2:]:
        tally.finished(frame, False)
    assert state(tally) == (5, 0.0, 0.0)
    assert (tally.rendered, tally.skipped) == (4, 1)


def test_lines_for_logs(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    lines = Lines()
    frames = [task("a.day"), task("b.day"), task("c.day")]
    clock.now += 5  # reading the job is not part of the first frame
    lines.started(frames)
    lines.finished(frames[0], True)
    clock.now += 12
    lines.finished(frames[1], False)
    clock.now += 8
    lines.finished(frames[2], False)
    assert capsys.readouterr().err.splitlines() == [
        "[1/3] a.day: already there",
        "[2/3] b.day: made in 12 s, about 12 s left",
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
