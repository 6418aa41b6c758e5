"""A job whose proxy is made from its splats: once, kept beside its frames, and in frames' keys."""

from __future__ import annotations

import json
import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight import cli
from mirelight.base.errors import InputError
from mirelight.batch import executor
from mirelight.batch.forecast import forecast
from mirelight.io import splats
from mirelight.io.exr import read_exr
from mirelight.pipeline import keys
from mirelight.pipeline.plan import plan
from mirelight.store import Store
from mirelight.store.arrays import read_arrays
from tests.proxy.clouds import ball

JOB = """\
splats = "ball.ply"
proxy = "splats"
resolution = [48, 32]
environment = { radiance = 1.0 }

[render]
spp = 4
indirect = "traced"
"""


@pytest.fixture
def job(tmp_path: Path) -> Path:
    splats.write(ball(1000, thin=0.05), tmp_path / "ball.ply")  # discs, whose cells are made soonest
    path = tmp_path / "job.toml"
    path.write_text(JOB, encoding="utf-8")
    return path


class Noted(executor.Progress):
    def __init__(self) -> None:
        self.lines: list[str] = []
        self.made: list[tuple[str, float]] = []

    def note(self, line: str) -> None:
        self.lines.append(line)

    def making(self, what: str, done: float) -> None:
        self.made.append((what, done))


def rendered(work: mirelight.Job) -> list[str]:
    store, noted = Store(work), Noted()
    store.open()
    try:
        executor.run(plan(work), store, noted)
    finally:
        store.close()
    return [line for line in noted.lines if "proxy mesh" in line]


def test_it_is_made_once_and_found_again(job: Path, cache: Path) -> None:
    first = rendered(mirelight.load(job))
    assert len(first) == 2 and "making the proxy mesh" in first[0]
    frame = job.parent / "out" / "camera.lighting.exr"
    before = frame.read_bytes()
    frame.unlink()
    (job.parent / "out" / "camera.lighting.png").unlink()
    assert rendered(mirelight.load(job)) == []
    assert frame.read_bytes() == before
    frame.unlink()
    for kept in (*(job.parent / "out" / ".mirelight" / "scene").iterdir(), *cache.iterdir()):
        kept.write_bytes(kept.read_bytes()[:100])  # a damaged one is made anew
    assert len(rendered(mirelight.load(job))) == 2
    assert frame.read_bytes() == before


class Stopped(Noted):
    """A signal has come while the mesh is made."""

    def making(self, what: str, done: float) -> None:
        super().making(what, done)
        if done > 0:
            raise KeyboardInterrupt


def test_whoever_waits_hears_how_far_it_is_and_may_stop_it(job: Path, cache: Path) -> None:
    work = mirelight.load(job)
    store, stopped, noted = Store(work), Stopped(), Noted()
    store.open()
    try:
        with pytest.raises(KeyboardInterrupt):
            executor.run(plan(work), store, stopped)
        executor.run(plan(work), store, noted)  # nothing of it was kept
    finally:
        store.close()
    assert any("making the proxy mesh" in line for line in noted.lines)
    assert noted.made[:2] == stopped.made[:2] == [("reading the splats", 0.0), ("looking at the splats", 0.0)]
    assert "judging the proxy" in dict(noted.made)
    assert all(0 <= done <= 1 for _, done in noted.made)


def test_a_forecast_keeps_it_and_says_so(job: Path, cache: Path) -> None:
    noted = Noted()
    forecast(plan(mirelight.load(job)), noted)
    assert "making the proxy mesh" in noted.lines[0]
    assert {"looking at the splats", "timing small frames"} <= {what for what, _ in noted.made}
    assert rendered(mirelight.load(job)) == []


