"""`mirelight render --preview`: frames are shown while they are made, and come out the same to the bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirelight import load
from mirelight.apps.show import shots
from mirelight.batch import executor, preview
from mirelight.batch.preview import Previews
from mirelight.model import Frame, Job
from mirelight.pipeline import stages
from mirelight.pipeline.plan import FrameTask, plan
from mirelight.pipeline.scene import prepare
from mirelight.store import Store

from .conftest import Run

SETTINGS = ["render.spp=48", "resolution=[320, 240]", "output.half=true"]


def test_frames_are_the_same_and_no_preview_is_left(folder: Path, run: Run) -> None:
    small = [x for setting in ("render.spp=4", "output.aovs=false") for x in ("--set", setting)]
    shown = run("render", "job.toml", "-o", "shown", "--preview", "--camera", "front", *small)
    plain = run("render", "job.toml", "-o", "plain", "--camera", "front", *small)
    assert (shown.returncode, plain.returncode) == (0, 0), shown.stderr
    assert "first a quick picture of 2 frames" in shown.stderr
    names = sorted(x.name for x in (folder / "plain").glob("*.*"))
    assert sorted(x.name for x in (folder / "shown").glob("*.*")) == names
    for name in names:
        if not name.startswith("."):
            assert (folder / "shown" / name).read_bytes() == (folder / "plain" / name).read_bytes()
    both = run("render", "job.toml", "--preview", "--workers", "2")
    assert (both.returncode, both.stderr.count("\n")) == (2, 1)


class Pictures(Previews):
    """Notes what is shown: the frame, the size of the picture, and the picture."""

    def __init__(self, store: Store) -> None:
        super().__init__(store, executor.Progress())
        self.shown: list[tuple[str, np.ndarray]] = []
        put = store.put_preview

        def noted(task: FrameTask, frame: object) -> None:
            put(task, frame)  # type: ignore[arg-type]
            with Image.open(store.preview_path(task)) as image:
                self.shown.append((task.name, np.asarray(image).astype(int)))

        store.put_preview = noted  # type: ignore[method-assign]


class Stops(executor.Progress):
    """Ctrl-C once a frame has so many samples."""

    def __init__(self, share: float) -> None:
        self._share = share

    def samples(self, task: FrameTask, done: int, total: int) -> None:
        if done > self._share * total:
            raise KeyboardInterrupt


def test_a_running_frame_shows_itself_and_gets_better(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preview, "_EVERY", 0.0)
    monkeypatch.setattr(preview, "_SHARE", 0)
    job = load(folder / "job.toml", [*SETTINGS, f"output.directory={str(folder / 'out')!r}"])
    store = Store(job)
    store.open()
    pictures = Pictures(store)
    work = plan(job, cameras=["front"], lightings=["night"])
    with pytest.raises(KeyboardInterrupt):
        executor.run(work, store, Stops(0.9), pictures)
    (task,) = work.tasks
    quick, *running = pictures.shown
    assert quick[1].shape == (120, 160, 3)
    assert len(running) >= 2 and all(x.shape == (240, 320, 3) for _, x in running)
    assert store.preview_path(task).is_file() and not store.has(task)
    assert not store.index().has(task)

    executor.run(work, store)  # nobody asks for previews now
    assert store.has(task) and not store.preview_path(task).exists()
    with Image.open(folder / "out" / "front.night.png") as image:
        done = np.asarray(image).astype(int)
    errors = [float(np.abs(x - done).mean()) for _, x in running]
    assert errors[-1] < errors[0] and errors[-1] < 2
    small = done.reshape(120, 2, 160, 2, 3).mean(axis=(1, 3))
    assert np.abs(quick[1] - small).mean() < 6
    store.close()


def test_where_layers_alone_are_kept_frames_are_shown_too(folder: Path) -> None:
    job = load(folder / "job.toml", ["output.store=layers", f"output.directory={str(folder / 'out')!r}"])
    store = Store(job)
    store.open()
    pictures = Pictures(store)
    made = executor.run(plan(job, cameras=["front"]), store, None, pictures)
    assert made.rendered == 2
    assert [name for name, _ in pictures.shown] == ["front.day", "front.night"]
    assert not list((folder / "out").glob("*.png"))
    store.close()


def test_frames_of_lightings_called_preview_and_partial_are_frames(folder: Path) -> None:
    """Their names are those that other frames' previews and interrupted tries have."""
    text = (folder / "job.toml").read_text()
    for name in ("preview", "partial"):
        text += f'\n[[lightings]]\nname = "night.{name}"\nlights = [{{ type = "point", position = [1, 3, 1] }}]\n'
    (folder / "job.toml").write_text(text)
    job = load(folder / "job.toml", ["render.spp=1", f"output.directory={str(folder / 'out')!r}"])
    store = Store(job)
    store.open()
    others = plan(job, cameras=["front"], lightings=["night.preview", "night.partial"])
    executor.run(others, store)
    kept = {path: path.read_bytes() for path in (folder / "out").glob("front.*")}
    assert {f"front.night.{name}.png" for name in ("preview", "partial")} <= {path.name for path in kept}
    (task,) = plan(job, cameras=["front"], lightings=["night"]).tasks
    frame = relight_one(job, task)
    for step in (store.put_preview, store.put_partial, store.put):
        step(task, frame)
        assert {path: path.read_bytes() for path in kept} == kept
    store.drop_preview(task)
    assert {path: path.read_bytes() for path in kept} == kept
    assert all(store.has(x) for x in (*others.tasks, task))
    store.put_preview(others.tasks[0], frame)
    assert {x.name for x in shots.of_folder(folder / "out")} == {x.name for x in (*others.tasks, task)}
    store.close()


def relight_one(job: Job, task: FrameTask) -> Frame:
    return stages.frame(prepare(job), task.camera, task.lighting)
