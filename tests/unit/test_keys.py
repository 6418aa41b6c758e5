"""Every setting's line in docs/rendering.md, held against the keys themselves."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
import pytest

from mirelight import keys, provenance, relighting
from mirelight.model import (
    Camera,
    CompositorSettings,
    DatasetSettings,
    Deferred,
    DisplaySettings,
    EngineSettings,
    Environment,
    Job,
    LayerFactor,
    Lighting,
    OutputSettings,
    PointLight,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    SplatCloud,
)

PAGE = Path(__file__).resolve().parents[2] / "docs" / "rendering.md"
SETTINGS: Mapping[str, type[Any]] = {
    "render": RenderSettings,
    "compositor": CompositorSettings,
    "relight": RelightSettings,
    "display": DisplaySettings,
    "output": OutputSettings,
    "dataset": DatasetSettings,
    "engine": EngineSettings,
}
OTHER: dict[str, Any] = {  # another value, where the type alone does not tell a fitting one
    "render.noise": 0.1,
    "render.threads": 3,
    "render.max_memory": 1 << 30,
    "render.ao_distance": 2.0,
    "compositor.max_memory": 1 << 30,
    "relight.texture_scale": 0.5,
    "display.background": (1.0, 0.0, 0.0),
    "output.directory": Path("elsewhere"),
    "dataset.layouts": ("nerf",),
    "dataset.license": "cc-by-4.0",
    "output.compression": "none",  # dwaa leaves some AOVs out
}


def cloud(x: float = 0.0) -> Deferred[SplatCloud]:
    one = np.ones((1, 3), np.float32)
    return Deferred.of(
        SplatCloud(means=one * x, quats=np.eye(4, dtype=np.float32)[:1], scales=one, opacities=one[:, 0], sh=one[None])
    )


def mesh(albedo: float = 0.5) -> Deferred[ProxyMesh]:
    corners = np.eye(3, dtype=np.float32)
    return Deferred.of(ProxyMesh(vertices=corners, faces=np.array([[0, 1, 2]]), albedo=np.full(3, albedo)))


def sky(level: float = 1.0) -> Environment:
    return Environment(radiance=np.full((2, 4, 3), level, np.float32))


LAMP = PointLight(name="lamp", position=np.array([0.0, 1, 0]), intensity=5.0)
DAY = Lighting(name="day", lights=(LAMP,), environment=sky())
CAPTURED = Lighting(name="captured", lights=(replace(LAMP, position=np.array([0.0, 3, 0])),), environment=sky())
VIEW = Camera.look_at((0, 0, 3), (0, 0, 0), 20, 10, name="front")
JOB = Job(
    source=Path("job.toml"),
    splats=cloud(),
    proxy=mesh(),
    cameras=(VIEW,),
    lightings=(DAY,),
    captured=CAPTURED,
    relight=RelightSettings(mode="ratio"),
)


def products(job: Job) -> dict[str, str]:
    """The keys of the first frame and its files."""
    made, camera, lighting = keys.Keys(job), job.cameras[0], job.lightings[0]
    frame = made.frame(camera, lighting)
    seen = relighting.lighting_camera(camera, job.relight)
    light = [made.light(s, seen) for s in made.mixture(lighting).sets]
    files = {name: made.file(frame, camera, lighting, suffix) for name, suffix in (("EXR", ".exr"), ("PNG", ".png"))}
    return {"light": " ".join(light), "frame": frame} | {
        k: v for k, v in files.items() if f".{k.lower()}" in made.files
    }


def changed(before: Job, after: Job) -> list[str]:
    old, new = products(before), products(after)
    return [name for name in new if new[name] != old[name]]


def rows() -> dict[str, tuple[list[str], str]]:
    """The page's table: what changes -> what is made again, and where it counts."""
    found = {}
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if line.startswith("|") and len(cells) == 3 and cells[0] != "what changes" and "---" not in cells[0]:
            found[cells[0].strip("`")] = ([] if cells[1] == "nothing" else cells[1].split(", "), cells[2])
    return found


def in_place(job: Job, where: str) -> Job:
    """The job as it must be for the setting to count."""
    if where == "tint":
        return replace(job, relight=replace(job.relight, mode="tint"))
    if where == "playcanvas":
        return replace(job, compositor=replace(job.compositor, profile="playcanvas"))
    return job


