"""What is published: the wheel and the sdist, their README and addresses."""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from mirelight.base.pages import SITE

ROOT = Path(__file__).resolve().parents[2]
URLS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]
MOST = 5_000_000  # bytes


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("dist")
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-d", out], cwd=ROOT, check=True, capture_output=True)
    return out


def test_pages_that_messages_name_are_the_projects_own() -> None:
    assert URLS["Documentation"] == SITE


def test_the_wheel_is_the_package_alone(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    assert wheel.stat().st_size < MOST
    with zipfile.ZipFile(wheel) as file:
        names = set(file.namelist())
    assert {name.partition("/")[0].rpartition(".")[2] for name in names} == {"mirelight", "dist-info"}
    package = {f"mirelight/{x.relative_to(ROOT / 'mirelight').as_posix()}" for x in (ROOT / "mirelight").rglob("*.py")}
    scene = {f"mirelight/apps/demo/scene/{name}" for name in ("job.toml", "stage.sog", "proxy.glb")}
    assert package | scene <= names


def test_the_readme_of_the_wheel_can_be_read_elsewhere(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        (name,) = (x for x in file.namelist() if x.endswith("/METADATA"))
        head, _, text = file.read(name).decode().partition("\n\n")
    assert "Content-Type: text/markdown" in head
    links = re.findall(r"\]\(([^)\s]+)\)", text)
    assert len(links) > 20 and all(x.startswith(("https://", "#")) for x in links)
    pictures = re.findall(r"!\[[^\]]*\]\(([^)\s]+)\)", text)
    assert pictures and all(x.startswith(f"{URLS['Homepage']}/raw/v") for x in pictures)
    for link in links:
        own = re.fullmatch(rf"{re.escape(URLS['Homepage'])}/(?:raw|blob)/[^/]+/([^#]+).*", link)
        assert own is None or (ROOT / own[1]).exists()


def test_the_sdist_is_small_and_builds_the_wheel(built: Path, tmp_path: Path) -> None:
    (sdist,) = built.glob("*.tar.gz")
    assert sdist.stat().st_size < MOST
    with tarfile.open(sdist) as file:
        file.extractall(tmp_path)  # of our own making; Python 3.11.2 knows no filter
    (folder,) = tmp_path.iterdir()
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    (again,), (first,) = tmp_path.glob("*.whl"), built.glob("*.whl")
    with zipfile.ZipFile(again) as a, zipfile.ZipFile(first) as b:
        assert sorted(a.namelist()) == sorted(b.namelist())
