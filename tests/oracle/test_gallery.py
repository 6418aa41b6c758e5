"""docs/gallery.md: its jobs are the files beside it, load, and make their pictures, here from toy scenes."""

from __future__ import annotations

import importlib
import re
import shutil
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image

import mirelight

from .toy_clone import ROOT, TOY, make_clone

DOCS = ROOT / "docs"
PAGE = (DOCS / "gallery.md").read_text(encoding="utf-8")
JOBS = sorted((DOCS / "gallery").glob("*.toml"))


@pytest.fixture
def gallery(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(ROOT / "scripts")
    return importlib.import_module("gallery")


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clone")
    make_clone(folder)
    shutil.copytree(DOCS / "gallery", folder / "docs" / "gallery")
    return folder


def test_the_page_shows_every_picture_with_its_whole_job(gallery: ModuleType) -> None:
    shown = re.findall(r"!\[[^\]]+\]\(gallery/(\w+)\.jpg\)", PAGE)
    assert sorted([*shown, "clip"]) == sorted([*gallery.PICTURES, "clip"]) == [x.stem for x in JOBS]
    blocks = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL)
    assert blocks == [(DOCS / "gallery" / f"{name}.toml").read_text(encoding="utf-8") for name in (*shown, "clip")]


def test_pictures_are_small() -> None:
    """Each, and all that the page loads at once."""
    sizes = {x.stem: x.stat().st_size for x in (DOCS / "gallery").glob("*.jpg")}
    shown = re.findall(r"!\[[^\]]+\]\(gallery/(\w+)\.jpg\)", PAGE)
    assert max(sizes.values()) <= 60_000 and sum(sizes[name] for name in shown) <= 720_000
    assert (DOCS / "pictures" / "courtyard.webp").stat().st_size <= 3_000_000


@pytest.mark.parametrize("job", JOBS, ids=lambda x: x.stem)
def test_jobs_load_with_the_shipped_scenes(job: Path) -> None:
    assert mirelight.load(job).cameras


# "parts" makes a mesh and estimates light, each tested by itself; "clip" is a film, below.
@pytest.mark.parametrize("job", [x for x in JOBS if x.stem not in ("clip", "parts")], ids=lambda x: x.stem)
def test_jobs_make_their_pictures(job: Path, gallery: ModuleType, clone: Path, tmp_path: Path) -> None:
    own = clone / "docs" / "gallery" / job.name
    small = ("resolution=[24, 16]", *TOY)
    work = gallery.Work(own, tmp_path / "frames", small)
    path = gallery.draw(job.stem, gallery.PICTURES[job.stem], work, tmp_path)
    with Image.open(path) as picture:
        pixels = np.asarray(picture.convert("RGB"), np.float32)
    assert pixels.shape[:2] == (16, 24) or pixels.shape[1] >= 36  # a sheet of two tiles at least
    assert pixels.max() - pixels.min() > 30


def test_the_clip_is_a_film_of_its_cameras_and_lightings(
    gallery: ModuleType, clone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gallery, "CLIP", tmp_path / "clip.webp")
    monkeypatch.setattr(gallery, "CARD", tmp_path / "card.jpg")
    few = [f"sweep.axes[{i}].steps=13" for i in range(5)]
    job = clone / "docs" / "gallery" / "clip.toml"
    work = gallery.Work(job, tmp_path / "frames", ("resolution_scale=0.02", *few, *TOY))
    with Image.open(gallery.clip(work)) as film:
        shown = []
        for k in (0, film.n_frames - 1):  # type: ignore[attr-defined]
            film.seek(k)
            shown.append(np.asarray(film.convert("RGB"), np.float32))
    first, last = (path for _, path in (work.frames()[0], work.frames()[-1]))
    assert np.abs(shown[0] - gallery.unlit(first)).mean() < 8  # the capture, as far as WebP keeps it
    assert np.abs(shown[1] - gallery.picture(last)).mean() < 8 < np.abs(shown[1] - gallery.unlit(last)).mean()


@pytest.mark.parametrize("name", ["turntable", "day", "even", "gloss", "glaze", "clipped", "tint"])
def test_jobs_on_pages_are_found(name: str, gallery: ModuleType, tmp_path: Path) -> None:
    kind = gallery.TUTORIALS[name]
    assert mirelight.load(gallery.job_of(name, kind, tmp_path)).cameras


def test_pictures_for_the_film_are_taken_beside_its_way(gallery: ModuleType) -> None:
    way = mirelight.load(DOCS / "gallery" / "clip.toml").cameras
    taken = importlib.import_module("trained").walk(way)
    off = [min(np.linalg.norm(x.position - y.position) for y in way) for x in taken]
    assert len(taken) == 30 and max(off) < 1 and np.median(off) > 0.2
    assert min(x.world_from_camera[:3, 2] @ way[0].world_from_camera[:3, 2] for x in taken) > 0.5
