"""Every mistake of a job file is reported at once, where it stands, with what to do."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from mirelight.base.errors import InputError, ManyInputsError
from mirelight.io import job
from mirelight.io.job.tables import json_schema

from .conftest import Complaints, WriteJob

SCENE = 'splats = "splats.ply"\nproxy = "proxy.glb"\n'


def test_three_mistakes_give_three_positions(complaints: Complaints) -> None:
    found = complaints(
        SCENE
        + """\
colour = "red"

[[lights]]
type = "point"
position = [0, 1]
range = 0
"""
    )
    assert found == [
        "job.toml:3:1: colour: unknown key; remove it",
        "job.toml:7:12: lights[0].position: 2 values; give 3 values",
        "job.toml:8:9: lights[0].range: 0; give a number above 0",
    ]


def test_values_that_are_gone_say_what_stands_in_their_place(complaints: Complaints) -> None:
    found = complaints(SCENE + '[render]\nindirect = "near"\nvariant = "scalar_rgb"\n')
    assert found == [
        'job.toml:4:12: render.indirect: \'near\'; this way is no longer there; use "surface", or "traced", which has '
        "no bias",
        "job.toml:5:11: render.variant: 'scalar_rgb'; this variant is no longer there; use \"llvm_ad_rgb\"",
    ]


def test_one_mistake_is_an_input_error_with_its_parts(write_job: WriteJob) -> None:
    path = write_job(SCENE + "[render]\nspp = 0\n")
    with pytest.raises(InputError) as caught:
        job.load(path)
    error = caught.value
    assert (error.file, error.field, error.found) == (f"{path}:4:7", "render.spp", "0")
    assert error.remedy == "give a number of at least 1"


@pytest.mark.parametrize(
    ("splats", "albedo", "rest", "expected"),
    [
        (True, "splats", "", "'splats' needs the captured lighting; add captured, the lighting that the splats were"),
        (False, "splats", "", "'splats', but the job has none; name splats, or give a number"),
        (True, "splat", "", '\'splat\'; give a number, [r, g, b], "file" or "splats"'),
    ],
)
def test_an_albedo_that_cannot_be_had(
    complaints: Complaints, splats: bool, albedo: str, rest: str, expected: str
) -> None:
    first = 'splats = "splats.ply"\n' if splats else 'lights_from = "proxy"\n'
    found = complaints(f'{first}proxy = {{ path = "proxy.glb", albedo = "{albedo}" }}\n{rest}')
    assert len(found) == 1
    assert found[0].startswith(f"job.toml:2:40: proxy.albedo: {expected}")


CASES = {
    name: (lines, expected)
    for name, lines, expected in re.findall(
        r"^=== (.+)\n((?:.*\n)*?)>>> (.+)$",
        (Path(__file__).parent / "mistakes.txt").read_text(encoding="utf-8"),
        flags=re.MULTILINE,
    )
}


def test_the_cases_were_found() -> None:
    assert len(CASES) == 63


@pytest.mark.parametrize("name", CASES)
def test_each_mistake_says_where_what_and_the_remedy(complaints: Complaints, name: str) -> None:
    lines, expected = CASES[name]
    found = complaints(SCENE + lines)
    assert len(found) == 1
    assert found[0].startswith(f"job.toml:{expected}")


def test_a_job_without_anything_to_see(complaints: Complaints) -> None:
    assert complaints("") == ['job.toml: neither splats nor a proxy; name what to render: splats = "capture.ply"']


def test_light_needs_a_proxy(complaints: Complaints) -> None:
    (found,) = complaints('splats = "splats.ply"\nenvironment = { radiance = 1 }\n')
    assert found.startswith("job.toml:2:1: environment: light, but no proxy for it to fall on; ")


def test_splats_cannot_be_sheared(complaints: Complaints) -> None:
    (found,) = complaints(
        'splats = { path = "splats.ply", transform = { matrix = [[1,0,0,0],[0,2,0,0],[0,0,1,0],[0,0,0,1]] } }'
    )
    assert found.startswith("job.toml:1:45: splats.transform: a matrix with shear, mirror or unequal scale; ")


def test_proxy_in_lights_from_needs_a_gltf_proxy(complaints: Complaints) -> None:
    (found,) = complaints('proxy = "splats.ply"\nlights_from = ["proxy"]\n')
    said = "the proxy is not a glTF file or a stage; name a .glb, .gltf or .usd file"
    assert found == f"job.toml:2:15: lights_from: {said}"


def test_checks_between_keys_speak_beside_unknown_keys(complaints: Complaints) -> None:
    found = complaints(SCENE + "[[cameras]]\nposition = [1,2,3]\ntarget = [1,2,3]\nlens = 50\n")
    assert [line.split(": ")[1] for line in found] == ["cameras[0].target", "cameras[0].lens"]


def test_a_mistake_in_every_section_at_once(complaints: Complaints) -> None:
    found = complaints(
        """\
