"""Data sets of layers: mixed frames are those that render writes; nothing but layers is made; draws and splits."""

from __future__ import annotations

import copy
import json
import multiprocessing
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import mirelight
from mirelight import cli, dataset
from mirelight.base.errors import InputError
from mirelight.batch.checks import Finding
from mirelight.batch.verify import verify
from mirelight.dataset.draws import Draws, split
from mirelight.dataset.view import DataSet
from mirelight.io import image, splats
from mirelight.io.exr import read_exr
from mirelight.io.gltf.write import write_glb
from mirelight.model import Material, ProxyMesh, SplatCloud
from mirelight.store import layer_index as indexing

JOB = """
splats = "splats.ply"
proxy = { path = "proxy.glb", albedo = "file" }
resolution = [24, 16]
captured = "day"

[[lightings]]
name = "day"
lights = [{ type = "sun", direction = [-0.2, -1, -0.3], intensity = 3.0 }]
environment = { radiance = [0.3, 0.4, 0.6] }

[[lightings]]
name = "lamps"
lights = [
  { name = "warm.one", type = "point", position = [1, 1, 1], intensity = 2.0, color = [1, 0.6, 0.3] },
  { name = "cold", type = "point", position = [-1, 1, 0], intensity = 1.0, color = [0.3, 0.6, 1] },
]

[[lightings]]
name = "dim"
lights = [{ name = "cold", type = "point", position = [-1, 1, 0], intensity = 0.25 }]

[[cameras]]
name = "front"
position = [0, 1.5, 4]
target = [0, 0, 0]

[[cameras]]
name = "side"
position = [4, 1, 1]
target = [0, 0, 0]

[render]
spp = 4
"""


def make_scene(folder: Path, glow: float = 0.0) -> None:
    """Splats that reach past a floor."""
    rng = np.random.default_rng(1)
    n = 300
    means = np.stack([rng.uniform(-1.6, 1.6, n), np.zeros(n), rng.uniform(-1.6, 1.6, n)], axis=1)
    cloud = SplatCloud(
        means=means.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        scales=np.full((n, 3), 0.15, np.float32),
        opacities=np.full(n, 0.8, np.float32),
        sh=rng.uniform(-1, 1, (n, 1, 3)).astype(np.float32),
    )
    splats.write(cloud, folder / "splats.ply")
    floor = ProxyMesh(
        vertices=np.array([[-1.3, 0, -1.3], [1.3, 0, -1.3], [1.3, 0, 1.3], [-1.3, 0, 1.3]], np.float32),
        faces=np.array([[0, 2, 1], [0, 3, 2]], np.int32),
        materials=(Material(base_color=np.array([0.7, 0.5, 0.4]), emissive=np.full(3, glow)),),
        albedo=None,
    )
    write_glb(folder / "proxy.glb", floor)


def render(folder: Path, text: str, *more: str) -> Path:
    path = folder / "job.toml"
    path.write_text(text, encoding="utf-8")
    assert cli.main(["render", str(path), "-q", *more]) == 0
    return folder / "out"


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """One job rendered to frames and layers, and to layers alone."""
    both, layers = tmp_path_factory.mktemp("both"), tmp_path_factory.mktemp("layers")
    for folder in (both, layers):
        make_scene(folder)
    return render(both, JOB), render(layers, JOB, "--set", "output.store=layers")


def assert_equal_to_files(view: DataSet, out: Path) -> None:
    """To 1e-5 of the picture's brightest value: float32 sums in another order."""
    for camera in view.cameras:
        for lighting in view.lightings:
            written = read_exr(out / f"{camera.name}.{lighting}.exr").layer()
            mixed = view.frame(camera.name, lighting)
            assert mixed.dtype == np.float32
            assert np.abs(mixed - written).max() <= 1e-5 * np.abs(written).max(), (camera.name, lighting)


def test_mixed_frames_are_those_that_render_writes(folders: tuple[Path, Path]) -> None:
    for out in folders:
        assert_equal_to_files(dataset.open(out), folders[0])


