"""Job files that mean harm: depth, size, and characters that act on terminals. One clear line each, and soon."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirelight.base.errors import InputError, ManyInputsError, OutputError, printable
from mirelight.base.names import FreeNames
from mirelight.io import job
from mirelight.io.atomic import atomic_path
from mirelight.io.gltf.names import unique_names

from .conftest import Complaints, WriteJob

SCENE = 'splats = "splats.ply"\nproxy = "proxy.glb"\n'


@pytest.mark.parametrize(
    "text",
    [
        f"x = {'[' * 300}{']' * 300}",
        f"x = {'[' * 30000}{']' * 30000}",
        f"x = {'{a = ' * 300}1{'}' * 300}",
        f"[{'.'.join('a' * 500)}]\nb = 1",
        f"{'.'.join('a' * 500)} = 1",
        f"{'.'.join(['a'] * 400_000)} = 1",
        "\n".join(f"[{'.'.join('a' * depth)}]" for depth in range(1, 200)),
    ],
    ids=["lists", "many lists", "tables", "header", "dotted key", "endless key", "headers"],
)
def test_nested_hundreds_deep(complaints: Complaints, text: str) -> None:
    assert complaints(SCENE + text) == ["job.toml: not TOML: nested too deeply; a job needs no such value"]


@pytest.mark.parametrize(
    "override", [f"render={'[' * 500}{']' * 500}", f"{'.'.join('a' * 500)}=1", "render.spp=" + "9" * 5000]
)
def test_an_override_as_deep_or_as_long(complaints: Complaints, override: str) -> None:
    (line,) = complaints(SCENE, override)
    assert line.startswith(f"--set {override[:20]}")


@pytest.mark.parametrize("number", ["9" * 4000, "0x" + "f" * 5000, str(2**63), f"-{'9' * 100}"])
def test_integers_that_toml_does_not_have(complaints: Complaints, number: str) -> None:
    assert complaints(f"{SCENE}[render]\nspp = {number}") == [
        "job.toml:4:7: render.spp: a number of more than 64 bits; give a smaller number"
    ]


def test_integers_of_thousands_of_digits(complaints: Complaints) -> None:
    (line,) = complaints(f"{SCENE}[render]\nspp = {'9' * 5000}")
    assert line.startswith("job.toml: not TOML: Exceeds the limit (4300 digits)")


def test_noise_that_would_never_be_reached(complaints: Complaints) -> None:
    assert complaints(f"{SCENE}[render]\nnoise = 1e-30") == [
        "job.toml:4:9: render.noise: 1e-30; give a number of at least 0.0001"
    ]
    assert complaints(f"{SCENE}[render]\nnoise = 1e-4") == []


def test_a_hundred_thousand_mistakes(complaints: Complaints) -> None:
    lines = complaints(SCENE + "\n".join(f"key_{i} = 1" for i in range(100_000)))
    assert len(lines) <= 101
    assert lines[0] == "job.toml:3:1: key_0: unknown key; remove it"


def test_a_hundred_thousand_doubles(complaints: Complaints) -> None:
    lines = complaints(SCENE + '[[cameras]]\nname = "a"\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\n' * 2000)
    assert len(lines) == 101
    assert lines[-1] == "job.toml: more mistakes than these; mend them first"


def test_a_hundred_thousand_of_one_name() -> None:
    count = 100_000
    names = FreeNames({"lamp-3"})
    given = [names.take("lamp") for _ in range(count)]
    assert given[:4] == ["lamp", "lamp-2", "lamp-4", "lamp-5"]
    assert len(set(given)) == count
    assert unique_names([("lamp", "", "point")] * count)[-1] == f"lamp {count}"


def test_unnamed_lights_and_cameras_by_thousands(write_job: WriteJob) -> None:
    count = 5000
    lights = '[[lights]]\ntype = "point"\nposition = [0, 1, 0]\n' * count
    cameras = "[[cameras]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\n" * count
    work = job.load(write_job(SCENE + lights + cameras))
    assert work.lightings[0].lights[-1].name == f"point-{count}"
    assert work.cameras[-1].name == f"camera-{count}"


def test_messages_hold_nothing_that_a_terminal_obeys(write_job: WriteJob) -> None:
    path = write_job(SCENE + '[render]\n"\\u001b[2J\\u009b\\u202e" = 1\n')
    for overrides in ([], ["\x1b[31m=1"], ["render.spp=\udcff\x07"]):
        with pytest.raises((InputError, ManyInputsError)) as caught:
            job.load(path, overrides)
        assert all(line.isprintable() for line in str(caught.value).split("\n"))
    assert printable("plain ünïcode 漢字") == "plain ünïcode 漢字"
    assert printable("\x1b[2J\udc80") == r"\x1b[2J\udc80"
    assert unique_names([("a\x1b]0;x\x07", "", "point")]) == [r"a\x1b]0;x\x07"]


def test_names_that_a_terminal_obeys_are_refused(complaints: Complaints) -> None:
    lamp = '[[lights]]\ntype = "point"\nposition = [0, 1, 0]\n'
    (line,) = complaints(f'{SCENE}{lamp}name = "\\u001b[2J"')
    assert line.startswith(r"job.toml:6:8: lights[0].name: '\x1b[2J' has characters that cannot be shown")
    for name in (r"\u0000", r"\u001b[2J"):
        (line,) = complaints(f'{SCENE}[output]\ndirectory = "{name}"')
        assert line.startswith("job.toml:4:13: output.directory: ") and "cannot be a folder's name" in line


def test_a_scale_that_leaves_nothing(complaints: Complaints) -> None:
    rows = "[1e-300, 0, 0, 0], [0, 1e-300, 0, 0], [0, 0, 1e-300, 0], [0, 0, 0, 1]"
    for transform in ("scale = 1e-300", f"matrix = [{rows}]"):
        (line,) = complaints(f'splats = {{ path = "splats.ply", transform = {{ {transform} }} }}')
        assert line.startswith("job.toml:1:") and ": splats" in line


def test_output_does_not_take_the_place_of_a_device(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="a pipe or a device"), atomic_path("/dev/null"):
        pass
    with pytest.raises(OutputError, match="cannot be written"), atomic_path(tmp_path / "a\0b"):
        pass
