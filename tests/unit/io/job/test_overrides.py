"""Settings from the command line over a job file."""

from __future__ import annotations

import pytest

from mirelight.base.errors import InputError
from mirelight.io import job
from mirelight.io.job.overrides import parse

from .conftest import Complaints, WriteJob

SCENE = 'splats = "splats.ply"\nproxy = "proxy.glb"\n'
LAMP = '[[lights]]\ntype = "point"\nposition = [0, 1, 0]\n'


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("render.spp=256", ("render", "spp"), 256),
        ("relight.mode=ratio", ("relight", "mode"), "ratio"),
        ('relight.mode="ratio"', ("relight", "mode"), "ratio"),
        ("lights[2].color=[1, 0.5, 0]", ("lights", 2, "color"), [1, 0.5, 0]),
        ("lightings[0].lights[1].range = 3.5", ("lightings", 0, "lights", 1, "range"), 3.5),
        ("output.png=false", ("output", "png"), False),
        ("splats=../a b/c.ply", ("splats",), "../a b/c.ply"),
        ("environment={ radiance = 1 }", ("environment",), {"radiance": 1}),
        ('display."tone"=agx', ("display", "tone"), "agx"),
        ("output.directory='a=b'", ("output", "directory"), "a=b"),
    ],
)
def test_key_and_value(text: str, path: tuple[str | int, ...], value: object) -> None:
    override = parse(text)
    assert (override.path, override.value, override.source) == (path, value, f"--set {text}")


@pytest.mark.parametrize(
    "text",
    [
        "render.spp",
        "=3",
        "render..spp=3",
        "render.=3",
        ".spp=3",
        "[0]=3",
        "render spp=3",
        "a[x]=3",
        "a=[1,",
        "a=1\nb=2",
        "a=",
    ],
)
def test_what_is_no_override(text: str) -> None:
    with pytest.raises(InputError, match=r"^--set "):
        parse(text)


def test_they_are_laid_over_the_file_in_order(write_job: WriteJob) -> None:
    path = write_job(SCENE + LAMP + "[render]\nspp = 4\n")
    loaded = job.load(
        path, ["render.spp=8", "render.spp=16", "render.seed=3", "lights[0].intensity=7", "display.tone=agx"]
    )
    assert (loaded.render.spp, loaded.render.seed, loaded.display.tone) == (16, 3, "agx")
    assert loaded.lightings[0].lights[0].intensity == 7
    assert job.load(path).render.spp == 4


def test_their_mistakes_name_them(complaints: Complaints) -> None:
    found = complaints(SCENE + "[render]\nspp = 0\n", "render.seed=-1", "relight.blend=3", "rendr.spp=3")
    assert found == [
        "job.toml:4:7: render.spp: 0; give a number of at least 1",
        "--set render.seed=-1: render.seed: -1; give a number of at least 0",
        "--set relight.blend=3: relight.blend: 3; give a number of at most 1",
        "--set rendr.spp=3: rendr: unknown key; did you mean render?",
    ]


def test_an_override_repairs_a_mistake_of_the_file(complaints: Complaints) -> None:
    assert complaints(SCENE + "[render]\nspp = 0\n", "render.spp=1") == []


def test_a_mistake_inside_an_overridden_table_names_the_override(complaints: Complaints) -> None:
    (found,) = complaints(SCENE + "environment = { radiance = 1 }\n", "environment={ radiance = -1 }")
    assert found.startswith("--set environment={ radiance = -1 }: environment.radiance")


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("lights[3].intensity=1", "lights has 1 entry; count from 0"),
        ("lights.intensity=1", "lights is not a table; name an entry by its index, e.g. lights[0]"),
        ("splats.lod=1", "splats is not a table; set it as a whole"),
        ("render[0]=1", "render is not a list; leave the index out"),
        ("lights[0][1]=1", "lights[0] is not a list; leave the index out"),
    ],
)
def test_what_does_not_fit(complaints: Complaints, override: str, expected: str) -> None:
    assert complaints(SCENE + LAMP + "[render]\nspp = 4\n", override) == [f"--set {override}: {expected}"]
