"""The public calls, as README shows them: the very files that `mirelight render` writes, on both shipped scenes."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import mirelight
from mirelight.model import Camera, Frame, Job
from mirelight.pipeline.scene import Scene, prepare
from mirelight.pipeline.stages import Lit
from mirelight.store import Store
from mirelight.store.folder import ASIDE
from tests import forked

from .shelf import SHIPPED

ROOT = Path(__file__).resolve().parents[2]
SMALL = ["render.spp=2", "resolution_scale=0.125"]


def example() -> str:
    """README's Python lines that begin with the job and end with the file."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    (found,) = (block for block in blocks if "mirelight.prepare(" in block)
    return str(found)


@pytest.mark.parametrize("name", ["courtyard", "stage"])
def test_readme_makes_the_files_of_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    job_file = ROOT / "scenes" / name / "job.toml"
    load, loaded = mirelight.load, []

    def small(path: str) -> Job:
        loaded.append(path)
        return load(job_file, [*SMALL, f"output.directory={json.dumps(str(tmp_path / 'own'))}"])

    def kept(job: Job) -> Scene:
        """The command is given the courtyard's colours, and finds those of the stage by itself."""
        store = Store(job)
        store.open()
        return prepare(job, SHIPPED if name == "stage" else store.artefacts)

    monkeypatch.setattr(mirelight, "load", small, raising=False)
    monkeypatch.setattr(mirelight, "prepare", kept, raising=False)
    monkeypatch.chdir(tmp_path)
    scope: dict[str, Any] = {}
    exec(compile(example(), "README.md", "exec"), scope)
    assert loaded == ["room.toml"]
    camera, lighting = scope["camera"].name, scope["lighting"].name
    chosen = ("--camera", camera, "--lighting", lighting, *(x for one in SMALL for x in ("--set", one)))
    if name == "courtyard":
        shutil.copytree(tmp_path / "own" / ASIDE / "scene", tmp_path / "out" / ASIDE / "scene")
    command = ("render", str(job_file), "-o", str(tmp_path / "out"), *chosen)
    done = forked.run(command, tmp_path, tmp_path, timeout=300)
    assert done.returncode == 0, done.stderr
    for suffix in ("exr", "png"):
        ours = (tmp_path / f"frame.{suffix}").read_bytes()
        assert ours == (tmp_path / "out" / f"{camera}.{lighting}.{suffix}").read_bytes()


def test_the_calls_are_shown() -> None:
    assert {"load", "prepare", "composite", "light", "relight", "write"} <= set(dir(mirelight))
    assert all(callable(getattr(mirelight, name)) for name in ("load", "prepare", "composite", "light", "relight"))


@pytest.fixture(scope="module")
def scene() -> Any:
    return mirelight.prepare(mirelight.load(ROOT / "scenes" / "stage" / "job.toml", SMALL), SHIPPED)


def test_wrong_arguments_get_one_clear_line(scene: Any) -> None:
    job = scene.job
    camera, lighting = job.cameras[0], job.lightings[0]
    calls: dict[str, Callable[[], object]] = {
        "prepare": lambda: mirelight.prepare("room.toml"),  # type: ignore[arg-type]
        "composite": lambda: mirelight.composite(job, camera),
        "light": lambda: mirelight.light(scene, lighting, camera),
        "relight": lambda: mirelight.relight(scene, None, lighting),
        "write": lambda: mirelight.write(scene, "frame.exr"),
    }
    for name, call in calls.items():
        with pytest.raises(TypeError, match=rf"^{name}\(\)") as caught:
            call()
        assert "\n" not in str(caught.value)


def test_everything_says_what_it_is_in_a_line_or_two(scene: Any) -> None:
    job = scene.job
    camera, lighting = job.cameras[0], job.lightings[0]
    splats, lit = mirelight.composite(scene, camera), mirelight.light(scene, camera, lighting)
    frame = mirelight.relight(scene, splats, lit)
    assert isinstance(lit, Lit) and isinstance(frame, Frame) and isinstance(camera, Camera)
    assert frame._repr_png_()[:8] == b"\x89PNG\r\n\x1a\n"
    for value in (job, scene, splats, lit, lit.new, lit.new.layers[0], frame, job.splats, mirelight.load):
        text = repr(value)
        assert len(text) < 400 and text.count("\n") < 2, text
