"""Every class of lights is known everywhere: each goes through every reader, writer and list.

A class that fails here lacks something of its record, or a line where the message says.
"""

from __future__ import annotations

import json
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.apps.explain import light as explain
from mirelight.apps.inspect.facts import light_facts
from mirelight.apps.studio import server as studio
from mirelight.base import conventions
from mirelight.cli import report
from mirelight.dataset import rig
from mirelight.io import job as jobs
from mirelight.io import records
from mirelight.io.gltf.scene import read_lights
from mirelight.io.gltf.write import write_lights
from mirelight.io.job.captured_text import captured_text
from mirelight.io.job.write import light_table, text_of
from mirelight.lighting.grid import build
from mirelight.lighting.lights import Kind, brightness, pack, seeds
from mirelight.model import (
    LIGHT_CLASSES,
    DirectionalLight,
    IesProfile,
    Light,
    Lighting,
    PointLight,
    PosedLight,
    ProxyMesh,
    SpotLight,
    digest,
)
from mirelight.model.ies import AROUND, DOWN
from mirelight.model.light_classes import kind_named, punctual
from mirelight.model.playcanvas_lights import to_engine
from mirelight.model.surface_lights import DESCRIBED
from mirelight.model.unit_lights import Unit, terms
from mirelight.store import layer_records
from mirelight.store.layer_index import UnitLight

DOCS = Path(__file__).resolve().parents[3] / "docs" / "reference"
FLOOR = ProxyMesh(
    vertices=np.array([[-3, 0, -3], [3, 0, -3], [3, 0, 3], [-3, 0, 3]], np.float32),
    faces=np.array([[0, 2, 1], [0, 3, 2]], np.int32),
)
GIVEN = {  # what no class has a default for
    "position": np.array([0.5, 2.0, -0.25]),
    "direction": np.array([0.6, -0.8, 0.0]),
    "world_from_light": conventions.look_at([0.5, 2.0, -0.25], [1.0, 0.0, 0.5]),
    "shape": "rectangle",
    "size": (1.0, 0.5),
}


def example(kind: type[Light]) -> Light:
    """A light of a class, with the defaults of its record."""
    needed = [
        f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING and f.name != "name"
    ]
    unknown = [name for name in needed if name not in GIVEN and name not in {x.name for x in kind.KIND.fields}]
    assert not unknown, f"{kind.__name__}: give {unknown} a default, or a LightField in its KIND"
    numbers = {x.name: x.default for x in kind.KIND.fields if np.isfinite(x.default)}
    values: dict[str, Any] = {"name": "one", "color": np.array([1.0, 0.5, 0.25]), "intensity": 40.0}
    values |= {x: GIVEN[x] for x in needed} | numbers
    return kind(**values)


every = pytest.mark.parametrize("light", [example(x) for x in LIGHT_CLASSES], ids=lambda x: x.KIND.name)


def test_names_of_kinds_differ_and_fields_are_attributes() -> None:
    assert len({x.KIND.name for x in LIGHT_CLASSES}) == len(LIGHT_CLASSES)
    for one in LIGHT_CLASSES:
        assert kind_named(one.KIND.name) is one.KIND
        own = {f.name for f in fields(one)}
        assert {x.name for x in one.KIND.fields} <= own, f"{one.__name__}.KIND has a field that the class has not"
        if one in DESCRIBED:
            common = {"name", "color", "intensity", "group", "world_from_light"}
            assert own - common == {x.name for x in one.KIND.fields}, (
                f"{one.__name__}.KIND: a LightField for each number"
            )


@every
def test_it_answers_what_lights_are_asked(light: Light) -> None:
    moved = light.moved_to((1, 2, 3))
    assert type(moved) is type(light)
    if light.place is None:
        assert moved is light
    else:
        assert moved.place is not None
        np.testing.assert_array_equal(moved.place, [1, 2, 3])
    carried = light.carried(conventions.compose((1, 0, 0), conventions.rotation_from_euler((0, 90, 0)), 2.0))
    assert type(carried) is type(light)
    assert isinstance(light.is_sharp, bool)
    plain = punctual(light)
    assert isinstance(plain, DirectionalLight | PointLight | SpotLight)
    assert plain.name == light.name


def test_a_profile_is_carried_with_its_light() -> None:
    turn = conventions.compose((1, 0, 0), conventions.rotation_from_euler((0, 0, 90)), 2.0)
    down, share = np.array([0.0, -1.0, 0.0]), np.ones((AROUND, DOWN), np.float32)
    profile = IesProfile(share=share, nadir=down, zero=np.array([0.0, 0.0, 1.0]))
    for light in (
        PointLight(name="bulb", position=np.ones(3), profile=profile),
        SpotLight(name="spot", position=np.ones(3), direction=down, profile=profile),
    ):
        carried = light.carried(turn)
        assert carried.profile is not None
        np.testing.assert_allclose(carried.profile.nadir, [1, 0, 0], atol=1e-12)
        np.testing.assert_allclose(carried.profile.zero, [0, 0, 1], atol=1e-12)


@every
def test_a_glowing_surface_sends_out_what_is_seen_of_it(light: Light) -> None:
    if not isinstance(light, PosedLight):
        return
    ways = conventions.map_direction((np.arange(512) + 0.5) / 512, ((np.arange(256) + 0.5) / 256)[:, None])
    solid = np.sin(np.pi * (np.arange(256) + 0.5) / 256)[:, None] * (np.pi / 256) * (2 * np.pi / 512)
    candela = light.intensity * light.seen_area(ways.reshape(-1, 3)).reshape(256, 512)
    assert float(candela.max()) == pytest.approx(light.peak, rel=1e-3)
    assert float((candela * solid).sum()) == pytest.approx(light.flux, rel=1e-3)


