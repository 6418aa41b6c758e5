"""Thresholds, tables and text."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from mirelight.base.errors import InputError, OutputError
from mirelight.compare import Pairing, compare, find_pairs, parse_requirement, summary
from mirelight.compare.requirements import unmet


@pytest.fixture
def pairs(made: Any, save: Any, lighter: Any, tmp_path: Path) -> Any:
    for k, factor in enumerate((1.0, 1.5, 1.1)):
        save(made(k), f"ref/frame{k}.exr")
        save(lighter(made(k), factor), f"test/frame{k}.exr")
    return find_pairs([tmp_path / "ref"], [tmp_path / "test"])


def test_worst_comes_first(pairs: Any) -> None:
    told: list[tuple[int, int]] = []
    outcome = compare(pairs, progress=lambda done, total: told.append((done, total)))
    assert [r.name for r in outcome.results] == ["frame1", "frame2", "frame0"]
    assert told == [(0, 3), (1, 3), (2, 3), (3, 3)]
    assert outcome.failures == ()


def test_requirements_name_the_pairs_that_fail(pairs: Any) -> None:
    results = compare(pairs).results
    for text, failing in {
        "psnr>=10": [],
        "psnr >= 30": ["frame1"],
        "flip<0.01": ["frame1", "frame2"],
        "covered.delta_e<=0": ["frame1", "frame2"],
        "silhouette.max_error<=1e-9": ["frame1", "frame2"],
        "rel_mse<=0.1": ["frame1"],
    }.items():
        failures = unmet(results, [parse_requirement(text)])
        assert [line.split(":")[0] for line in failures] == failing
        assert all("is not met" in line for line in failures)


def test_a_figure_that_a_pair_lacks_fails(made: Any, save: Any, tmp_path: Path) -> None:
    pairs = find_pairs([save(made(), "a/f.exr")], [save(made(), "b/f.png")])
    outcome = compare(pairs, requirements=[parse_requirement("rel_mse<=1")])
    assert outcome.failures == ("f: all.rel_mse<=1 cannot be checked (this pair has no such figure)",)


@pytest.mark.parametrize("text", ["", "psnr", "psnr=30", "beauty>=3", "psnr>=x", "left.psnr>=3", "psnr>=1.2.3"])
def test_bad_requirements_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="--require"):
        parse_requirement(text)


def test_json_and_csv_hold_the_figures(pairs: Any, tmp_path: Path) -> None:
    requirements = [parse_requirement("psnr>=30")]
    outcome = compare(pairs, requirements=requirements, json=tmp_path / "r.json", csv=tmp_path / "r.csv")

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    document = json.loads((tmp_path / "r.json").read_text(), parse_constant=refuse)
    assert document["failures"] == list(outcome.failures)
    assert [p["name"] for p in document["pairs"]] == ["frame1", "frame2", "frame0"]
    worst, best = document["pairs"][0], document["pairs"][2]
    assert worst["regions"][0]["psnr"] == outcome.results[0].overall.psnr
    assert worst["reference_settings"]["settings"]["render"]["spp"] == 64
    assert best["regions"][0]["psnr"] is None
    assert best["regions"][0]["verdict"] == "identical"

    with (tmp_path / "r.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 9
    assert float(rows[0]["flip"]) == pytest.approx(outcome.results[0].overall.flip, rel=1e-5)
    assert {r["region"] for r in rows} == {"all", "covered", "silhouette"}


def test_results_are_reproducible(pairs: Any, tmp_path: Path) -> None:
    for name in ("one", "two"):
        compare(Pairing(pairs=pairs.pairs[1:2]), html=tmp_path / f"{name}.html", json=tmp_path / f"{name}.json")
    assert (tmp_path / "one.html").read_bytes() == (tmp_path / "two.html").read_bytes()
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()


def test_the_summary_is_a_table_with_the_failures(pairs: Any) -> None:
    text = summary(compare(pairs, requirements=[parse_requirement("psnr>=30")]))
    lines = text.splitlines()
    assert [line.split()[0] for line in lines[:4]] == ["pair", "frame1", "frame2", "frame0"]
    assert lines[3].split()[2] == "inf"
    remarks, rest = ([x for x in lines[4:] if ("the test looks" in x) == is_remark] for is_remark in (True, False))
    assert lines[4:] == remarks + rest and all("times its light" in x for x in remarks)
    assert rest[0].startswith("frame1: all.psnr>=30 is not met")


def test_a_report_that_cannot_be_written_is_one_line(pairs: Any, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"gone/r\.html"):
        compare(pairs, html=tmp_path / "gone" / "r.html")


def test_a_missing_package_is_one_line(pairs: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    from mirelight.base.errors import MirelightError

    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(MirelightError, match=r"pip install 'mirelight\[compare\]'"):
        compare(pairs)


def test_frames_without_a_partner_are_said_and_fail_requirements(
    made: Any, save: Any, page: Any, tmp_path: Path
) -> None:
    for name in ("ref/one.png", "ref/two.png", "test/one.png", "test/three.png"):
        save(made(), name)
    found = find_pairs([tmp_path / "ref"], [tmp_path / "test"])
    outcome = compare(found, json=tmp_path / "r.json", html=tmp_path / "r.html")
    lines = [f"two: no partner in {tmp_path / 'test'}", f"three: no partner in {tmp_path / 'ref'}"]
    assert (list(outcome.unpaired), outcome.failures) == (lines, ())
    assert json.loads((tmp_path / "r.json").read_text())["unpaired"] == lines
    assert summary(outcome).splitlines()[2:] == [f"not compared: {line}" for line in lines]
    page.open(tmp_path / "r.html", 1280, 900, "light")
    page.run("document.querySelector('details.unpaired').open = true")
    assert page.run("[...document.querySelectorAll('.unpaired li')].map(x => x.innerText)") == lines
    assert compare(found, requirements=[parse_requirement("psnr>=30")]).failures == (lines[0],)
