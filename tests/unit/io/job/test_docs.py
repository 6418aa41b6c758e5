"""docs/reference/job-file.md and docs/job.schema.json say what the code does."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import jsonschema  # type: ignore[import-untyped]
import pytest

from mirelight.io.job.tables import json_schema
from mirelight.model.surface_lights import DESCRIBED

DOCS = Path(__file__).resolve().parents[4] / "docs"
PAGE = (DOCS / "reference" / "job-file.md").read_text(encoding="utf-8")

# The heading of each table in the page, and its definition in the schema ("": the top).
SECTIONS = {
    "The job": "",
    "splats": "SplatsTable",
    "proxy": "ProxyTable",
    "materials": "MaterialTable",
    "mask of materials": "MaskTable",
    "objects": "ObjectTable",
    "keys of objects": "KeyTable",
    "scatter of objects": "ScatterTable",
    "transform": "Transform",
    "environment": "EnvironmentTable",
    "sky": "SkyTable",
    "lights of type directional": "DirectionalTable",
    "lights of type sun": "SunTable",
    "lights of type moon": "MoonTable",
    "lights of type point": "PointTable",
    "lights of type spot": "SpotTable",
    "a spot's cone as in KHR": "KhrConeTable",
    "lights of type area": "AreaTable",
    "lights of type playcanvas": "PlayCanvasTable",
    **{f"lights of type {x.KIND.name}": f"{x.KIND.name.capitalize()}Table" for x in DESCRIBED},
    "lights_from": "LightsFromTable",
    "lightings": "LightingTable",
    "captured": "CapturedTable",
    "sweep": "SweepTable",
    "axes of a sweep": "AxisTable",
    "places of an axis": "BallTable",
    "cameras of type perspective": "PerspectiveTable",
    "cameras of type orthographic": "OrthographicTable",
    "cameras of type turntable": "TurntableTable",
    "cameras of type orbit": "OrbitTable",
    "cameras of type sphere": "SphereTable",
    "cameras of type dome": "DomeTable",
    "cameras of type random": "RandomTable",
    "cameras of type around": "AroundTable",
    "cameras_from": "CamerasFromTable",
    "render": "RenderTable",
    "compositor": "CompositorTable",
    "relight": "RelightTable",
    "display": "DisplayTable",
    "display.background": "BackgroundTable",
    "display.background.ground": "GroundTable",
    "output": "OutputTable",
    "dataset": "DatasetTable",
    "engine": "EngineTable",
}


SHARED = {"lights of type": "keys of every light", "cameras of type": "keys of every camera"}  # said once a kind


def shared(heading: str) -> dict[str, tuple[str, str]]:
    """Key -> (default, meaning) of what all types of a kind have, and the table of one need not repeat."""
    return next((rows(common) for kind, common in SHARED.items() if heading.startswith(kind)), {})


def rows(heading: str) -> dict[str, tuple[str, str]]:
    """Key -> (default, meaning) of the table below a heading of the page."""
    section = re.split(r"^#+ ", PAGE.split(f"# {heading}\n", 1)[1], maxsplit=1, flags=re.MULTILINE)[0]
    found = re.findall(r"^\| `(\w+)` \| (.*?) \| (.*?) \|$", section, flags=re.MULTILINE)
    return {key: (default.strip(), meaning.strip()) for key, default, meaning in found}


def shown_default(key: str, table: dict[str, Any]) -> str:
    """What the page's column of defaults must say."""
    entry = table["properties"][key]
    if key in table.get("required", []):
        return "required"
    if "default" not in entry or entry["default"] == []:
        return "–"
    return f"`{json.dumps(entry['default'])}`"


@pytest.mark.parametrize("heading", SECTIONS)
def test_every_key_is_on_the_page_with_its_default(heading: str) -> None:
    schema = json_schema()
    table = schema["$defs"][SECTIONS[heading]] if SECTIONS[heading] else schema
    keys = [key for key in table["properties"] if "const" not in table["properties"][key]]
    listed = {key: row for key, row in shared(heading).items() if key in keys} | rows(heading)
    assert sorted(listed) == sorted(keys)
    for key, (default, meaning) in listed.items():
        assert default == shown_default(key, table), key
        assert meaning == table["properties"][key]["description"], key


@pytest.mark.parametrize(("kind", "common"), SHARED.items())
def test_no_type_repeats_what_all_have(kind: str, common: str) -> None:
    tables = [rows(heading) for heading in SECTIONS if heading.startswith(kind)]
    said = [(key, row) for table in tables for key, row in table.items()]
    assert [key for key, row in rows(common).items() if (key, row) in said] == []


def test_every_table_of_the_schema_is_on_the_page() -> None:
    assert set(SECTIONS.values()) - {""} == set(json_schema()["$defs"])


def test_the_shipped_schema_is_what_the_code_prints() -> None:
    shipped = (DOCS / "job.schema.json").read_text(encoding="utf-8")
    assert shipped == json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n"


def test_examples_of_the_page_fit_the_schema() -> None:
    examples = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL)
    assert len(examples) >= 3
    schema = json_schema()
    kind = jsonschema.validators.validator_for(schema)
    kind.check_schema(schema)
    for example in examples:
        as_json = json.loads(json.dumps(tomllib.loads(example), default=lambda time: time.isoformat()))
        kind(schema).validate(as_json)