splats = ["nowhere.ply", { path = "splats.ply", lod = -1 }]
proxy = { path = "proxy.glb", albedo = 2 }
resolution_scale = 0.0
[captured]
lights = [{ type = "sun", direction = [0, -1, 0], angular_diameter = 0 }]
[[lightings]]
[[cameras]]
type = "turntable"
frames = 0
[compositor]
alpha_clip = 1.5
[display]
background = [0, 0]
[output]
half = "yes"
"""
    )
    assert [re.match(r"job\.toml:(\d+:\d+): ([^:]+):", line).groups() for line in found] == [  # type: ignore[union-attr]
        ("1:11", "splats[0]"),
        ("1:55", "splats[1].lod"),
        ("2:40", "proxy.albedo"),
        ("3:20", "resolution_scale"),
        ("5:70", "captured.lights[0].angular_diameter"),
        ("6:1", "lightings[0].name"),
        ("9:10", "cameras[0].frames"),
        ("11:14", "compositor.alpha_clip"),
        ("13:14", "display.background.color"),
        ("15:8", "output.half"),
    ]


# --- what is no TOML, or no text -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("a = \n", "1:5"),
        ("a = 1\nb = [1, 2\n", "3:1"),
        ("a = 1\na = 2\n", "2:6"),
        ('a = "x', "1:7"),
        ("a = {b = 1}\n[a]\nc = 2\n", "2:3"),
        ("a = 01\n", "1:6"),
    ],
)
def test_syntax_errors_keep_line_and_column(complaints: Complaints, text: str, where: str) -> None:
    (found,) = complaints(text)
    assert found.startswith(f"job.toml:{where}: not TOML: ")


def test_hostile_and_foreign_files(tmp_path: Path) -> None:
    cases = {
        "deep.toml": b"a = " + b"[" * 100_000,
        "deep_table.toml": b"a = " + b"{b=" * 100_000,
        "latin.toml": "a = 1\nb = 'é'\n".encode("latin-1"),
        "binary.toml": bytes(range(256)),
        "date.toml": b"a = 2024-13-45\n",
        "big.toml": b"#" + b"a" * 17 * 2**20,
    }
    for name, content in cases.items():
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(InputError, match=re.escape(str(path))):
            job.load(path)
    with pytest.raises(InputError, match="a folder"):
        job.load(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        job.load(tmp_path / "none.toml")


@pytest.mark.parametrize(("table", "value"), [("mix", "1"), ("moved", "[1, 2, 3]")])
def test_tables_of_too_many_names(complaints: Complaints, table: str, value: str) -> None:
    names = "".join(f"n{i} = {value}\n" for i in range(10_001))
    assert complaints(SCENE + f"[{table}]\n{names}") == [f"job.toml:3:1: {table}: 10001 names; give at most 10000"]


def test_keys_of_many_parts_are_refused_before_they_are_read(complaints: Complaints) -> None:
    """The parser's time and memory grow with the square of a key's parts, in one key or in many."""
    for text in ("a" + ".a" * 40_000 + " = 1\n", "".join(f"k{i}{'.a' * 500} = 1\n" for i in range(2_000))):
        (found,) = complaints(text)
        assert "nested too deeply" in found


def test_nothing_reads_toml_past_the_guard() -> None:
    root = Path(job.__file__).parents[2]
    readers = {x.name for x in root.rglob("*.py") if "tomllib.load" in x.read_text(encoding="utf-8")}
    assert readers == {"limits.py", "positions.py"}  # the other one reads single keys of what was read already


def test_windows_line_ends_and_byte_order_mark_move_nothing(scene: Path, tmp_path: Path) -> None:
    path = tmp_path / "job.toml"
    path.write_bytes(b"\xef\xbb\xbf[render]\r\nspp = 0\r\n[display]\r\nexposure = 'a'\r\n")
    with pytest.raises(ManyInputsError) as caught:
        job.load(path)
    assert [e.file.removeprefix(f"{path}") for e in caught.value.errors] == ["", ":2:7", ":4:12"]


def test_long_values_are_cut(complaints: Complaints) -> None:
    (found,) = complaints(SCENE + f'profile = "{"x" * 5000}"\n')
    assert len(found) < 200


def test_every_key_can_be_of_a_wrong_type(complaints: Complaints) -> None:
    """A date, which no key takes, is refused at every key of the schema, and nothing else is said about that key."""
    schema = json_schema()
    for key in schema["properties"]:
        found = complaints(f"{key} = 1979-05-27\n" + ("" if key in ("splats", "proxy") else SCENE))
        assert [line for line in found if f": {key}" in line], key
    for section in ("render", "compositor", "relight", "display", "output"):
        table = schema["$defs"][schema["properties"][section]["$ref"].rsplit("/", 1)[-1]]
        for key in table["properties"]:
            found = complaints(SCENE + f"[{section}]\n{key} = 1979-05-27\n")
            assert len(found) == 1 and found[0].startswith(f"job.toml:4:{len(key) + 4}: {section}.{key}: a date; "), (
                found
            )


def test_the_schema_is_json(complaints: Complaints) -> None:
    assert json.loads(json.dumps(json_schema())) == json_schema()
