"""`mirelight bake`: the formula, a small scene against its relit frame, and the command as a real process."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from mirelight import prepare
from mirelight.apps import bake as baking
from mirelight.base import colour
from mirelight.base.errors import InputError
from mirelight.base.sh import C0
from mirelight.cli import main
from mirelight.compositor import Compositor
from mirelight.io import image, job, splats
from mirelight.lighting import Tracer
from mirelight.model import RelightSettings, SplatCloud
from mirelight.model.profiles import Gloss
from mirelight.pipeline import stages
from mirelight.relighting.frame import unlit_rgba

FLOOR = """\
splats = "floor.ply"
proxy = "proxy.glb"
resolution = [64, 48]
captured = { environment = { radiance = 1 } }

[[cameras]]
name = "front"
position = [0, 2, 6]
target = [0, -1, 0]

[[lights]]
type = "point"
name = "lamp"
position = [1, 1.5, 1]
color = [1, 0.6, 0.3]
intensity = 15

[render]
spp = 64
"""


def floor() -> SplatCloud:
    """Discs on the floor of the tests' proxy, y = -1."""
    x, z = (a.ravel() for a in np.meshgrid(np.linspace(-2.9, 2.9, 50), np.linspace(-2.9, 2.9, 50)))
    n = len(x)
    return SplatCloud(
        means=np.stack([x, np.full(n, -1.0), z], axis=1).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        scales=np.tile(np.array([0.08, 0.002, 0.08], np.float32), (n, 1)),
        opacities=np.full(n, 0.95, np.float32),
        sh=np.random.default_rng(0).normal(scale=0.2, size=(n, 4, 3)).astype(np.float32),
    )


def shown(rgba: np.ndarray) -> np.ndarray:
    return np.clip(colour.srgb_encode(rgba[..., :3]), 0, 1).astype(np.float64)


def test_light_multiplies_the_linear_colour_and_one_changes_nothing() -> None:
    cloud = floor()
    same = baking.relit(cloud, np.ones((len(cloud), 3), np.float32))
    np.testing.assert_allclose(same.sh, cloud.sh, rtol=1e-3, atol=1e-5)
    factor = np.random.default_rng(1).uniform(0, 3, (len(cloud), 3)).astype(np.float32)
    new = baking.relit(cloud, factor)
    before, after = (colour.srgb_decode(0.5 + C0 * x.sh[:, 0]) for x in (cloud, new))
    np.testing.assert_allclose(after, before * factor, rtol=1e-4, atol=1e-6)


def test_what_a_colour_does_with_the_view_follows_to_first_order() -> None:
    cloud = floor()
    factor = np.full((len(cloud), 3), 0.3, np.float32)
    new = baking.relit(cloud, factor)
    step = 0.01  # of the first direction-dependent coefficient
    wanted = colour.srgb_encode(colour.srgb_decode(0.5 + C0 * cloud.sh[:, 0] + step * cloud.sh[:, 1]) * factor)
    found = 0.5 + C0 * new.sh[:, 0] + step * new.sh[:, 1]
    np.testing.assert_allclose(found, wanted, atol=1e-5)


@pytest.mark.parametrize(("sh", "share"), [("keep", 4.0), ("fade", 1.0), ("remove", 0.0)])
def test_gloss_of_the_capture_is_baked_as_it_is_relit(sh: Gloss, share: float) -> None:
    """What direction adds, in linear light and to first order: four times, once or not at all under four times the
    light."""
    cloud = floor()
    settings = RelightSettings(sh=sh)
    new = baking.relit(cloud, np.full((len(cloud), 3), 4, np.float32), settings)
    np.testing.assert_array_equal(new.sh[:, 0], baking.relit(cloud, np.full((len(cloud), 3), 4, np.float32)).sh[:, 0])
    if sh == "remove":
        assert new.sh.shape[1] == 1
        return
    step = 1e-3
    before, after = (
        colour.srgb_decode((0.5 + C0 * x.sh[:, 0] + step * x.sh[:, 1]).astype(np.float64))
        - colour.srgb_decode((0.5 + C0 * x.sh[:, 0]).astype(np.float64))
        for x in (cloud, new)
    )
    np.testing.assert_allclose(after, share * before, rtol=5e-3, atol=1e-6)


def test_baked_splats_look_like_the_relit_frame(folder: Path) -> None:
    splats.write(floor(), folder / "floor.ply")
    (folder / "job.toml").write_text(FLOOR, encoding="utf-8")
    work = job.load(folder / "job.toml")
    scene = prepare(work)
    baked = baking.relit(floor(), baking.factors(scene, work.lightings[0], spp=64))
    a = shown(unlit_rgba(Compositor(baked).composite(work.cameras[0])))
    frame = stages.frame(scene, work.cameras[0], work.lightings[0])
    assert frame.unlit is not None
    b, old = shown(frame.rgba), shown(frame.unlit)
    assert -10 * np.log10(np.mean((a - b) ** 2)) > 35 > 25 > -10 * np.log10(np.mean((old - b) ** 2))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, assets: Path) -> Path:
    """A folder with the floor's job, whose splats are relit one by one."""
    folder = tmp_path_factory.mktemp("per splat")
    shutil.copyfile(assets / "proxy.glb", folder / "proxy.glb")
    splats.write(floor(), folder / "floor.ply")
    (folder / "job.toml").write_text(f'{FLOOR}\n[relight]\nper = "splat"\n', encoding="utf-8")
    return folder


