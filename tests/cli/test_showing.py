"""`mirelight sheet` and `film`: a folder's frames from their files and from kept layers; wrong use."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from .conftest import Run


def picture(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image).astype(int)


def test_sheets_of_files_and_of_layers_show_the_same(folder: Path, run: Run) -> None:
    made = run("render", "job.toml", "-o", "out", "-q", "--set", "output.exr=false")
    assert made.returncode == 0, made.stderr
    done = run("sheet", "out", "-o", "out/files.png", "--json")
    assert json.loads(done.stdout) == {"files": ["out/files.png"], "frames": 6, "there": 6}, done.stderr
    again = run("sheet", "out", "-o", "again.png")  # the sheet is no frame
    assert (folder / "again.png").read_bytes() == (folder / "out/files.png").read_bytes()
    assert again.stdout.startswith("6 frames")

    some = run("sheet", "out", "-o", "some.jpg", "--camera", "orbit", "--lighting", "n*")
    assert some.stdout == "2 frames on some.jpg\n"

    film = run("film", "out", "-o", "film.webp", "--camera", "orbit", "--lighting", "day", "--fps", "10")
    assert film.stdout == "2 frames of 64 x 48, 0.2 s in film.webp\n", film.stderr
    film = run("film", "out", "-o", "film.webp", "--camera", "orbit", "--lighting", "day", "--fps", "10", "--json")
    assert json.loads(film.stdout) == {"files": ["film.webp"], "frames": 2, "size": [64, 48], "seconds": 0.2}

    for path in (folder / "out").glob("*.*.png"):
        path.unlink()
    layers = run("sheet", "out", "-o", "layers.png")
    assert layers.stdout == "6 frames on layers.png\n", layers.stderr
    assert np.abs(picture(folder / "layers.png") - picture(folder / "again.png")).max() <= 1

    (folder / "out/files.png").unlink()
    shutil.rmtree(folder / "out/.mirelight")
    nothing = run("sheet", "out")
    assert (nothing.returncode, nothing.stderr.count("\n")) == (2, 1)


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (["sheet", "nowhere"], "nowhere: no such file"),
        (["sheet", "job.toml"], "job.toml: a file of type .toml"),
        (["sheet", "one.png", "-o", "sheet.gif"], "sheet.gif: a sheet is written as"),
        (["sheet", "one.png", "-o", "one.png"], "one.png: it is read here"),
        (["sheet", "*.png", "--all", "-o", "one.png"], "one.png: it is read here"),
        (["film", "two.webp", "-o", "two.webp"], "two.webp: it is read here"),
        (["mix", "job.toml", "-o", "site"], "site/index.html: mirelight has not written it"),
        (["sheet", "one.png", "--size", "4"], "--size: 4; give 16 to 512 pixels"),
        (["sheet", "one.png", "--camera", "x"], "no camera named 'x'"),
        (["film", "one.png", "-o", "film.avi"], "film.avi: a film is written as"),
        (["film", "*.jpg", "-o", "film.gif"], "*.jpg: no file of that pattern"),
        (["sheet", "one.png", "-o", "no/folder.png"], "no/folder.png: cannot be written"),
    ],
)
def test_wrong_use_is_one_line(folder: Path, run: Run, arguments: list[str], found: str) -> None:
    for name in ("one.png", "two.webp"):
        Image.new("RGB", (8, 6)).save(folder / name)
    (folder / "site").mkdir()
    (folder / "site" / "index.html").write_text("<title>My holidays</title>")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    done = run(*arguments)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    assert done.returncode == 2
    assert found in done.stderr and done.stderr.count("\n") == 1