@pytest.mark.parametrize(
    "changed",
    [
        ("relight.mode=tint",),
        ("relight.mode=tint", "relight.space=display", "relight.blend=0.5"),
        ("relight.texture_scale=0.5",),
        ("render.noise=0.5",),  # every lighting is traced as it is
        ("output.aovs=false",),
        ("relight.background=environment",),
        ("relight.background=environment", "lightings[0].environment={sky={elevation=30}}", "render.noise=0.5"),
        ("relight.background=environment", "relight.mode=albedo", "lightings[1].environment={sky={elevation=10}}"),
        ("lightings[0].environment={sky={elevation=30}}",),
        ("resolution=[7, 5]", "glow"),
        ("relight.gloss=true", "materials=[{roughness=0.3}]", "glow"),
        ("relight.gloss=true", "materials=[{roughness=0.3, metallic=0.5}]", "relight.texture_scale=0.5"),
    ],
)
def test_in_other_modes_too(tmp_path: Path, changed: tuple[str, ...]) -> None:
    make_scene(tmp_path, glow=0.2 if "glow" in changed else 0.0)
    out = render(tmp_path, JOB, *(x for c in changed if c != "glow" for x in ("--set", c)))
    assert_equal_to_files(dataset.open(out), out)


@pytest.mark.parametrize("behind", ["environment", "plate.png"])
def test_the_same_stands_behind(tmp_path: Path, behind: str) -> None:
    """A computed sky with its ground, and a picture, behind mixed frames as behind rendered ones."""
    make_scene(tmp_path)
    Image.new("RGB", (8, 6), (200, 40, 90)).save(tmp_path / "plate.png")
    sky = "lightings[0].environment={sky={elevation=30}}"
    out = render(tmp_path, JOB, "--set", sky, "--set", f"display.background={behind}")
    view, written = dataset.open(out), image.read(out / "front.day.exr")
    mixed = view.background(0, 0, written.rgba[..., 3])
    assert mixed is not None and written.background is not None
    np.testing.assert_allclose(mixed, written.background, atol=2e-3 * float(written.background.max()))


SWEPT = """
[relight]
blend = 0.75

[sweep]
lightings = ["lamps", "dim"]

[[sweep.axes]]
field = "relight.mode"
values = ["tint", "ratio"]

[[sweep.axes]]
field = "relight.blend"
values = [0, 0.5]
"""
SWEPT_SKY = """
[relight]
blend = 0.75

[sweep]
lightings = ["day", "dim"]

[[sweep.axes]]
field = "relight.background"
values = [0.5, "environment"]
"""


def test_swept_relight_settings_are_those_of_single_jobs(tmp_path: Path) -> None:
    """Each way of relighting: the frame of a job that asks for it alone, and mixed the same; nothing is traced anew."""
    make_scene(tmp_path)
    out = render(tmp_path, JOB + SWEPT)
    view = dataset.open(out)
    assert view.lightings[:2] == ("day", "lamps-mode-tint-blend0") and len(view.lightings) == 9
    assert_equal_to_files(view, out)
    assert len(list((out / ".mirelight" / "light").glob("*.light"))) == 2 * 2  # a composite and one set a camera
    for i, (mode, blend) in enumerate([("tint", 0), ("tint", 0.5), ("ratio", 0), ("ratio", 0.5)]):
        settings = f"relight.mode={mode}", f"relight.blend={blend}", "output.directory=alone", "output.aovs=false"
        job = mirelight.load(tmp_path / "job.toml", [*settings, "sweep.axes=[]", "sweep.one_at_a_time=true"])
        scene = mirelight.prepare(job)
        camera, lighting = job.cameras[0], next(x for x in job.lightings if x.name == "lamps")
        lit = mirelight.light(scene, camera, lighting)
        alone = mirelight.relight(scene, mirelight.composite(scene, camera), lit).rgba
        swept = view.frame("front", view.lightings[1 + i])
        assert np.abs(alone - swept).max() <= 1e-5 * np.abs(alone).max(), (mode, blend)
    unlike = [view.frame("front", name) for name in view.lightings[1:5]]
    assert np.array_equal(unlike[0], unlike[2]) and not np.allclose(unlike[1], unlike[3], rtol=0.01)


