"""The tasks of docs/datasets.md, run as they stand at toy size."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mirelight import cli, dataset
from mirelight.dataset.draws import Draws

from .test_dataset_view import make_scene

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "datasets.md").read_text(encoding="utf-8")


def blocks(heading: str, kind: str) -> list[str]:
    section = PAGE.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    return re.findall(rf"```{kind}\n(.*?)```", section, flags=re.DOTALL)


def render(folder: Path, heading: str, *more: str) -> Path:
    make_scene(folder)
    (text,) = blocks(heading, "toml")
    path = folder / "job.toml"
    path.write_text(text, encoding="utf-8")
    settings = ("resolution=[12, 8]", "render.spp=1", *more)
    assert cli.main(["render", str(path), "-q", *(x for s in settings for x in ("--set", s))]) == 0
    return folder / "out"


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


def test_one_light_at_a_time_and_training_on_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = render(tmp_path, "One light at a time")
    view = dataset.open(out)
    assert view.lightings == ("lighting", "lighting-left", "lighting-right")
    assert len({unit.group for unit in view.lights}) == 1  # one trace
    whole, left, right = (view.frame("front", name)[..., :3] for name in view.lightings)
    background = 1.0  # of the factor, beyond the proxy
    inside = view.geometry("front").coverage == 1
    assert background and np.allclose((left + right)[inside], whole[inside], rtol=1e-4, atol=1e-6)
    assert cli.main(["export", str(out), "--layout", "olat", "-o", str(tmp_path / "set")]) == 0
    assert "2 frames" in capsys.readouterr().out

    data = ModuleType("torch.utils.data")
    data.DataLoader = Loader  # type: ignore[attr-defined]
    modules = {"torch": ModuleType("torch"), "torch.utils": ModuleType("torch.utils"), "torch.utils.data": data}
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.chdir(tmp_path)
    indexed, streamed = blocks("Train on it in PyTorch", "python")
    exec(indexed, {})
    assert capsys.readouterr().out.splitlines() == ["(4, 8, 12, 4) (4, 2, 3)"] * 2

    workers: list[Any] = [None]
    data.IterableDataset = object  # type: ignore[attr-defined]
    data.get_worker_info = lambda: workers[0]  # type: ignore[attr-defined]
    data.DataLoader = Streaming(workers)  # type: ignore[attr-defined]
    exec(streamed, {})
    assert capsys.readouterr().out.splitlines() == ["(4, 8, 12, 4)"] * 2
    draws = Draws(view, count=7, seed=3)
    parts = [list(draws.part(i, 3)) for i in range(3)]
    assert [len(x) for x in parts] == [3, 2, 2]
    assert all(np.array_equal(parts[i % 3][i // 3].rgba, draws[i].rgba) for i in range(7))


def test_a_turntable_film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import av

    render(tmp_path, "A turntable film", "cameras[0].frames=6")
    (command,) = re.findall(r"^    mirelight (film .*)$", PAGE, flags=re.MULTILINE)
    monkeypatch.chdir(tmp_path)
    assert cli.main(command.split()) == 0
    with av.open(str(tmp_path / "turn.mp4")) as film:
        stream = film.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24").astype(np.float64) for frame in film.decode(stream)]
        assert stream.average_rate == 24
    assert len(pictures) == 6 and pictures[0].shape == (8, 12, 3)
    assert all(np.abs(a - b).mean() > 1 for a, b in pairwise(pictures))


def test_a_day_in_24_frames(tmp_path: Path) -> None:
    out = render(tmp_path, "A day in 24 frames", "output.exr=false")
    frames = sorted(out.glob("*.png"))
    assert len(frames) == 24 and frames[0].stem == "front.lighting-time20260621T053000"
    view = dataset.open(out)
    level = [float(view.frame("front", name)[..., :3].mean()) for name in view.lightings]
    assert 9 <= int(np.argmax(level)) <= 15 and level[0] < 0.2 * max(level) and level[-1] < 0.2 * max(level)