def with_other(job: Job, name: str) -> Job:
    """The job with another value of one setting, any that its type allows."""
    section, field = name.split(".")
    settings = getattr(job, section)
    old = getattr(settings, field)
    hint = get_type_hints(SETTINGS[section])[field]
    if name in OTHER:
        new = OTHER[name]
    elif isinstance(old, bool):
        new = not old
    elif isinstance(old, int | float):
        new = old / 2 if field in ("blend",) else old + 1
    else:
        choices = get_args(hint) if get_origin(hint) is not None else get_args(get_args(hint)[0])
        new = next(x for x in choices if x != old)
    return replace(job, **{section: replace(settings, **{field: new})})


NAMES = [f"{section}.{field.name}" for section, kind in SETTINGS.items() for field in fields(kind)]


@pytest.mark.parametrize("name", NAMES)
def test_every_setting_makes_again_what_the_page_says(name: str) -> None:
    expected, where = rows()[name]
    job = in_place(JOB, where)
    assert changed(job, with_other(job, name)) == expected
    if where:
        assert changed(JOB, with_other(JOB, name)) == []  # where it does not count it changes nothing


def with_lights(*lights: PointLight, around: Environment | None = None, name: str = "day") -> Job:
    return replace(JOB, lightings=(Lighting(name=name, lights=lights, environment=around or sky()),))


CONTENT: dict[str, Job] = {
    "the content of a splat file, its transform": replace(JOB, splats=cloud(1.0)),
    "the content of the proxy's file (or of the splats, where it is made from them), its transform or albedo": replace(
        JOB, proxy=mesh(0.4)
    ),
    "a camera's place, lens or size": replace(JOB, cameras=(VIEW.resized(21, 10),)),
    "a camera's name": replace(JOB, cameras=(replace(VIEW, name="side"),)),
    "a light's place, direction, size, range or cone": with_lights(replace(LAMP, range=9.0)),
    "a light's colour or intensity": with_lights(replace(LAMP, color=np.array([1.0, 0.5, 0.0]), intensity=2.0)),
    "a factor in `mix`, by name": replace(
        JOB, lightings=(replace(DAY, mix=(LayerFactor(layer="lamp", factor=np.array([1, 0.5, 0])),)),)
    ),
    "a light's name or a lighting's": with_lights(replace(LAMP, name="other")),
    "an environment's picture or rotation": with_lights(LAMP, around=replace(sky(), rotation=10.0)),
    "an environment's intensity": with_lights(LAMP, around=replace(sky(), intensity=0.5)),
    "the captured lighting's colours and intensities": replace(
        JOB, captured=replace(CAPTURED, lights=(replace(CAPTURED.lights[0], intensity=9.0),))
    ),
}


@pytest.mark.parametrize("what", CONTENT)
def test_content_makes_again_what_the_page_says(what: str) -> None:
    assert changed(JOB, CONTENT[what]) == rows()[what][0]


def test_the_page_has_a_line_for_nothing_else() -> None:
    assert set(rows()) == {*NAMES, *CONTENT}


def test_a_frame_does_not_depend_on_lightings_behind_its_own() -> None:
    more = (DAY, Lighting(name="night", lights=(replace(LAMP, range=3.0),)))
    assert changed(JOB, replace(JOB, lightings=more)) == []


def test_another_order_of_numbers_is_no_change() -> None:
    same = replace(JOB, relight=replace(JOB.relight, delta=np.float64(JOB.relight.delta), blend=np.float32(1)))  # type: ignore[arg-type]
    assert changed(JOB, same) == []


@pytest.mark.parametrize(
    ("package", "expected"),
    [
        ("mitsuba", ["light", "frame", "EXR", "PNG"]),
        ("llvm", ["light", "frame", "EXR", "PNG"]),
        ("OpenEXR", ["EXR"]),
        ("pyoidn", []),
    ],
)
def test_versions_count_where_they_decide(monkeypatch: pytest.MonkeyPatch, package: str, expected: list[str]) -> None:
    old, known = products(JOB), dict(provenance.versions())
    monkeypatch.setattr(provenance, "versions", lambda: {**known, package: "99"})
    new = products(JOB)
    assert [name for name in new if new[name] != old[name]] == expected
    if package == "pyoidn":
        denoised = replace(JOB, render=replace(JOB.render, denoise=True))
        other = products(denoised)
        monkeypatch.setattr(provenance, "versions", lambda: known)
        assert products(denoised)["frame"] != other["frame"]


def test_no_key_holds_a_place_of_this_machine() -> None:
    """Names of files and folders are no part of any key: a job may be moved."""
    moved = replace(JOB, source=Path("/elsewhere/other.toml"), inputs={"a": "b"})
    assert changed(JOB, moved) == []
    assert all(re.fullmatch(r"[0-9a-f ]+", key) for key in products(JOB).values())
