"""Whatever stands in a job file, it is read or refused in words."""

from __future__ import annotations

import datetime
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mirelight.base.errors import InputError, ManyInputsError
from mirelight.io import job
from mirelight.io.job.overrides import Override
from mirelight.io.job.positions import Path

from .conftest import WriteJob

FULL = """\
profile = "physical"
splats = [{ path = "splats.ply", lod = 0, transform = { rotation_euler = [0, 0, 180], scale = 2 } }, "splats.ply"]
proxy = { path = "proxy.glb", albedo = 0.2, transform = { matrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]] } }
resolution = [64, 48]
cameras_from = [{ path = "proxy", names = ["left"] }]
captured = "day"
[[lightings]]
name = "day"
environment = { radiance = [1, 1, 1], rotation = 3 }
lights_from = ["proxy"]
[[lightings.lights]]
type = "spot"
position = [0, 1, 0]
target = [0, 0, 0]
inner_cone_angle = 10
[[lightings.lights]]
type = "area"
position = [0, 1, 0]
direction = [0, -1, 0]
size = 2
[[cameras]]
name = "a"
position = [0, 0, 1]
target = [0, 0, 0]
yfov = 45
[[cameras]]
type = "orthographic"
matrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]
ymag = 1
[[cameras]]
type = "turntable"
[render]
spp = 4
[relight]
mode = "tint"
[display]
background = [0, 0, 0]
[output]
directory = "out"
"""

SCALARS = st.one_of(
    st.integers(),
    st.floats(),
    st.booleans(),
    st.text(max_size=8),
    st.sampled_from(["proxy", "day", "spot", "turntable", "splats.ply", "\0", "a" * 5000, "type=spot", "."]),
    st.just(datetime.date(2024, 1, 1)),
)
KEYS = st.one_of(
    st.text(max_size=6), st.sampled_from(["type", "path", "name", "lights", "spot", "lighting", "matrix", "type=spot"])
)
VALUES = st.recursive(SCALARS, lambda x: st.lists(x, max_size=4) | st.dictionaries(KEYS, x, max_size=3), max_leaves=8)


def places(node: Any, path: Path = ()) -> list[tuple[Path, bool]]:
    """The path of everything in the data, and whether a table is there."""
    children = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [(path, isinstance(node, dict)), *(p for key, value in children for p in places(value, (*path, key)))]


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_value_anywhere_is_read_or_refused(write_job: WriteJob, data: st.DataObject) -> None:
    path = write_job(FULL)
    source, _ = job.parse(path)
    changes = []
    for _ in range(data.draw(st.integers(1, 3))):
        where, is_table = data.draw(st.sampled_from(places(source.data)))
        if not where or (is_table and data.draw(st.booleans())):
            where = (*where, data.draw(KEYS))
        changes.append(Override("--set x", where, data.draw(VALUES)))
    try:
        job.parse(path, changes)
    except ManyInputsError as e:
        said = [str(error) for error in e.errors]
        assert len(set(said)) == len(said) > 1
        assert all("\n" not in line and len(line) < 600 for line in said)
    except InputError as e:
        assert "\n" not in str(e) and len(str(e)) < 600
