"""The command as a person types it, without the process around it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from mirelight.base.errors import InputError, OutputError
from mirelight.cli import make_parser
from mirelight.cli.compare import run_compare


def run(*words: Any) -> int:
    return run_compare(make_parser().parse_args(["compare", *map(str, words)]))


@pytest.fixture
def files(made: Any, save: Any, lighter: Any) -> tuple[Path, Path]:
    return save(made(), "a/f.exr"), save(lighter(made(), 1.5), "b/f.png")


def test_files_are_written_and_the_table_printed(
    files: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outputs = {kind: tmp_path / f"r.{kind}" for kind in ("html", "json", "csv")}
    words = [word for kind, path in outputs.items() for word in ("-o", path)]
    assert run(*files, *words, "--fit-gain") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].split()[0] == "f"
    assert "1.5" in lines[1].split()
    assert all(path.stat().st_size > 100 for path in outputs.values())


def test_figures_as_json_and_one_file_of_a_kind(files: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(*files, "--json", "-o", tmp_path / "r.json") == 0
    printed = capsys.readouterr().out
    assert json.loads(printed)["pairs"][0]["name"] == "f"
    assert printed == (tmp_path / "r.json").read_text(encoding="utf-8")
    with pytest.raises(InputError, match="--out: two files of one kind"):
        run(*files, "-o", tmp_path / "a.csv", "-o", tmp_path / "b.csv")


def test_an_unmet_requirement_is_exit_code_1(files: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(*files, "--require", "psnr>=5", "-q") == 0
    assert capsys.readouterr().out == ""
    assert run(*files, "--require", "psnr>=5", "--require", "psnr>=60", "-q") == 1
    assert "all.psnr>=60 is not met" in capsys.readouterr().out


@pytest.mark.parametrize(
    "words",
    [
        ("--exposure", "bright"),
        ("--exposure", "nan"),
        ("--exposure", "1e30"),
        ("--background", "1,2"),
        ("--band", "0"),
        ("--band", "2.5"),
        ("--require", "nonsense"),
        ("--mask", "gone.png"),
    ],
)
def test_bad_options_are_one_line(files: Any, words: tuple[str, str]) -> None:
    with pytest.raises(InputError) as caught:
        run(*files, *words)
    assert "\n" not in str(caught.value)


def test_a_report_without_a_folder_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    for kind in ("html", "json", "csv"):
        with pytest.raises(OutputError, match=f"none/r.{kind}: cannot be written .the folder does not exist"):
            run("gone.png", "gone.png", "-o", tmp_path / "none" / f"r.{kind}")


def test_paths_come_in_pairs(files: Any) -> None:
    with pytest.raises(InputError, match="give as many tests as references"):
        run(*files, files[0])


def test_a_report_takes_the_place_of_one_alone(files: Any, tmp_path: Path, save: Any, made: Any) -> None:
    """Neither a picture that is compared nor a file of others is written over; a report of before is."""
    reference, test = files
    mask = save(made(), "mask.png")
    for kind in ("html", "json", "csv"):
        for read in (reference, test, mask):
            before = read.read_bytes()
            with pytest.raises(OutputError, match=rf"{read.name}: a comparison is written as .html, .json or .csv"):
                run(reference, test, "--mask", mask, "-o", read, "-q")
            link = tmp_path / f"link.{kind}"
            link.symlink_to(read)
            with pytest.raises(OutputError, match=rf"{link.name}: it is read here"):
                run(reference, test, "--mask", mask, "-o", link, "-q")
            link.unlink()
            assert read.read_bytes() == before
        foreign = tmp_path / f"mine.{kind}"
        foreign.write_text("my own notes")
        with pytest.raises(OutputError, match=rf"mine\.{kind}: mirelight has not written it"):
            run(reference, test, "-o", foreign, "-q")
        assert foreign.read_text() == "my own notes"
        report = tmp_path / f"r.{kind}"
        report.touch()
        for _ in range(2):
            assert run(reference, test, "-o", report, "-q") == 0
        assert report.stat().st_size > 100
