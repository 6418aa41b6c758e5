"""How splats are drawn: by the job, or else by their files."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirelight.base.errors import InputError
from mirelight.io import job, splats
from mirelight.model import Job

DATA = Path(__file__).resolve().parents[3] / "data" / "splats"
GLB, PLY = DATA / "small.glb", DATA / "small_from_splat.ply"
CAMERA = """
[[cameras]]
name = "front"
position = [0, 0, 3]
target = [0, 0, 0]
"""


def loaded(folder: Path, text: str) -> Job:
    (folder / "a.toml").write_text(text + CAMERA)
    return job.load(folder / "a.toml")


def test_a_file_says_how_its_splats_are_drawn_and_a_job_knows_better(tmp_path: Path) -> None:
    plain = loaded(tmp_path, f'splats = "{PLY}"').compositor
    assert (plain.sort, plain.cutoff, plain.color_space) == ("depth", None, "srgb_rec709_display")
    gltf = loaded(tmp_path, f'splats = "{GLB}"').compositor
    assert (gltf.sort, gltf.cutoff, gltf.color_space) == ("radial", 3.0, "srgb_rec709_display")
    assert loaded(tmp_path, f'splats = "{GLB}"\ncompositor.sort = "depth"').compositor.sort == "depth"
    both = loaded(tmp_path, f'splats = [{{ path = "{GLB}" }}, {{ path = "{PLY}" }}]').compositor
    assert (both.sort, both.cutoff) == ("depth", None)


def test_a_job_says_that_splats_hold_light(tmp_path: Path) -> None:
    named = loaded(tmp_path, f'splats = {{ path = "{PLY}", color_space = "lin_rec709_display" }}')
    plain = loaded(tmp_path, f'splats = "{PLY}"')
    assert named.compositor.holds_light and not plain.compositor.holds_light
    assert named.splats is not None and plain.splats is not None and named.splats.digest != plain.splats.digest
    assert named.splats.value.color_space == "lin_rec709_display"
    assert splats.read(PLY).color_space == "srgb_rec709_display"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            f'splats = [{{ path = "{PLY}" }}, {{ path = "{PLY}", color_space = "lin_rec709_display" }}]',
            r"splats\[1\].color_space: splats in lin_rec709_display beside others in srgb_rec709_display",
        ),
        (
            f'profile = "playcanvas"\nsplats = {{ path = "{PLY}", color_space = "lin_rec709_display" }}',
            "which the real-time engine does not know",
        ),
        (f'splats = {{ path = "{PLY}", color_space = "logarithm" }}', "color_space"),
    ],
)
def test_what_cannot_be_drawn(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        loaded(tmp_path, text)
