"""Which files of a capture the engine is given as they are, and what it then shows."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirelight.apps import bake as baking
from mirelight.apps import realtime
from mirelight.apps.realtime import browser, bundle, captures
from mirelight.base import conventions
from mirelight.compositor import Compositor
from mirelight.compositor.engine import SOFTWARE_BITS, EngineDrawing, engine_rank
from mirelight.io import splats
from mirelight.model import (
    Camera,
    CompositorSettings,
    Deferred,
    Job,
    Lighting,
    RelightSettings,
    SplatCloud,
    SplatFile,
)

from .test_engine_browser import crowd

CAMERA = Camera.look_at((0.3, 0.2, 3), (0, 0, 0), 160, 120, yfov=40, near=0.1, far=50)
ASKEW = conventions.compose((0.1, -0.2, 0.05), conventions.rotation_from_euler((20, -35, 160)), 0.8)


def job_of(*files: SplatFile) -> Job:
    clouds = [splats.transform(splats.read(x.path, lod=x.lod), x.world_from_file) for x in files]
    return Job(
        source=Path("test.toml"),
        splats=Deferred.of(splats.merge(clouds)) if clouds else None,
        splat_files=files,
        compositor=CompositorSettings(profile="playcanvas"),
        relight=RelightSettings(profile="playcanvas"),
    )


def not_linked(folder: Path, name: str) -> bool:
    return False


def test_the_engine_shows_own_files_of_three_formats_where_the_job_puts_them(data: Path, tmp_path: Path) -> None:
    """Each in its own axes, a baked SOG among them: the model of order, textures and corners holds, as it does for one
    file in world space."""
    whole = unit(crowd())
    places = [conventions.compose((x, 0, 0)) @ ASKEW for x in (-0.6, 0.6)]
    files = []
    for name, m in zip(("a.ply", "b.compressed.ply"), places, strict=True):
        splats.write(splats.transform(whole, np.linalg.inv(m)), tmp_path / name)
        files.append(SplatFile(path=tmp_path / name, world_from_file=m))
    files.append(SplatFile(path=data / "splats" / "small.sog", world_from_file=ASKEW))
    m = conventions.compose((0, 0.5, 0)) @ ASKEW
    factor = np.random.default_rng(4).uniform(0.1, 2, (len(whole), 3)).astype(np.float32)
    splats.write(baking.relit(splats.transform(whole, np.linalg.inv(m)), factor), tmp_path / "c.sog")
    files.append(SplatFile(path=tmp_path / "c.sog", world_from_file=m))
    job = job_of(*files)
    assert [x.kind for x in captures.handed(job)] == ["ply", "compressed", "sog", "sog"]

    assert job.splats is not None
    cloud = job.splats.value
    frames = realtime.render(job, CAMERA, Lighting(), tmp_path / "page")
    assert frames.meta["splats"] == len(cloud)
    held = captures.held(job, cloud)
    drawing = EngineDrawing(engine_rank(cloud, CAMERA, loaded=held.loaded), SOFTWARE_BITS)
    drawn = Compositor(held.textures, job.compositor).composite(CAMERA, depth=False, drawing=drawing).color
    error = np.mean((drawn.astype(np.float64) - frames.unlit_f32[..., :3]) ** 2)
    assert -10 * np.log10(error) > 68
    for k, file in enumerate(files, start=1):
        suffix = file.path.name.removeprefix("a").removeprefix("b").removeprefix("c").removeprefix("small")
        assert (tmp_path / "page" / f"{k}.splats{suffix}").read_bytes() == file.path.read_bytes()


def test_the_engine_opens_a_glb_of_ours(tmp_path: Path) -> None:
    """As a container, which is how it takes glTF; it shows what it shows of the same splats as PLY."""
    cloud = unit(crowd())
    job = replace(job_of(), splats=Deferred.of(cloud))
    exported = bundle.export(job, CAMERA, Lighting(), tmp_path / "page")
    script = tmp_path / "page" / "scene.mjs"
    plain = script.read_text(encoding="utf-8")
    as_glb = plain.replace(
        "load(app, 'splats', 'gsplat', file)",
        "load(app, 'splats', 'container', 'splats.glb').then((asset) => asset.resource.gsplats[0])",
    )
    assert as_glb != plain
    script.write_text(as_glb, encoding="utf-8")
    (tmp_path / "page" / "splats.ply").unlink()
    splats.write(cloud, tmp_path / "page" / "splats.glb")
    frames = browser.run_page(exported)
    assert frames.meta["splats"] == len(cloud)
    held = captures.held(job, cloud)
    drawing = EngineDrawing(engine_rank(cloud, CAMERA, loaded=held.loaded), SOFTWARE_BITS)
    drawn = Compositor(held.textures, job.compositor).composite(CAMERA, depth=False, drawing=drawing).color
    error = np.mean((drawn.astype(np.float64) - frames.unlit_f32[..., :3]) ** 2)
    assert -10 * np.log10(error) > 60


def test_a_sog_folder_is_handed_on_file_by_file(data: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(data / "splats" / "small.sog") as archive:
        archive.extractall(tmp_path / "sog")
    file = SplatFile(path=tmp_path / "sog", world_from_file=ASKEW)
    job = job_of(file)
    out = tmp_path / "page"
    out.mkdir()
    (entry,) = captures.write(job, out, not_linked)
    meta = json.loads((out / entry["file"]).read_text())
    theirs = json.loads((tmp_path / "sog" / "meta.json").read_text())
    for part in ("means", "scales", "quats", "sh0"):
        for ours, name in zip(meta[part]["files"], theirs[part]["files"], strict=True):
            assert (out / ours).read_bytes() == (tmp_path / "sog" / name).read_bytes()
    assert entry["scale"] == pytest.approx(0.8)
    x, y, z, w = entry["rotation"]
    np.testing.assert_allclose(conventions.rotation_from_quaternion((w, x, y, z)) * 0.8, ASKEW[:3, :3], atol=1e-12)


@pytest.mark.parametrize("kind", ["big endian", "3D filter", "not finite", "spz", "trailing bytes", "made"])
def test_what_the_engine_would_read_otherwise_is_packed_anew(tmp_path: Path, kind: str) -> None:
    cloud = small()
    path = tmp_path / ("a.spz" if kind == "spz" else "a.ply")
    splats.write(cloud, path)
    raw = path.read_bytes()
    if kind == "big endian":
        head, body = raw.split(b"end_header\n")
        swapped = np.frombuffer(body, "<f4").astype(">f4").tobytes()
        path.write_bytes(head.replace(b"little", b"big") + b"end_header\n" + swapped)
    elif kind == "3D filter":
        head, body = raw.split(b"end_header\n")
        rows = np.frombuffer(body, "<f4").reshape(len(cloud), -1)
        wider = np.concatenate([rows, np.full((len(cloud), 1), 0.01, "<f4")], axis=1)
        path.write_bytes(head + b"property float filter_3D\nend_header\n" + wider.tobytes())
    elif kind == "not finite":
        path.write_bytes(raw[:-4] + np.array([np.nan], "<f4").tobytes())
    elif kind == "trailing bytes":
        path.write_bytes(raw + b"more")
    job = job_of(SplatFile(path=path, world_from_file=ASKEW))
    job = replace(job, splat_files=()) if kind == "made" else job
    (one,) = captures.handed(job)
    assert one.file is None
    (entry,) = captures.write(job, tmp_path, not_linked)
    assert entry == {"file": "splats.ply"}
    assert job.splats is not None
    np.testing.assert_allclose(splats.read(tmp_path / "splats.ply").means, job.splats.value.means, atol=1e-6)


def unit(cloud: SplatCloud) -> SplatCloud:
    return replace(cloud, quats=cloud.quats / np.linalg.norm(cloud.quats, axis=1, keepdims=True))


def small() -> SplatCloud:
    whole = unit(crowd())
    names = ("means", "quats", "scales", "opacities", "sh")
    return SplatCloud(**{name: getattr(whole, name)[:50] for name in names})
