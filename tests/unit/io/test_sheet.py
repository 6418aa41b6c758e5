"""Contact sheets: every picture in its place, names drawn, many pictures on few sheets; what is read as a display."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirelight.apps.show.sheets import write_sheets
from mirelight.apps.show.shots import Shot, find
from mirelight.base.errors import InputError, OutputError
from mirelight.io.display import read_display
from mirelight.io.exr import write_exr
from mirelight.io.image import write
from mirelight.io.sheet import Pixels, Tile, spread, write_sheet
from mirelight.model import DisplaySettings, Frame, Provenance


def flat(color: tuple[int, int, int], size: tuple[int, int] = (60, 80)) -> Pixels:
    return np.full((*size, 3), color, np.uint8)


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def boxes(sheet: np.ndarray, color: tuple[int, int, int]) -> tuple[slice, slice]:
    """Rows and columns that a colour fills."""
    where = np.argwhere((sheet == color).all(axis=-1))
    (top, left), (bottom, right) = where.min(axis=0), where.max(axis=0) + 1
    assert len(where) == (bottom - top) * (right - left)
    return slice(top, bottom), slice(left, right)


def test_pictures_stand_in_rows_and_columns_scaled_and_named(tmp_path: Path) -> None:
    colors = [[(200, 0, 0), (0, 200, 0)], [(0, 0, 200), (200, 200, 0)]]
    tiles: list[list[Tile | None]] = [[Tile(lambda c=c: flat(c)) for c in row] for row in colors]  # type: ignore[misc]
    tiles[1][1] = None
    path = tmp_path / "a.png"
    write_sheet(path, tiles, rows=["front", "back"], columns=["day", "night"], size=40)
    sheet = pixels(path)
    red, green, blue = (boxes(sheet, c) for c in ((200, 0, 0), (0, 200, 0), (0, 0, 200)))
    assert red[0] == green[0] and red[1] == blue[1]
    assert (red[0].stop - red[0].start, red[1].stop - red[1].start) == (30, 40)
    assert blue[0].start > red[0].stop and green[1].start > red[1].stop
    ink = sheet.min(axis=-1) > 150
    for rows, columns in ((red[0], slice(0, red[1].start)), (blue[0], slice(0, red[1].start))):
        assert ink[rows, columns].any()  # names of rows
    for columns in (red[1], green[1]):
        assert ink[: red[0].start, columns].any()  # names of columns
    missing = sheet[blue[0], green[1]]
    assert (missing == missing[0, 0]).all()
    again = tmp_path / "b.png"
    write_sheet(again, tiles, rows=["front", "back"], columns=["day", "night"], size=40)
    assert again.read_bytes() == path.read_bytes()


def test_pictures_of_different_sizes_are_fitted_and_none_is_enlarged(tmp_path: Path) -> None:
    tall, tiny = Tile(lambda: flat((200, 0, 0), (300, 100)), "tall"), Tile(lambda: flat((0, 200, 0), (5, 9)), "tiny")
    write_sheet(tmp_path / "a.png", [[tall, tiny]], size=60)
    sheet = pixels(tmp_path / "a.png")
    red, green = boxes(sheet, (200, 0, 0)), boxes(sheet, (0, 200, 0))
    assert (red[0].stop - red[0].start, red[1].stop - red[1].start) == (60, 20)
    assert (green[0].stop - green[0].start, green[1].stop - green[1].start) == (5, 9)


def test_a_name_never_runs_into_its_neighbour(tmp_path: Path) -> None:
    long = "a very long name of a camera " * 9 + "\x1b[2J\n"
    row = [Tile(lambda: flat((9, 9, 9)), long), Tile(lambda: flat((9, 9, 9)), "")]
    write_sheet(tmp_path / "a.png", [row], size=80)
    ink = pixels(tmp_path / "a.png").min(axis=-1) > 150
    assert ink[:, :86].any() and not ink[:, 86:].any()


def test_one_picture_in_full_is_held_at_a_time(tmp_path: Path) -> None:
    import tracemalloc

    def tile() -> Tile:
        return Tile(lambda: np.zeros((1000, 1000, 3), np.uint8))

    tracemalloc.start()
    write_sheet(tmp_path / "a.png", [[tile() for _ in range(6)] for _ in range(6)], size=20)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 4 * 3_000_000  # of 36 pictures


@pytest.mark.parametrize("suffix", [".jpg", ".webp"])
def test_other_formats(tmp_path: Path, suffix: str) -> None:
    write_sheet(tmp_path / f"a{suffix}", [[Tile(lambda: flat((200, 100, 50)))]], size=80)
    sheet = pixels(tmp_path / f"a{suffix}").astype(int)
    middle = sheet[sheet.shape[0] // 2, sheet.shape[1] // 2]
    assert np.abs(middle - (200, 100, 50)).max() < 8


def test_another_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"\.png, \.jpg or \.webp"):
        write_sheet(tmp_path / "a.gif", [[Tile(lambda: flat((0, 0, 0)))]])


def test_a_choice_is_evenly_spread_with_both_ends() -> None:
    assert spread(3) == [0, 1, 2]
    assert spread(23, 12) == [0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22]
    assert len(set(spread(10_000, 144))) == 144


def shots(cameras: int, lightings: int) -> list[Shot]:
    return [
        Shot(f"{i}.{j}", f"camera {i}", f"light {j}", lambda i=i, j=j: flat((100 + i, 100 + j, 250), (3, 4)))  # type: ignore[misc]
        for i in range(cameras)
        for j in range(lightings)
    ]


def seen(path: Path) -> set[tuple[int, int]]:
    """Camera and lighting of every picture on a sheet."""
    sheet = pixels(path).reshape(-1, 3)
    own = np.unique(sheet[sheet[:, 2] == 250], axis=0).astype(int)
    return {(int(r) - 100, int(g) - 100) for r, g, _ in own}


def test_many_cameras_are_chosen_from_or_fill_several_sheets(tmp_path: Path) -> None:
    some = write_sheets(shots(25, 3), tmp_path / "some.png", size=16)
    assert (some.shown, some.there, some.pages) == (36, 75, (tmp_path / "some.png",))
    assert seen(tmp_path / "some.png") == {(i, j) for i in spread(25) for j in range(3)}
    every = write_sheets(shots(25, 3), tmp_path / "all.png", size=16, every=True)
    assert [x.name for x in every.pages] == ["all.png", "all-2.png", "all-3.png"]
    assert set.union(*(seen(x) for x in every.pages)) == {(i, j) for i in range(25) for j in range(3)}
    assert every.shown == 75


def test_cameras_of_one_lighting_are_a_grid(tmp_path: Path) -> None:
    made = write_sheets(shots(7, 1), tmp_path / "a.png", size=16)
    assert made.shown == 7
    sheet = pixels(tmp_path / "a.png")
    assert np.unique(np.argwhere(sheet[..., 2] == 250)[:, 0]).size == 9  # three rows of three pixels


def stored(frame: Frame, path: Path, camera: str, lighting: str, exposure: float = 0.0) -> None:
    display = DisplaySettings(exposure=exposure)
    settings = {"display": {"exposure": exposure, "tone": "none", "background": [0, 0, 0]}}
    made_by = Provenance(
        mirelight="0", versions={}, job="a", inputs={}, settings=settings, lighting=lighting, fingerprint="f"
    )
    named = replace(frame, camera=replace(frame.camera, name=camera), made_by=made_by)
    write(named, path, display)


def test_a_folder_is_known_by_what_its_files_say(frame: Frame, tmp_path: Path) -> None:
    for number in (10, 2):
        stored(frame, tmp_path / f"orbit.{number}.dim.png", f"orbit.{number}", "dim")
        stored(frame, tmp_path / f"orbit.{number}.dim.exr", f"orbit.{number}", "dim")
    stored(frame, tmp_path / "orbit.2.dim.partial.png", "orbit.2", "dim")
    write_sheet(tmp_path / "sheet.png", [[Tile(lambda: flat((0, 0, 0)))]])
    (tmp_path / "notes.txt").write_text("none of ours")
    found = find([tmp_path])
    assert [(x.name, x.camera, x.lighting) for x in found] == [
        ("orbit.2.dim", "orbit.2", "dim"),
        ("orbit.10.dim", "orbit.10", "dim"),
    ]


def test_an_exr_is_shown_as_its_png(frame: Frame, tmp_path: Path) -> None:
    for suffix in (".png", ".exr"):
        stored(frame, tmp_path / f"a{suffix}", "front", "dim", exposure=-1.5)
    assert np.array_equal(read_display(tmp_path / "a.exr"), pixels(tmp_path / "a.png"))


def test_pictures_of_other_programs(tmp_path: Path) -> None:
    gray = np.linspace(0, 65535, 12).astype(np.uint16).reshape(3, 4)
    Image.fromarray(gray).save(tmp_path / "deep.png")
    assert np.array_equal(read_display(tmp_path / "deep.png")[..., 1], (gray >> 8).astype(np.uint8))
    clear = np.zeros((2, 2, 4), np.uint8)
    clear[..., 0], clear[..., 3] = 255, [[0, 51], [102, 255]]
    Image.fromarray(clear).save(tmp_path / "clear.png")
    assert read_display(tmp_path / "clear.png")[..., 0].tolist() == [[0, 51], [102, 255]]
    write_exr(tmp_path / "y.exr", {"Y": np.full((2, 3), 0.5, np.float32)})
    assert (read_display(tmp_path / "y.exr") == 188).all()
    assert [x.name for x in find([tmp_path])] == ["clear", "deep", "y"]
    assert [x.name for x in find([tmp_path / "y.exr", tmp_path])] == [
        "y",
        *(f"{tmp_path.name}/{x}" for x in ("clear", "deep", "y")),
    ]


@pytest.mark.parametrize(
    ("name", "data"),
    [("a.png", b"\x89PNG\r\n\x1a\n broken"), ("a.exr", b"\x76\x2f\x31\x01no"), ("a.txt", b"x"), ("a.jpg", b"")],
)
def test_what_is_no_picture_is_refused_in_a_line(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=name):
        read_display(tmp_path / name)
