"""Files of Blender's exporter: recognised by what wrote them, and brought back to what Blender shows."""

from __future__ import annotations

import math
from typing import Any

import pytest

from mirelight.apps.inspect.inspect import inspect
from mirelight.cli.report import lines
from mirelight.io.gltf import blender
from mirelight.io.gltf.scene import read_lights_of

GENERATOR = "Khronos glTF Blender I/O v4.2.60"


@pytest.mark.parametrize("generator", [GENERATOR, "Khronos glTF Blender I/O v1.8.19", "Blender I/O fork"])
def test_it_is_known_by_the_generator(glb: Any, generator: str) -> None:
    glb.top["asset"]["generator"] = generator
    glb.light(type="point", intensity=54.35)
    assert read_lights_of(glb.save()).blender == generator


@pytest.mark.parametrize("generator", [None, "mirelight 0.1", "glTF-Transform v4", 7, ["Blender I/O"]])
def test_other_files_are_not_taken_for_it(glb: Any, generator: object) -> None:
    if generator is not None:
        glb.top["asset"]["generator"] = generator
    glb.light(type="point")
    path = glb.save()
    assert read_lights_of(path).blender is None
    assert not any("Blender" in line for line in lines(inspect(path)))


def test_a_lamp_of_watts_and_a_sun_come_back(glb: Any) -> None:
    """1000 W of a lamp and a sun of strength 3, as the Standard mode writes them."""
    glb.top["asset"]["generator"] = GENERATOR
    glb.light(type="point", intensity=54351.41306588226)
    glb.light(type="spot", intensity=54351.41306588226, spot={})
    glb.light(type="directional", intensity=2049.0)
    lamp, spot, sun = (blender.as_in_blender(x) for x in read_lights_of(glb.save()).lights)
    assert lamp.intensity == spot.intensity == pytest.approx(1000 / (4 * math.pi), rel=1e-6)
    assert sun.intensity == pytest.approx(3.0)


def test_inspect_says_so_in_a_line(glb: Any, new_glb: Any) -> None:
    glb.top["asset"]["generator"] = GENERATOR + "\x1b[31m" + "x" * 500
    glb.light(type="point", intensity=1.0)
    (note,) = [line for line in lines(inspect(glb.save("lamps.glb"))) if line.strip().startswith("note")]
    assert "lamps.glb: lights written by 'Khronos glTF Blender I/O v4.2.60" in note
    assert "683 times" in note and 'unit = "blender"' in note
    assert "\x1b" not in note and len(note) < 300
    dark = new_glb()  # no lights: nothing to say
    dark.top["asset"]["generator"] = GENERATOR
    dark.node(mesh=dark.mesh(dark.primitive()))
    assert not any("note" in line for line in lines(inspect(dark.save("dark.glb"))))
