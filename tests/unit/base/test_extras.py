"""What is optional: one table, the same as pyproject's, and said before any work where it is missing."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.apps import doctor
from mirelight.base import extras
from mirelight.base.errors import BackendError, InputError
from mirelight.cli import main
from mirelight.model import Deferred, DirectionalLight, Job, Lighting, ProxyMesh, RenderSettings
from mirelight.pipeline.scene import prepare

ROOT = Path(__file__).resolve().parents[3]
FOR_DEVELOPERS = {"test", "docs"}
ALL = "all"
FLOOR = ProxyMesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], np.int32))
SUN = Lighting(lights=(DirectionalLight(name="sun", direction=np.array([0.0, -1.0, 0.0])),))


def declared() -> dict[str, set[str]]:
    """Packages of every extra in pyproject.toml but those for developers."""
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    return {
        name: {re.split(r"[<>=]", line)[0] for line in lines}
        for name, lines in listed.items()
        if name not in {*FOR_DEVELOPERS, ALL}
    }


def test_all_are_all_that_commands_need() -> None:
    (line,) = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"][ALL]
    named = re.fullmatch(r"mirelight\[(.*)\]", line)
    assert named and set(named[1].split(",")) == {extra.name for extra in extras.EXTRAS} - {"scenes"}


def test_the_table_is_that_of_the_package() -> None:
    needed = {"scipy"}  # of every installation
    found = {extra.name: {package for _, package in extra.packages} for extra in extras.EXTRAS}
    assert found == {name: packages - needed for name, packages in declared().items()}


def test_the_page_names_every_extra() -> None:
    page = (ROOT / "docs" / "guides" / "install.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| ([^|]*) \| ([^|]*) \|$", page, flags=re.MULTILINE)
    said = {name: {x.strip(" `") for x in packages.split(",")} for name, packages, _ in rows}
    for extra in extras.EXTRAS:
        assert said[extra.name] >= {package for _, package in extra.packages}


def without(monkeypatch: pytest.MonkeyPatch, *modules: str) -> None:
    for module in modules:
        monkeypatch.setitem(sys.modules, module, None)


@pytest.mark.parametrize("extra", extras.EXTRAS, ids=lambda x: x.name)
def test_what_is_missing_is_said_in_one_line(extra: extras.Extra, monkeypatch: pytest.MonkeyPatch) -> None:
    module, package = extra.packages[-1]
    without(monkeypatch, module)
    assert package in extras.missing(extra.name)
    with pytest.raises(BackendError) as told:
        extras.require(extra.name, module)
    assert str(told.value).startswith(
        f"{extra.what} needs the package {package}: pip install 'mirelight[{extra.name}]'"
    )
    assert "\n" not in str(told.value)
    line = dict(doctor._extras())[extra.name]
    assert package in line and f"pip install 'mirelight[{extra.name}]'" in line and extra.unlocks in line


def test_the_doctor_says_what_is_there() -> None:
    line = dict(doctor._extras())["formats"]
    assert line == "installed; for glTF files with EXT_meshopt_compression"


def test_denoising_is_refused_before_anything_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> ProxyMesh:
        raise AssertionError("the proxy was read")

    without(monkeypatch, "pyoidn")
    settings: dict[str, Any] = {"proxy": Deferred("digest", broken), "lightings": (SUN,)}
    job = Job(source=Path("job.toml"), render=RenderSettings(denoise=True), **settings)
    with pytest.raises(BackendError, match=r"denoising needs the package pyoidn: pip install 'mirelight\[denoise\]'"):
        prepare(job)
    prepare(Job(source=Path("job.toml"), **settings))  # not asked for
    engine = RenderSettings(denoise=True, profile="playcanvas")  # has no noise
    prepare(Job(source=Path("job.toml"), render=engine, **settings))


def test_the_command_says_it_before_it_makes_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from mirelight.io.gltf.write import write_glb

    write_glb(tmp_path / "floor.glb", FLOOR, SUN.lights)
    job = tmp_path / "job.toml"
    job.write_text('proxy = "floor.glb"\nrender = { denoise = true }\n')
    without(monkeypatch, "pyoidn")
    for more in ([], ["--workers", "2"]):
        assert main(["render", str(job), "-o", str(tmp_path / "out"), *more]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "pip install 'mirelight[denoise]'" in line
    assert not (tmp_path / "out").exists()


def test_a_packed_proxy_is_refused_when_the_job_is_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import mirelight

    packed = '{"asset": {"version": "2.0"}, "extensionsRequired": ["EXT_meshopt_compression"]}'
    (tmp_path / "packed.gltf").write_text(packed)
    (tmp_path / "job.toml").write_text(
        'proxy = "packed.gltf"\nlights = []\ncameras = [{ position = [0, 0, 5], target = [0, 0, 0] }]\n'
    )
    assert mirelight.load(tmp_path / "job.toml").proxy is not None
    without(monkeypatch, "meshopt")
    with pytest.raises(InputError, match=r"meshopt compression; pip install 'mirelight\[formats\]', or export without"):
        mirelight.load(tmp_path / "job.toml")
