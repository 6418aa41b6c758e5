"""Jobs that are written say what was to be said, wherever they stand."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io import job
from mirelight.io.gltf.write import write_glb
from mirelight.io.job.write import with_lighting
from mirelight.model import Job, ProxyMesh, SpotLight

JOB = """\
proxy = "proxy.glb"
captured = { environment = { radiance = 0.5 } }

[[cameras]]
name = "front view"
position = [0, 1, 6]
target = [0, 0, 0]

[[lightings]]
name = "day"
lights_from = { path = "proxy", group = "lamps" }
environment = { radiance = [1, 0.5, 0.25], intensity = 3 }

[[lightings.lights]]
type = "area"
position = [0, 3, 0.5]
target = [0.3, 0, 0]
size = [1, 2]

[[lightings.lights]]
type = "sun"
direction = [-1, -2, 0.5]
angular_diameter = 3

[[lightings.lights]]
type = "point"
position = [1, 2, 3]
range = 12
radius = 0.2
color = [1, 0.5, 0]

[[lightings]]
name = "sky"
environment = { sky = { latitude = 52.5, longitude = 13.4, time = 2026-06-21T18:30:00+02:00 }, intensity = 0.00003 }

[output]
directory = "out"

[mix]
environment = 0.5
sun = [1, 0.5, 0.25]
day = { lamps = 7 }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    floor = ProxyMesh(
        vertices=np.array([[-3, -1, -3], [3, -1, -3], [3, -1, 3], [-3, -1, 3]], dtype=np.float32),
        faces=np.array([[0, 2, 1], [0, 3, 2]], dtype=np.int32),
    )
    spot = SpotLight(name="spot", position=np.array([0.0, 3, 0]), direction=np.array([0.1, -1, 0]), intensity=20.0)
    write_glb(tmp_path / "proxy.glb", floor, [spot])
    (tmp_path / "job.toml").write_text(JOB, encoding="utf-8")
    return tmp_path


def same(a: object, b: object) -> bool:
    return all(
        getattr(a, f.name) == getattr(b, f.name)
        if not isinstance(getattr(a, f.name), np.ndarray | float)
        else np.allclose(getattr(a, f.name), getattr(b, f.name), atol=1e-12)
        for f in fields(a)  # type: ignore[arg-type]
    )


def rewritten(folder: Path, path: Path, index: int) -> tuple[Job, Job]:
    """The job, and the one read from the text with brighter lights."""
    source, _ = job.parse(folder / "job.toml")
    old = job.load(folder / "job.toml")
    chosen = old.lightings[index]
    brighter = replace(chosen, lights=tuple(replace(x, intensity=2 * x.intensity) for x in chosen.lights))
    path.write_text(with_lighting(source, old, brighter, path, ["made\nby a test"]), encoding="utf-8")
    return replace(old, lightings=tuple(brighter if x is chosen else x for x in old.lightings)), job.load(path)


@pytest.mark.parametrize("place", ["again.toml", "there/again.toml"])
def test_every_kind_of_light_comes_back(folder: Path, place: str) -> None:
    (folder / "there").mkdir()
    wanted, found = rewritten(folder, folder / place, 0)
    assert [x.name for x in found.lightings] == ["day", "sky"]
    for a, b in zip(wanted.lightings[0].lights, found.lightings[0].lights, strict=True):
        assert type(a) is type(b)
        assert same(a, b), (a, b)
    around = found.lightings[0].environment
    assert around is not None
    np.testing.assert_allclose(around.pixels.reshape(3) * around.intensity, [3, 1.5, 0.75], rtol=1e-6)
    assert found.lightings[0].factors().keys() == wanted.lightings[0].factors().keys()
    assert found.proxy is not None and wanted.proxy is not None and found.proxy.digest == wanted.proxy.digest
    assert found.cameras[0].name == wanted.cameras[0].name
    assert found.output.directory == wanted.output.directory


def test_a_sky_keeps_its_sun(folder: Path) -> None:
    wanted, found = rewritten(folder, folder / "again.toml", 1)
    old, new = wanted.lightings[1].sky, found.lightings[1].sky
    assert old is not None and new is not None and same(old, new)
    np.testing.assert_array_equal(found.lightings[1].factors()["sun"], [1, 0.5, 0.25])


def test_the_captured_light_is_not_replaced(folder: Path) -> None:
    text = JOB.replace("{ environment = { radiance = 0.5 } }", '"day"')
    (folder / "job.toml").write_text(text, encoding="utf-8")
    source, _ = job.parse(folder / "job.toml")
    old = job.load(folder / "job.toml")
    with pytest.raises(InputError, match="captured light"):
        with_lighting(source, old, old.lightings[0], folder / "again.toml", [])