@every
def test_a_job_file_keeps_it(light: Light, tmp_path: Path) -> None:
    (tmp_path / "floor.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 3 2\n")
    data = {"proxy": "floor.obj", "lights": [light_table(replace(light, group="g"))]}
    data["cameras"] = [{"name": "c", "type": "perspective", "position": [0, 1, 3], "target": [0, 0, 0]}]
    job = jobs.load_text(text_of(data, tmp_path, tmp_path / "job.toml", ()), tmp_path / "job.toml")
    found = job.lightings[0].lights[0]
    assert type(found) is type(light), "mirelight/io/job/lighting.py: a case for its table"
    same(found, replace(light, group="g"))


@every
def test_a_gltf_file_keeps_it(light: Light, tmp_path: Path) -> None:
    write_lights(tmp_path / "a.gltf", [light])
    (found,) = read_lights(tmp_path / "a.gltf")
    same(found, light)


def test_a_stage_keeps_all_and_other_programs_see_lights(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    from mirelight.io.usd.lights import read_lights as read_stage
    from mirelight.io.usd.write import StageWriter
    from mirelight.io.usd.write_lights import add_light

    lights = [replace(example(x), name=x.KIND.name) for x in LIGHT_CLASSES]
    writer = StageWriter(tmp_path / "a.usda")
    for light in lights:
        add_light(writer, light)
    writer.save()
    assert digest(*read_stage(tmp_path / "a.usda").lights) == digest(*lights)
    (tmp_path / "b.usda").write_text((tmp_path / "a.usda").read_text().replace("mirelight:seal", "mirelight:other"))
    for found, light in zip(read_stage(tmp_path / "b.usda").lights, lights, strict=True):
        assert (found.place is None) == (light.place is None)
        if light.KIND.usd is not None:
            same(found, light)


@every
def test_an_index_of_layers_keeps_it(light: Light) -> None:
    packed = json.loads(json.dumps(records.packed(UnitLight("lamp", "lamp", (light,), 0, ""))))
    assert digest(*records.made(UnitLight, packed).lights) == digest(light)
    assert layer_records._kind(Unit(lights=(light,))) == light.KIND.layer


@every
def test_it_is_listed_with_its_unit_and_its_numbers(light: Light) -> None:
    facts = light_facts(light)
    line = report._light(facts)
    assert facts.type == light.KIND.name
    assert f"{light.KIND.name}" in line
    assert f"40 {light.KIND.unit.symbol}" in line
    text = captured_text(Lighting(lights=(light,)), "sky.exr", [])
    assert f"intensity = 40  # {light.KIND.unit.name}" in text
    if isinstance(light, PosedLight) and type(light) in DESCRIBED:
        for one in light.KIND.fields:
            assert f"{one.name} {getattr(light, one.name):.4g}" in line


@every
def test_a_data_set_has_it_in_its_own_world(light: Light) -> None:
    part = rig._light(light, conventions.compose((1, 2, 3), None, 2.0))
    assert part["type"] == light.KIND.name
    assert part["intensity"] == pytest.approx(40 * 2**light.KIND.unit.grows)
    assert light.KIND.name in rig._UNITS
    for one in light.KIND.fields:
        if one.name in part:
            factor = 2 if one.unit == "world units" else 1
            assert part[one.name] == pytest.approx(factor * getattr(light, one.name))


@every
def test_the_engine_gets_a_light_for_it(light: Light) -> None:
    engine, _ = to_engine(Lighting(lights=(light,)), FLOOR)
    (found,) = engine.lights
    assert found.linear_color.max() > 0


@every
def test_the_tracer_knows_it(light: Light) -> None:
    table = pack((light,))
    kind = Kind(int(table[0, 3]))
    plain = punctual(light)
    assert brightness(table)[0] == pytest.approx(plain.intensity * np.mean([1, 0.5, 0.25]), rel=0.3), (
        f"mirelight/lighting/lights.py: brightness() of {kind.name}"
    )
    assert len(seeds((light,))) == 2
    many = tuple(replace(light, name=str(i)) for i in range(14))
    assert len(build(many, (np.full(3, -3.0, np.float32), np.full(3, 3.0, np.float32)), separate=True).lights) >= 14


@every
def test_it_is_a_layer_that_can_be_dimmed(light: Light) -> None:
    (term,) = terms(Lighting(lights=(light,)))
    assert term.layer == "one"
    np.testing.assert_allclose(term.weight, light.color * light.intensity)
    assert explain._irradiance(light, np.array([[0.5, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])).shape == (1, 3)


@every
def test_the_studio_has_rows_for_it(light: Light) -> None:
    known = studio._kinds()[light.KIND.name]
    assert known["unit"] == light.KIND.unit.name
    assert bool(known["fields"]) == (type(light) in DESCRIBED and bool(light.KIND.fields))


@every
def test_the_pages_name_it(light: Light) -> None:
    heading = f"### lights of type {light.KIND.name}"
    assert heading in (DOCS / "job-file.md").read_text(), f"docs/reference/job-file.md: a section {heading!r}"
    if light.KIND.aim:
        assert f"| {light.KIND.name} |" in (DOCS / "lights.md").read_text(), (
            "docs/reference/lights.md: a row of its table"
        )


def same(found: Light, light: Light) -> None:
    """Equal but for rounding."""
    assert type(found) is type(light)
    for one in fields(light):
        a, b = getattr(found, one.name), getattr(light, one.name)
        if isinstance(b, float | tuple | np.ndarray) and one.name != "group":
            np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6, err_msg=one.name)
        else:
            assert a == b, one.name