def test_the_background_may_be_a_number_in_one_lighting_and_the_sky_in_another(tmp_path: Path) -> None:
    """Splats lie beside the floor, too: what is seen of them far from it is as it was, or dark where no sky is."""
    make_scene(tmp_path)
    larger = 'splats={path="splats.ply", transform={scale=4}}'
    changed = (y for x in (larger, "resolution=[96, 64]", "output.aovs=['factor']") for y in ("--set", x))
    out = render(tmp_path, JOB + SWEPT_SKY, *changed)
    view = dataset.open(out)
    assert_equal_to_files(view, out)
    number, sky = "dim-background0p5", "dim-background-environment"
    far = read_exr(out / f"front.{number}.exr").layer("factor")[..., 0] == 0.25 + 0.75 * 0.5
    assert far.sum() > 100
    dark = read_exr(out / f"front.{sky}.exr").layer("factor")[far]
    assert (np.abs(dark - 0.25) < 0.02).all() and (dark > 0.25).all()


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (("profile=playcanvas",), "the profile playcanvas, whose background is one number; give a number"),
        (("relight.mode=tint",), "a mode that does not compare with the captured light; give a number, or"),
        (("captured=lamps",), "captured light without an environment; give a number, or name what"),
    ],
)
def test_a_sky_that_is_not_known_is_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changed: tuple[str, ...], said: str
) -> None:
    make_scene(tmp_path)
    (tmp_path / "job.toml").write_text(JOB, encoding="utf-8")
    chosen = (y for x in ("relight.background=environment", *changed) for y in ("--set", x))
    assert cli.main(["render", str(tmp_path / "job.toml"), "-q", *chosen]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "relight.background" in line and said in line


def test_a_proxy_without_splats(tmp_path: Path) -> None:
    make_scene(tmp_path)
    out = render(tmp_path, JOB.replace('splats = "splats.ply"\n', "").replace('captured = "day"\n', ""))
    assert_equal_to_files(dataset.open(out), out)


def test_layers_alone_write_no_frame_and_are_found_again(
    folders: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    out = folders[1]
    assert [x.name for x in out.iterdir()] == [".mirelight"]
    kept = {x: x.stat().st_mtime_ns for x in (out / ".mirelight" / "light").iterdir()}
    render(out.parent, JOB, "--set", "output.store=layers")
    assert {x: x.stat().st_mtime_ns for x in (out / ".mirelight" / "light").iterdir()} == kept
    # a composite and two sets a camera: the captured day's, and the lamps'
    assert len(kept) == 2 * 3


def test_what_it_holds(folders: tuple[Path, Path]) -> None:
    view = dataset.open(folders[1])
    assert [x.name for x in view.cameras] == ["front", "side"]
    assert view.lightings == ("day", "lamps", "dim")
    assert [(x.name, x.kind) for x in view.lights] == [
        ("sun", "sun"),
        ("environment", "environment"),
        ("warm.one", "lamp"),
        ("cold", "lamp"),
    ]
    assert np.array_equal(view.weights("dim"), [[0, 0, 0]] * 3 + [[0.25] * 3])
    layers = view.layers("front")
    assert layers.shape == (4, 16, 24, 3) and layers.min() >= 0
    geometry, composite = view.geometry("front"), view.composite("front")
    assert geometry.layers == () and geometry.depth.max() > 3
    assert composite is not None and composite.color.shape == (16, 24, 3)
    assert len(view) == 6 and len(list(view)) == 6
    sample = view[4]
    assert (sample.camera, sample.lighting) == (1, 1)
    assert np.array_equal(sample.rgba, view.frame("side", "lamps"))
    with pytest.raises(IndexError):
        view[6]
    with pytest.raises(InputError, match="no lighting 'noon'; there are: day, lamps, dim"):
        view.frame("front", "noon")
    with pytest.raises(ValueError, match=r"weights of shape \(2, 3\), .* give 4 numbers or colours"):
        view.frame("front", np.ones((2, 3)))


def test_a_lighting_that_nobody_rendered_is_the_one_that_render_would_make(
    folders: tuple[Path, Path], tmp_path: Path
) -> None:
    """Two thirds of the lamps' light in other colours, and some of the sky."""
    make_scene(tmp_path)
    new = """
[[lightings]]
name = "evening"
lights = [
  { name = "warm.one", type = "point", position = [1, 1, 1], intensity = 3.0, color = [1, 0.2, 0.1] },
  { name = "cold", type = "point", position = [-1, 1, 0], intensity = 0.5 },
]
environment = { radiance = [0.3, 0.4, 0.6], intensity = 0.1 }
"""
    out = render(tmp_path, JOB.replace("[[cameras]]", f"{new}\n[[cameras]]", 1))
    weights = np.array([[0, 0, 0], [0.1, 0.1, 0.1], [3, 0.6, 0.3], [0.5, 0.5, 0.5]])
    mixed = dataset.open(folders[1]).frame("side", weights)
    written = read_exr(out / "side.evening.exr").layer()
    assert np.abs(mixed - written).max() <= 1e-5 * written.max()


def frame_elsewhere(view: DataSet, i: int) -> np.ndarray:
    return view[i].rgba


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_other_processes_read_it(folders: tuple[Path, Path], method: str) -> None:
    view = dataset.open(folders[1])
    here = view[5].rgba  # some cameras are ready, others are not
    with multiprocessing.get_context(method).Pool(2) as pool:
        found = pool.starmap(frame_elsewhere, [(view, i) for i in (5, 0, 5)])
        pool.close()  # its processes end by themselves, and not by signals that wait for each other's locks
        pool.join()
    assert np.array_equal(found[0], here) and np.array_equal(found[2], here)
    assert len(pickle.dumps(view)) < 2000


def test_little_memory_changes_nothing(folders: tuple[Path, Path]) -> None:
    small, large = DataSet(folders[1], memory=1), dataset.open(folders[1])
    for i in (0, 5, 1, 3, 0):
        assert np.array_equal(small[i].rgba, large[i].rgba)
        assert len(small._ready) == 1


def test_what_is_no_data_set(tmp_path: Path, folders: tuple[Path, Path]) -> None:
    with pytest.raises(InputError, match=r'no kept layers; render the job with output.store = "layers" or "both"'):
        dataset.open(tmp_path)
    file = tmp_path / indexing.FILE
    file.parent.mkdir()
    good = (folders[1] / indexing.FILE).read_text()
    for text, found in {
        "{": "not an index",
        "[]": "a damaged index",
        '{"version":9}': "version 9",
        good.replace('"groups"', '"group"'): "a damaged index",
        good: "no camera whose layers are all there",
    }.items():
        file.write_text(text)
        with pytest.raises(InputError, match=found):
            dataset.open(tmp_path)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Of everything in JSON how one comes there; of lists the first two."""
    yield path
    if isinstance(value, dict):
        for key in value:
            yield from places(value[key], (*path, key))
    elif isinstance(value, list):
        for i in range(min(len(value), 2)):
            yield from places(value[i], (*path, i))


def test_a_damaged_index_is_refused_in_a_line(tmp_path: Path, folders: tuple[Path, Path]) -> None:
    """Whatever stands in the place of any of its values: it is refused, or read without a traceback."""
    good = json.loads((folders[1] / indexing.FILE).read_text())
    (tmp_path / ".mirelight").mkdir()
    for name in ("light", "scene"):
        (tmp_path / ".mirelight" / name).symlink_to(folders[1] / ".mirelight" / name)
    wrong: list[Any] = [None, [], "../a", -1, 10**400]
    refused = 0
    for path in list(places(good))[1:]:
        for value in wrong:
            data = copy.deepcopy(good)
            of = data
            for key in path[:-1]:
                of = of[key]
            of[path[-1]] = value
            (tmp_path / indexing.FILE).write_text(json.dumps(data))
            try:
                with np.errstate(all="ignore"):
                    read = indexing.read(tmp_path)
                    if value == -1 and path[0] != "views":
                        dataset.open(tmp_path).frame(0, read.lightings[0].name)
            except InputError:
                refused += 1
    assert refused > 500
    (tmp_path / indexing.FILE).write_text(json.dumps(good).replace('"front"', "NaN", 1))
    with pytest.raises(InputError, match="not an index"):
        dataset.open(tmp_path)


def test_a_rotted_layer_is_refused_and_made_again(tmp_path: Path) -> None:
    """One bit of a kept file: neither used nor lost from sight, by `verify` and the next render."""
    make_scene(tmp_path)
    out = render(tmp_path, JOB, "--set", "output.store=layers")
    name = "front", "lamps"
    before = dataset.open(out).frame(*name)
    kept = sorted([*(out / ".mirelight" / "light").iterdir(), *(out / ".mirelight" / "scene").iterdir()])
    for path in kept:
        sound = path.read_bytes()
        at = len(sound) - 100
        path.write_bytes(sound[:at] + bytes([sound[at] ^ 1]) + sound[at + 1 :])
        heard: list[Finding] = []
        assert verify(out, heard.append).findings == 1 and heard[0].what.endswith(path.name)
        path.write_bytes(sound)
    for path in kept:
        data = bytearray(path.read_bytes())
        data[-100] ^= 1
        path.write_bytes(data)
    with pytest.raises(InputError, match="is damaged; mirelight verify --rebuild forgets it"):
        dataset.open(out).frame(*name)
    assert verify(out, lambda finding: None, rebuild=True).forgotten == len(kept)
    render(tmp_path, JOB, "--set", "output.store=layers")
    assert np.array_equal(dataset.open(out).frame(*name), before)


def test_draws_depend_on_seed_and_number_alone(folders: tuple[Path, Path]) -> None:
    view = dataset.open(folders[1])
    some, more = Draws(view, 6, seed=3), Draws(view, 40, seed=3)
    assert len(list(some)) == 6
    for i in (5, 0):
        assert np.array_equal(some[i].rgba, more[i].rgba) and np.array_equal(some[i].weights, more[i].weights)
        assert np.array_equal(some[i].rgba, view.frame(some[i].camera, some[i].weights))
    assert not np.array_equal(some[0].weights, Draws(view, 6, seed=4)[0].weights)
    weights = np.array([x.weights for x in more])
    assert (weights.reshape(40, -1).max(axis=1) > 0).all() and (weights == 0).any()
    assert (weights <= 4 * view.strongest).all()
    with pytest.raises(IndexError):
        some[6]


def test_nothing_is_drawn_where_every_lighting_is_off(tmp_path: Path) -> None:
    make_scene(tmp_path)
    off = JOB.split("[[lightings]]")[0] + "[[cameras]]" + JOB.split("[[cameras]]")[1] + "[render]\nspp = 1\n"
    light = '[[lightings]]\nname = "off"\nlights = [{ type = "point", position = [1, 1, 1], intensity = 0 }]\n'
    (tmp_path / "job.toml").write_text(off.replace('captured = "day"', 'captured = "off"') + light)
    more = ["--set", "output.store=layers", "--set", "relight.mode=tint"]
    assert cli.main(["render", str(tmp_path / "job.toml"), "-q", *more]) == 0
    view = dataset.open(tmp_path / "out")
    assert len(view) == 1 and np.isfinite(view[0].rgba).all()
    with pytest.raises(InputError, match="out: no lighting with any light"):
        Draws(view, 3)


def test_splits_are_four_parts_by_names(folders: tuple[Path, Path]) -> None:
    view = dataset.open(folders[1])
    seeds = [split(view, "both", 0.5, seed) for seed in range(20)]
    for parts in seeds:
        every = [*parts.seen, *parts.novel_view, *parts.novel_light, *parts.novel_both]
        assert sorted(every) == list(range(6))
    assert {len(x.novel_both) for x in seeds} > {0, 1}
    assert not split(view, "camera", 0.5).novel_light and not split(view, "lighting", 0.5).novel_view
    assert split(view, "both", 0.0).seen == tuple(range(6))
    with pytest.raises(ValueError, match=r"'cameras', 0\.5; give one of camera, lighting, both"):
        split(view, "cameras", 0.5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="a share of 0 to 1"):
        split(view, "camera", 30)


@pytest.mark.parametrize("wrong", [{"count": -1}, {"lit": 2}, {"lit": np.nan}, {"stops": -1}])
def test_draws_of_no_sense(folders: tuple[Path, Path], wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="give a count and stops of at least 0, and a share lit of 0 to 1"):
        Draws(dataset.open(folders[1]), **({"count": 3} | wrong))  # type: ignore[arg-type]


# --- export ----------------------------------------------------------------------------------------------------------


def test_a_dry_run_counts_and_makes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_scene(tmp_path)
    path = tmp_path / "job.toml"
    path.write_text(JOB + "[sweep]\none_at_a_time = true\nlightings = ['lamps']\n")
    assert cli.main(["render", str(path), "--dry-run"]) == 0
    first = capsys.readouterr().out.splitlines()
    assert first[0] == "10 frames (2 cameras, 5 lightings), 0 of them there"
    assert first[1].startswith("2 traces of")  # one of each camera: a sweep pools the day's lights and the lamps
    assert not (tmp_path / "out").exists()
    assert cli.main(["render", str(path), "-q", "--camera", "side"]) == 0
    assert cli.main(["render", str(path), "--dry-run"]) == 0
    second = capsys.readouterr().out.splitlines()
    assert second[0] == "10 frames (2 cameras, 5 lightings), 5 of them there"
    assert second[1].startswith("1 trace of")
    made = sum(x.stat().st_size for x in (tmp_path / "out").rglob("*") if x.is_file())
    forecast = float(second[2].split()[1]) * 1e6
    assert 0.5 < forecast / made < 2  # the other camera's files
    assert cli.main(["render", str(path), "-q"]) == 0
    made = sum(x.stat().st_size for x in (tmp_path / "out").rglob("*") if x.is_file())
    assert made == pytest.approx(float(first[2].split()[1]) * 1e6, rel=0.25)
