"""The table of layers and AOVs holds every picture that the result types have, once."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from mirelight.base.errors import MirelightError
from mirelight.io.job import load
from mirelight.model import F32, Frame, LightingBuffer, LightLayer, OutputSettings, SplatLayer
from mirelight.model.planes import AOVS, EXACT, LIGHT_PLANES, MATTES, PLANES, Owner, planes_of

TYPES: dict[Owner, type] = {"frame": Frame, "splats": SplatLayer, "lighting": LightingBuffer, "layer": LightLayer}
ELSEWHERE = {("frame", "rgba"), ("lighting", "coverage")}  # the picture itself, and the alpha of `lighting`
ELSEWHERE |= {("splats", "diffuse"), ("splats", "beyond")}  # relighting's own, in no file
ELSEWHERE |= {("layer", name) for name in ("half", "quarter", "other_quarter")}  # the denoiser's own, in no file

DERIVED = {"rgba", "noisy_beauty"}  # rows of sums


@pytest.mark.parametrize("owner", [x for x in get_args(Owner) if x != "objects"])  # some of what a lighting has
def test_every_picture_of_the_result_types_has_a_row(owner: Owner) -> None:
    hints = get_type_hints(TYPES[owner])
    pictures = {f.name for f in fields(TYPES[owner]) if hints[f.name] in (F32, F32 | None)}
    rows = [plane.field for plane in planes_of(owner)]
    assert len(rows) == len(set(rows))
    assert pictures == (set(rows) - DERIVED) | {name for kind, name in ELSEWHERE if kind == owner}


def test_names_are_unique_and_plain() -> None:
    assert len(set(AOVS)) == len(AOVS) == len(PLANES)
    assert all(name.replace("_", "").isalnum() and name.isascii() for name in AOVS)
    assert not any(name.startswith("light_") for name in AOVS)
    assert all(plane.name.startswith("light_NAME_") for plane in LIGHT_PLANES)


def test_the_page_on_outputs_shows_the_table() -> None:
    page = (Path(__file__).parents[3] / "docs" / "reference" / "outputs.md").read_text(encoding="utf-8")
    shown = re.findall(r"^\| `(\w+)` \| ([RGBAXYZ ]+) \| ([^|]+) \| ([^|]+) \|$", page, flags=re.MULTILINE)
    expected = []
    for plane in (*PLANES, *LIGHT_PLANES):
        marks = [name for name in ("half", "exact") if getattr(plane, name)]
        expected.append((plane.name, " ".join(plane.channels), ", ".join(marks) or "–", plane.meaning))
    assert shown == expected


def test_settings_want_what_they_name() -> None:
    assert all(OutputSettings().wants(name) for name in AOVS)
    some = OutputSettings(aovs=("depth",), layers=False)
    assert [name for name in AOVS if some.wants(name)] == ["depth"] and some.wants("normal", "depth")
    assert [name for name in AOVS if OutputSettings(aovs=False).wants(name)] == [
        "lighting"
    ]  # its alpha goes with layers
    assert not any(OutputSettings(exr=False).wants(name) for name in AOVS)
    assert {name for name in AOVS if not OutputSettings(compression="dwaa").wants(name)} == EXACT - set(MATTES)
    assert [name for name in MATTES if OutputSettings().wants(name)] == []  # by name alone
    with pytest.raises(ValueError, match="no layer 'depht'"):
        OutputSettings(aovs=("depht",))


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ('aovs = ["depht"]', "aovs: no layer 'depht'; did you mean \"depth\"?"),
        ('aovs = ["xyzzy"]', "aovs: no layer 'xyzzy'; there are unlit, factor"),
        ("aovs = 1", "aovs: 1; give true, false, or a list of names"),
        ('aovs = ["depth", 1]', "give true, false, or a list of names"),
        ('compression = "zipp"', 'did you mean "zip"'),
        ('compression = "dwaa"\naovs = ["normal"]', "compression: dwaa, which would round normal; use "),
    ],
)
def test_wrong_names_in_a_job_are_one_line(tmp_path: Path, line: str, expected: str) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8")
    job = tmp_path / "job.toml"
    job.write_text(f'proxy = "a.obj"\n[environment]\nradiance = 1.0\n[[cameras]]\n[output]\n{line}\n', encoding="utf-8")
    with pytest.raises(MirelightError) as error:
        load(job)
    assert any(expected in text for text in str(error.value).splitlines())


def test_names_in_a_job_reach_the_settings(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8")
    job = tmp_path / "job.toml"
    text = 'proxy = "a.obj"\n[environment]\nradiance = 1.0\n[[cameras]]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n'
    job.write_text(text + '[output]\naovs = ["normal", "depth", "normal"]\ncompression = "none"\n', encoding="utf-8")
    output = load(job).output
    assert (output.aovs, output.compression) == (("normal", "depth"), "none")