def test_it_is_found_from_any_folder(job: Path, cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of another output folder, and by a command that has none; the frames are the same to the bit."""
    assert len(rendered(mirelight.load(job, ["output.directory=one"]))) == 2
    assert rendered(mirelight.load(job, ["output.directory=two"])) == []
    one, two = (job.parent / name / "camera.lighting.exr" for name in ("one", "two"))
    assert read_exr(one).channels.keys() == read_exr(two).channels.keys()
    for name, plane in read_exr(one).channels.items():
        np.testing.assert_array_equal(plane, read_exr(two).channels[name])
    kept = (job.parent / "two" / ".mirelight" / "scene").glob("*.array")
    assert sum("faces" in read_arrays(x).arrays for x in kept) == 1  # for those who share the folder alone
    assert cli.main(["inspect", str(job), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["proxy_to_make"] is False
    shutil.rmtree(cache)
    cache.write_text("in the way")  # nothing can be kept there, and nothing is said
    assert len(rendered(mirelight.load(job, ["output.directory=three"]))) == 2
    assert cache.read_text() == "in the way"


def test_the_mesh_stands_where_the_splats_do(job: Path) -> None:
    job.write_text(
        JOB.replace('"ball.ply"', '{ path = "ball.ply", transform = { translation = [5, 0, 0], scale = 2 } }'),
        encoding="utf-8",
    )
    mesh = mirelight.prepare(mirelight.load(job)).mesh
    assert mesh is not None
    radii = np.linalg.norm(mesh.vertices - (5, 0, 0), axis=1)
    assert np.abs(radii - 2).max() < 0.1


def test_its_albedo_is_not_part_of_the_making(job: Path) -> None:
    gray, dark = mirelight.load(job), mirelight.load(job, ['proxy={path="splats",albedo=0.2}'])
    assert gray.proxy is not None and dark.proxy is not None
    assert gray.proxy.digest != dark.proxy.digest
    assert keys.Keys(gray).made_proxy == keys.Keys(dark).made_proxy
    moved = mirelight.load(job, ['splats={path="ball.ply",transform={scale=2}}'])
    assert keys.Keys(moved).made_proxy != keys.Keys(gray).made_proxy
    light = [keys.Keys(x).frame(x.cameras[0], x.lightings[0]) for x in (gray, dark, moved)]
    assert len(set(light)) == 3
    mesh = mirelight.prepare(dark).mesh
    assert mesh is not None and mesh.albedo is not None and np.allclose(mesh.albedo, 0.2)


def test_a_sent_job_makes_the_same(job: Path) -> None:
    work = mirelight.load(job)
    sent = pickle.loads(pickle.dumps(work))
    ours, theirs = mirelight.prepare(work).mesh, mirelight.prepare(sent).mesh
    assert ours is not None and theirs is not None
    np.testing.assert_array_equal(ours.vertices, theirs.vertices)
    np.testing.assert_array_equal(ours.faces, theirs.faces)


CAMERAS = "x,y,z,target_x,target_y,target_z,yfov,width,height\n0,0,4,0,0,0,60,64,64\n0,0,-4,0,0,0,60,64,64\n"


def test_the_captures_cameras_stand_where_its_splats_do(job: Path) -> None:
    """What hides from them just inside the ball is closed, wherever the ball is; and it is another mesh."""
    (job.parent / "taken.csv").write_text(CAMERAS, encoding="utf-8")
    with_cameras = 'proxy={path="splats",cameras="taken.csv"}'
    plain, closed = mirelight.load(job), mirelight.load(job, [with_cameras])
    assert keys.Keys(plain).made_proxy != keys.Keys(closed).made_proxy
    assert "taken.csv" in closed.inputs
    placed = 'splats={path="ball.ply",transform={translation=[50,0,0],scale=2}}'
    moved = mirelight.prepare(mirelight.load(job, [placed, with_cameras])).mesh
    meshes = [mirelight.prepare(plain).mesh, mirelight.prepare(closed).mesh, moved]
    radii = []
    for mesh, middle, size in zip(meshes, (0, 0, 50), (1, 1, 2), strict=True):
        assert mesh is not None
        radii.append(np.linalg.norm(mesh.vertices - (middle, 0, 0), axis=1) / size)
        assert radii[-1].max() < 1.1
    inner = [x[x < 0.95] for x in radii]
    assert not len(inner[0])
    assert min(len(x) for x in inner[1:]) > 100
    assert all(x.min() > 0.5 for x in inner[1:])


def test_cameras_of_nothing_are_refused(job: Path) -> None:
    (job.parent / "none.csv").write_text(CAMERAS.splitlines()[0] + "\n", encoding="utf-8")
    (job.parent / "away.csv").write_text(CAMERAS.replace("4,0,0,0,60", "4,0,90,0,60"), encoding="utf-8")
    with pytest.raises(InputError, match=r"none\.csv|proxy\.cameras"):
        mirelight.load(job, ['proxy={path="splats",cameras="none.csv"}'])
    with pytest.raises(InputError, match="have 0% of it in their pictures; give the cameras of this capture"):
        mirelight.prepare(mirelight.load(job, ['proxy={path="splats",cameras="away.csv"}'])).mesh  # noqa: B018


def test_a_transform_or_the_files_colours_are_refused(job: Path) -> None:
    with pytest.raises(InputError, match="transform of a proxy that is made from the splats"):
        mirelight.load(job, ['proxy={path="splats",transform={scale=2}}'])
    with pytest.raises(InputError, match="'file' for a proxy that has none"):
        mirelight.load(job, ['proxy={path="splats",albedo="file"}'])


def test_a_file_gets_no_ceiling(job: Path) -> None:
    (job.parent / "room.glb").touch()
    with pytest.raises(InputError, match=r"proxy\.ceiling: a ceiling of a proxy that is a file; leave it out"):
        mirelight.load(job, ['proxy={path="room.glb",ceiling=false}'])


def test_lights_without_a_proxy_say_the_line_to_add(job: Path) -> None:
    job.write_text(JOB.replace('proxy = "splats"\n', ""), encoding="utf-8")
    with pytest.raises(InputError, match='add the line proxy = "splats"'):
        mirelight.load(job)
    work = replace(mirelight.load(job, ['proxy="splats"']), proxy=None, made_proxy=None)
    with pytest.raises(InputError, match='add the line proxy = "splats"'):
        plan(work)


def test_no_splats_for_it(job: Path) -> None:
    job.write_text('proxy = "splats"\n', encoding="utf-8")
    with pytest.raises(InputError, match="a proxy made from splats, but no splats"):
        mirelight.load(job)
