"""Inserted objects in data sets: mixed frames are those that render writes, and detectors' loaders find the objects."""

from __future__ import annotations

import contextlib
import io
import json
import re
import tarfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pycocotools.coco import COCO

from mirelight import cli, dataset
from mirelight.dataset.draws import Draws
from mirelight.io.exr import read_exr
from mirelight.io.gltf.write import write_glb
from mirelight.io.mesh import read_mesh
from mirelight.model import Material, ProxyMesh

from .test_dataset_view import JOB, assert_equal_to_files, make_scene, render

OBJECTS = """
[[objects]]
path = "cube.glb"
category = "box"
drop = true
transform = { translation = [0.3, 2, 0.2], rotation_euler = [0, 30, 0], scale = 0.6 }

[[objects]]
path = "cube.glb"
name = "lamp"
drop = true
transform = { translation = [-0.7, 2, -0.5], scale = 0.4 }

[dataset]
layouts = ["coco"]
split = "lighting"
held_out = 0.4
"""


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("objects")
    make_scene(folder)
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)], np.float32)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    glow = Material(name="glow", base_color=np.full(3, 0.5), emissive=np.array([0.2, 0.1, 0.05]))
    write_glb(folder / "cube.glb", ProxyMesh(vertices=corners, faces=np.array(faces, np.int32), materials=(glow,)))
    text = JOB.replace("[24, 16]", "[60, 40]")
    return render(
        folder,
        text + "\n[output]\naovs = ['cryptomatte_object', 'object_coverage', 'object_depth', 'shadow']\n" + OBJECTS,
    )


def test_mixed_frames_with_objects_are_those_that_render_writes(out: Path) -> None:
    assert_equal_to_files(dataset.open(out), out)


def test_shares_are_those_of_the_files_cryptomatte(out: Path) -> None:
    view = dataset.open(out)
    shares = view.shares("front")
    assert shares.shape == (2, 40, 60) and [x.name for x in view.objects()] == ["cube", "lamp"]
    file = read_exr(out / "front.day.exr")
    total = sum(file.layer(f"CryptoAsset0{k}")[..., 1::2].sum(-1) for k in range(3))
    np.testing.assert_allclose(shares.sum(0), total, atol=1e-6)
    coverage, depth = file.channels["object_coverage.Y"], file.channels["object_depth.Z"]
    assert np.abs(coverage - shares.sum(0)).mean() < 0.02  # samples of their own, and splats in front
    np.testing.assert_array_equal(depth > 0, coverage > 0)
    assert 2 < depth[depth > 0].min() < depth.max() < 6


def test_shadows_are_those_of_the_files(out: Path, tmp_path: Path) -> None:
    view = dataset.open(out)
    for lighting in ("day", "dim"):
        written = read_exr(out / f"front.{lighting}.exr").layer("shadow")[..., :3]
        found = view.shadow("front", lighting)
        assert found is not None and found.min() < 0.5
        np.testing.assert_allclose(found, written, rtol=1e-4, atol=1e-5)
    assert cli.main(["export", str(out), "--layout", "hub", "-o", str(tmp_path)]) == 0
    with tarfile.open(next((tmp_path / "shards").glob("*.tar"))) as tar:
        member = tar.extractfile("day__front.shadow.npy")
        assert member is not None
        day = view.shadow("front", "day")
        assert day is not None
        np.testing.assert_allclose(np.load(io.BytesIO(member.read())), day, rtol=1e-3, atol=1e-5)


def test_a_coco_loader_finds_the_objects(out: Path) -> None:
    folder, view = out / "dataset" / "coco", dataset.open(out)
    sets = {}
    for split in ("train", "val"):
        with contextlib.redirect_stdout(io.StringIO()):
            sets[split] = COCO(str(folder / "annotations" / f"instances_{split}.json"))
    assert sum(len(x.imgs) for x in sets.values()) == 6 and all(x.imgs for x in sets.values())
    assert {x["name"] for x in sets["train"].cats.values()} == {"box", "lamp"}
    for found in sets.values():
        for annotation in found.anns.values():
            image = found.imgs[annotation["image_id"]]
            mask = found.annToMask(annotation).astype(bool)
            place = [x.name for x in view.objects()].index(annotation["object"])
            index = np.asarray(Image.open(folder / image["mask"]))
            np.testing.assert_array_equal(mask, index == place + 1)
            name = Path(image["file_name"]).stem
            assert (view.shares(name)[place][mask] >= 0.5).all()
            left, top, width, height = annotation["bbox"]
            rows, columns = np.nonzero(mask)
            assert (rows.min(), columns.min()) == (top, left)
            assert (rows.max() + 1, columns.max() + 1) == (top + height, left + width)
            # the box in space, projected, is what the picture shows: cubes fill theirs, and the lamp may be hidden
            corners = np.array(annotation["box_3d"]["corners"])
            seen = corners @ np.array(image["K"]).T
            at = seen[:, :2] / seen[:, 2:]
            assert (at.min(0) <= [left + 1, top + 1]).all()
            assert (at.max(0) >= [left + width - 1, top + height - 1]).all()
            if place == 0:
                assert np.abs(at.min(0) - [left, top]).max() < 1.5
                np.testing.assert_allclose(annotation["box_3d"]["size"], [0.6, 0.6, 0.6], rtol=1e-5)