@pytest.mark.parametrize("sh", get_args(Gloss))
@pytest.mark.parametrize("mode", ["ratio", "albedo"])
def test_a_frame_relit_splat_by_splat_is_what_its_bake_shows(place: Path, mode: str, sh: str) -> None:
    """To first order of what direction adds."""
    work = job.load(place / "job.toml", [f"relight.mode={mode}", f"relight.sh={sh}", "render.spp=4"])
    scene = prepare(work)
    frame = stages.frame(scene, work.cameras[0], work.lightings[0])
    settings = work.relight
    baked = baking.relit(floor(), baking.factors(scene, work.lightings[0], spp=4), settings)
    a, b = shown(unlit_rgba(Compositor(baked).composite(work.cameras[0]))), shown(frame.rgba)
    assert -10 * np.log10(np.mean((a - b) ** 2)) > (40 if sh == "keep" else 42)
    assert frame.noise is None and frame.lighting is not None
    assert frame.unlit is not None and frame.factor is not None
    np.testing.assert_allclose(frame.rgba[..., :3], frame.unlit[..., :3] * frame.factor, rtol=1e-4, atol=1e-6)
    np.testing.assert_array_equal(frame.rgba[..., 3], frame.unlit[..., 3])


def test_splats_relit_one_by_one_are_mixed_without_tracing(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A brighter lamp of another colour: all of its light is there; and blend 0 is the capture, bit for bit."""
    traced: list[int] = []
    point_layers = Tracer.point_layers

    def counted(self: Tracer, *args: Any, **more: Any) -> Any:
        traced.append(1)
        return point_layers(self, *args, **more)

    monkeypatch.setattr(Tracer, "point_layers", counted)
    monkeypatch.chdir(place)
    assert main(["render", "job.toml", "-q", "--set", "render.spp=2"]) == 0
    first, count = image.read(next((place / "out").glob("*.exr"))).rgba, len(traced)
    assert count
    brighter = ["--set", "lights[0].intensity=45", "--set", "lights[0].color=[0.2, 1, 1]"]
    assert main(["render", "job.toml", "-q", "--set", "render.spp=2", *brighter]) == 0
    assert len(traced) == count
    share = image.read(next((place / "out").glob("*.exr"))).rgba.sum(axis=(0, 1)) / first.sum(axis=(0, 1))
    np.testing.assert_allclose(share, [0.6, 5, 10, 1], rtol=0.03)  # 3 * 0.2, 3 / 0.6, 3 / 0.3, less delta
    work = job.load(place / "job.toml", ["relight.blend=0", "render.spp=2"])
    frame = stages.frame(prepare(work), work.cameras[0], work.lightings[0])
    assert frame.unlit is not None and frame.rgba.tobytes() == frame.unlit.tobytes()


def test_layers_of_pixels_do_not_hold_splats_relit_one_by_one(place: Path) -> None:
    work = job.load(place / "job.toml", ['output.store="layers"'])
    with pytest.raises(InputError, match=r"relight\.per: light that is found for splats"):
        prepare(work)


@pytest.mark.parametrize(
    "name", ["relit.ply", "relit.compressed.ply", "relit.sog", "relit.spz", "relit.splat", "relit.glb"]
)
def test_every_format_is_written(place: Path, name: str) -> None:
    """glTF in the job's world, all else in the file's own axes."""
    moved = 'splats = { path = "floor.ply", transform = { translation = [0, 0.1, 0] } }'
    job_file = place / "moved.toml"
    job_file.write_text(FLOOR.replace('splats = "floor.ply"', moved), encoding="utf-8")
    assert main(["bake", str(job_file), "-o", str(place / name), "--spp", "1", "-q"]) == 0
    found = splats.read(place / name)
    assert len(found) == 2500
    np.testing.assert_allclose(found.means[:, 1], -0.9 if name.endswith(".glb") else -1, atol=1e-3)
    if name.endswith(".ply"):
        assert b"comment relit by mirelight" in (place / name).read_bytes()[:2000]


def test_splats_of_linear_light_are_multiplied_as_they_are(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The job says so of a PLY; glTF says it itself afterwards, other formats cannot."""
    linear = 'splats = { path = "floor.ply", color_space = "lin_rec709_display" }'
    (place / "job.toml").write_text(FLOOR.replace('splats = "floor.ply"', linear), encoding="utf-8")
    work = job.load(place / "job.toml")
    factor = baking.factors(prepare(work), work.lightings[0], spp=1)
    assert work.splats is not None
    old = np.maximum(0.5 + C0 * work.splats.value.sh[:, 0], 0)
    for name, space in (("relit.glb", "lin_rec709_display"), ("relit.ply", "srgb_rec709_display")):
        assert main(["bake", str(place / "job.toml"), "-o", str(place / name), "--spp", "1", "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        assert (said["files"], said["splats"]) == ([str(place / name)], 2500)
        assert ("cannot say that its colours are lin" in "".join(said["notes"])) == (name == "relit.ply")
        baked = splats.read(place / name)
        assert baked.color_space == space
        assert np.allclose(np.maximum(0.5 + C0 * baked.sh[:, 0], 0), old * factor, atol=1e-4)


def test_what_is_wrong_is_said_in_a_line(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    cases = {
        ("-o", "relit.ksplat"): "splats are written as",
        ("-o", "none/relit.ply"): "folder does not exist",
        ("-o", "relit.ply", "--spp", "0"): "0 samples",
        ("-o", "relit.ply", "--lighting", "dusk"): "no lighting named 'dusk'",
    }
    for arguments, said in cases.items():
        assert main(["bake", "job.toml", *arguments]) == 2
        error = capsys.readouterr().err
        assert said in error and len(error.splitlines()) == 1, error
