"""docs/tutorials, and the page of what cannot be removed: every job, command and Python block, in its order, in a clone
with toy scenes; the first tutorial is a recorded session with a test of its own.

Fences of `toml` begin with a comment that names the file; `sh` holds mirelight's commands alone; what other programs do
stands in fences without a language.
"""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

import mirelight
from mirelight import cli, dataset
from mirelight.dataset.draws import Draws

from .toy_clone import ROOT, TOY, make_clone

DOCS = ROOT / "docs"
SMALL, SMALLEST = "resolution=[24, 16]", "resolution=[12, 8]"
_FENCE = re.compile(r"^```(toml|sh|python)\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    make_clone(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def fences(name: str, *kinds: str) -> list[tuple[str, str]]:
    """Kind and body of a page's fences of some kinds, in order."""
    text = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    found = [(kind, body) for kind, body in _FENCE.findall(text) if kind in kinds]
    assert found, f"{name}.md has no fence of {kinds}"
    return found


def commands(body: str) -> Iterator[list[str]]:
    """What is typed in a fence of `sh`, without the program's name."""
    for line in body.splitlines():
        program, *arguments = shlex.split(line, comments=True) or ["mirelight"]
        assert program == "mirelight", line
        if arguments:
            yield arguments


def run(*arguments: str, small: Sequence[str] = ()) -> None:
    """One command, its job at toy size; the engine's browser is left to tests/cli/test_realtime.py."""
    more = {"render": small, "realtime": [*small, "--export-only"], "explain": [*small, "--no-engine"]}
    assert cli.main([*arguments, *more.get(arguments[0], ())]) == 0, " ".join(arguments)


def follow(
    name: str, *settings: str, size: str = SMALL, before: Mapping[str, Callable[[], None]] = MappingProxyType({})
) -> None:
    """Write the page's jobs and run its commands, jobs at toy size; before some of them what others do meanwhile."""
    small = [x for s in (size, *TOY, *settings) for x in ("--set", s)]
    for kind, body in fences(name, "toml", "sh"):
        if kind == "toml":
            Path(body.partition("\n")[0].removeprefix("# ")).write_text(body, encoding="utf-8")
            continue
        for arguments in commands(body):
            if arguments[0] in before:
                before[arguments[0]]()
            run(*arguments, small=small)


def test_every_tutorial_is_tested() -> None:
    here = Path(__file__).read_text(encoding="utf-8")
    pages = {f"tutorials/{x.stem}" for x in (DOCS / "tutorials").glob("*.md")} - {"tutorials/first-capture"}
    assert sorted(x for x in pages if f'follow("{x}"' not in here) == []


def test_a_turntable_film(clone: Path) -> None:
    import av

    follow("tutorials/turntable", size=SMALLEST)
    with av.open(str(clone / "turn.mp4")) as film:
        stream = film.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24").astype(np.float64) for frame in film.decode(stream)]
        assert stream.average_rate == 24
    assert len(pictures) == 39 and pictures[0].shape == (8, 12, 3)
    assert np.abs(pictures[-1] - pictures[0]).mean() > 1


def test_a_day_in_24_frames(clone: Path) -> None:
    follow("tutorials/day", size=SMALLEST)
    out = clone / "out" / "day"
    frames = sorted(out.glob("*.png"))
    assert len(frames) == 24 and frames[0].stem == "front.lighting-time20260621T070000"
    view = dataset.open(out)
    inside = view.geometry("front").coverage == 1
    level = [float(view.frame("front", name)[inside, :3].mean()) for name in view.lightings]
    assert 9 <= int(np.argmax(level)) <= 15 and max(level[0], level[-1]) < max(level) / 2
    with Image.open("day.webp") as film:
        assert film.n_frames == 24  # type: ignore[attr-defined]


def test_one_light_at_a_time(clone: Path, capsys: pytest.CaptureFixture[str]) -> None:
    follow("tutorials/one-light")
    view = dataset.open("out/one")
    assert view.lightings == ("spots", "spots-key", "spots-rim", "spots-fill")
    assert len({unit.group for unit in view.lights[:3]}) == 1  # one trace of the lamps; the capture's light is the last
    whole, *alone = view.lightings
    assert np.allclose(np.sum([view.weights(x) for x in alone], axis=0), view.weights(whole))
    assert "6 frames" in capsys.readouterr().out
    ((_, block),) = fences("tutorials/one-light", "python")
    exec(block, {})
    assert capsys.readouterr().out.splitlines()[-1] == "(16, 24, 4)"


class Loader:
    """What torch's DataLoader does with a map-style data set of named tuples, without torch: indices in order, and
    batches field by field."""

    def __init__(self, data: Any, batch_size: int, num_workers: int) -> None:
        assert num_workers == 2
        self._data, self._size = data, batch_size

    def __iter__(self) -> Iterator[Any]:
        for start in range(0, len(self._data), self._size):
            samples = [self._data[i] for i in range(start, min(start + self._size, len(self._data)))]
            yield type(samples[0])(*(np.stack([np.asarray(x) for x in field]) for field in zip(*samples, strict=True)))


class Streaming:
    """What torch's DataLoader does with an iterable data set: every worker iterates it, and says which one it is."""

    def __init__(self, info: list[Any]) -> None:
        self._info = info

    def __call__(self, data: Any, batch_size: int, num_workers: int) -> Iterator[Any]:
        for number in range(num_workers):
            self._info[0] = SimpleNamespace(id=number, num_workers=num_workers)
            samples = list(data)
            assert len(samples) == batch_size
            yield type(samples[0])(*(np.stack([np.asarray(x) for x in field]) for field in zip(*samples, strict=True)))


def test_training_in_pytorch(clone: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    follow("tutorials/pytorch", size=SMALLEST)
    data = ModuleType("torch.utils.data")
    data.DataLoader = Loader  # type: ignore[attr-defined]
    modules = {"torch": ModuleType("torch"), "torch.utils": ModuleType("torch.utils"), "torch.utils.data": data}
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    capsys.readouterr()
    indexed, geometry, loop, streamed, parted = (body for _, body in fences("tutorials/pytorch", "python"))
    exec(indexed, {})
    assert capsys.readouterr().out.splitlines() == ["(4, 8, 12, 4) (4, 13, 3)"] * 2  # twelve lamps, the captured light
    exec(geometry, {})
    assert capsys.readouterr().out == "(8, 12) (8, 12, 3) (8, 12, 3)\n"
    exec(loop, {})
    assert float(capsys.readouterr().out.split()[2]) < 0.5  # of lightings that it never saw

    workers: list[Any] = [None]
    data.IterableDataset = object  # type: ignore[attr-defined]
    data.get_worker_info = lambda: workers[0]  # type: ignore[attr-defined]
    data.DataLoader = Streaming(workers)  # type: ignore[attr-defined]
    exec(streamed, {})
    assert capsys.readouterr().out.splitlines() == ["(4, 8, 12, 4)"] * 2
    exec(parted, {})
    assert sum(int(x) for x in capsys.readouterr().out.split()) == 24
    draws = Draws(dataset.open("out/lamps"), count=7, seed=3)
    assert all(not draw.weights[12].any() for draw in draws)
    parts = [list(draws.part(i, 3)) for i in range(3)]
    assert [len(x) for x in parts] == [3, 2, 2]
    assert all(np.array_equal(parts[i % 3][i // 3].rgba, draws[i].rgba) for i in range(7))


def test_what_cannot_be_removed(clone: Path) -> None:
    follow("explanation/cannot-be-removed")
    assert (clone / "out" / "even" / "front.lighting.exr").is_file()
    assert (clone / "out" / "gloss" / "front.spots.exr").is_file()


def test_comparing_with_real_time(clone: Path) -> None:
    """Ours stands for the engine's frame."""

    def engine() -> None:
        shutil.copy("out/traced/front.spots.png", "out/live/front.spots/frame.png")

    follow("tutorials/real-time", before={"compare": engine})
    assert (clone / "out" / "live" / "front.spots" / "physical.png").is_file()
    assert "front.spots" in (clone / "report.html").read_text(encoding="utf-8")
    assert (clone / "out" / "why" / "explain.html").is_file()


def test_ten_thousand_frames_on_slurm(clone: Path) -> None:
    """The job is 10,000 frames; four of them are made, as a node would, before the state of the folder is read."""
    few = ("cameras[0].count=2", "sweep.axes[0].steps=2", "sweep.axes[1].steps=1")

    def shards() -> None:
        for part in ("1/2", "2/2"):
            run("render", "film.toml", "--shard", part, small=[x for s in (*few, *TOY, SMALLEST) for x in ("--set", s)])

    follow("tutorials/slurm", *few, size=SMALLEST, before={"status": shards})
    job = mirelight.load("film.toml")
    assert len(job.cameras) * len(job.lightings) == 10_000
    script = (clone / "film.sh").read_text(encoding="utf-8")
    assert "#SBATCH --array=1-100" in script and str(clone / "film.toml") in script
    assert len(list((clone / "out" / "film").glob("*.exr"))) == 4