def test_without_objects_there_is_nothing_to_find(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_scene(tmp_path)
    (tmp_path / "job.toml").write_text(JOB + '\n[dataset]\nlayouts = ["coco"]\n', encoding="utf-8")
    assert cli.main(["render", str(tmp_path / "job.toml"), "-q"]) == 2
    assert "no inserted objects to find in pictures" in capsys.readouterr().err


def test_the_page_s_code_loads_it(
    out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = out / "dataset" / "coco"
    (code,) = re.findall(r"```python\n(.*?)```", (folder / "README.md").read_text(), flags=re.DOTALL)
    monkeypatch.chdir(folder)
    exec(code, {})
    found = json.loads((folder / "annotations" / "instances_train.json").read_text())
    assert capsys.readouterr().out.split()[-1] == str(len(found["annotations"]))


SWEPT = """
[sweep]
how = "paired"
lightings = ["day"]

[[sweep.axes]]
field = "objects.lamp.scatter.seed"
draws = 2

[[sweep.axes]]
field = "objects.cube.path"
values = ["cube.glb", "flat.glb"]
"""


def test_objects_that_stand_elsewhere_in_each_frame_are_found_there(tmp_path: Path, out: Path) -> None:
    """Each lighting's mixed frame is the one that render wrote, and boxes and masks are of that frame's objects."""
    make_scene(tmp_path)
    cube = read_mesh(out.parent / "cube.glb")
    write_glb(tmp_path / "cube.glb", cube)
    write_glb(tmp_path / "flat.glb", replace(cube, vertices=cube.vertices * np.array([1, 0.2, 1], np.float32)))
    scatter = 'name = "lamp"\nscatter = { center = [0, 0, 0], radius = 0.6 }'
    objects = OBJECTS.replace('name = "lamp"', scatter).replace('category = "box"', 'name = "cube"')
    made = render(tmp_path, JOB.replace("[24, 16]", "[60, 40]") + objects + SWEPT)
    data = dataset.open(made)
    assert data.lightings == ("day-seed0000-path-cube", "day-seed0001-path-flat", "lamps", "dim")
    assert_equal_to_files(data, made)
    assert len({data.boxes(x).tobytes() for x in data.lightings}) == 3
    with pytest.raises(ValueError, match="objects in different places"):
        data.frame(0, data.weights(0) + data.weights(1))
    drawn = {np.flatnonzero(x.weights.any(axis=1)).tobytes(): x for x in Draws(data, 6, lit=1.0)}
    assert len(drawn) == 3 and all(np.isfinite(x.rgba).all() for x in drawn.values())
    folder, seen = made / "dataset" / "coco", 0
    for split in ("train", "val"):
        with contextlib.redirect_stdout(io.StringIO()):
            found = COCO(str(folder / "annotations" / f"instances_{split}.json"))
        for annotation in found.anns.values():
            image = found.imgs[annotation["image_id"]]
            camera, place = Path(image["file_name"]).stem, ["cube", "lamp"].index(annotation["object"])
            lighting = next(x for x in data.lightings if x.replace(".", "_") == image["lighting"])
            mask = found.annToMask(annotation).astype(bool)
            np.testing.assert_array_equal(mask, np.asarray(Image.open(folder / image["mask"])) == place + 1)
            assert (data.shares(camera, lighting)[place][mask] >= 0.5).all()
            corners = np.array(annotation["box_3d"]["corners"])
            low = (np.column_stack([corners, np.ones(8)]) @ np.array(image["world_from_camera"]).T)[:, 2].min()
            np.testing.assert_allclose(low, 0, atol=1e-5)  # it stands on the ground, in a world with Z up
            at = corners @ np.array(image["K"]).T
            left, top = (at[:, :2] / at[:, 2:]).min(0)
            assert left <= annotation["bbox"][0] + 1 and top <= annotation["bbox"][1] + 1
            height = 0.4 if place else 0.12 if "flat" in lighting else 0.6
            np.testing.assert_allclose(np.abs(data.boxes(lighting)[place][1, :3]).sum(), height, rtol=1e-5)
            seen += 1
    assert seen >= 12
    assert cli.main(["export", str(made), "--layout", "nerf", "-o", str(tmp_path / "nerf")]) == 2


def test_a_draw_that_fits_nowhere_costs_its_own_frames_alone(
    tmp_path: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_scene(tmp_path)
    write_glb(tmp_path / "cube.glb", read_mesh(out.parent / "cube.glb"))
    scatter = 'name = "lamp"\nscatter = { center = [0, 0, 0], radius = 0.6 }'
    axis = SWEPT.split("[[sweep.axes]]")[0] + '[[sweep.axes]]\nfield = "objects.lamp.transform.scale"\n'
    text = JOB + OBJECTS.split("[dataset]")[0].replace('name = "lamp"', scatter) + axis + "values = [300, 0.4]\n"
    (tmp_path / "job.toml").write_text(text, encoding="utf-8")
    assert cli.main(["render", str(tmp_path / "job.toml"), "-o", str(tmp_path / "made")]) == 2
    assert "'lamp' fits nowhere within 0.6 of (0, 0, 0)" in capsys.readouterr().err
    made = {path.name.split(".")[1].split("-")[1] for path in (tmp_path / "made").glob("*.exr") if "day-" in path.name}
    assert made == {"scale0p4"}
