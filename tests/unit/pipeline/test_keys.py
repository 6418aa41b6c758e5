"""Every setting's line in docs/reference/made-again.md, held against the keys themselves."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
import pytest

from mirelight import relighting
from mirelight.dataset import export
from mirelight.model import (
    Backdrop,
    Camera,
    CompositorSettings,
    DatasetSettings,
    Deferred,
    DisplaySettings,
    DisplayView,
    EngineSettings,
    Environment,
    EstimatedSky,
    Exposure,
    Job,
    LayerFactor,
    Lighting,
    OutputSettings,
    OwnSplats,
    PointLight,
    ProxyMesh,
    ProxyRecipe,
    RelightSettings,
    RenderSettings,
    SkyModel,
    SplatCloud,
)
from mirelight.model.dressing import Dress, Mask
from mirelight.model.planes import AOVS, MATTES
from mirelight.pipeline import keys, provenance
from mirelight.pipeline.plan import plan
from mirelight.pipeline.scene import prepare
from mirelight.store import layer_records

PAGE = Path(__file__).resolve().parents[3] / "docs" / "reference" / "made-again.md"
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
    "compositor.cutoff": 3.0,
    "relight.texture_scale": 0.5,
    "display.background": (1.0, 0.0, 0.0),
    "display.view": DisplayView(config="ocio://default", display="screen", view="ACES", identity="1"),
    "display.backdrop": Backdrop(blur=3.0),
    "output.directory": Path("elsewhere"),
    "dataset.layouts": ("nerf",),
    "dataset.license": "cc-by-4.0",
    "output.aovs": False,
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
    if where == "lens":
        lens = Exposure(aperture_radius=0.1, focus_distance=2.0)
        return replace(job, cameras=tuple(replace(x, exposure=lens) for x in job.cameras))
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
    "the picture of `relight.mask`, or its camera": replace(
        JOB, masks=(Mask(camera=VIEW, painted=Deferred.of(np.ones((10, 20), np.float32))),)
    ),
    "the captured lighting's colours and intensities": replace(
        JOB, captured=replace(CAPTURED, lights=(replace(CAPTURED.lights[0], intensity=9.0),))
    ),
}


@pytest.mark.parametrize("what", CONTENT)
def test_content_makes_again_what_the_page_says(what: str) -> None:
    assert changed(JOB, CONTENT[what]) == rows()[what][0]


def test_the_page_has_a_line_for_nothing_else() -> None:
    assert set(rows()) == {*NAMES, *CONTENT}


# --- every artefact --------------------------------------------------------------------------------------------------

ROOM = replace(
    JOB,
    made_proxy=ProxyRecipe(mesh=mesh(), splats=cloud()),
    albedo_from_splats=True,
    lightings=(DAY,),
    output=OutputSettings(aovs=(*AOVS, *MATTES)),
)
SKY_MODEL = SkyModel(to_sun=np.array([0.0, 1, 0]))
Artefact = Callable[[keys.Keys], str]


def estimated(made: keys.Keys) -> EstimatedSky:
    """As a job has it that asks for an estimate."""
    assert made.job.splats is not None and made.job.proxy is not None
    return EstimatedSky(splats=made.job.splats.digest, proxy=made.job.proxy.digest, seed=made.job.render.seed)


def _frame(made: keys.Keys, suffix: str = "", lit: bool = True) -> str:
    lighting = made.job.lightings[0] if lit else None
    frame = made.frame(made.job.cameras[0], lighting)
    return made.file(frame, made.job.cameras[0], lighting, suffix) if suffix else frame


def _light(made: keys.Keys) -> str:
    seen = relighting.lighting_camera(made.job.cameras[0], made.job.relight)
    return " ".join(made.light(s, seen) for s in made.mixture(made.job.lightings[0]).sets)


def _surface_light(made: keys.Keys) -> str:
    parts = (part for one in made.mixture(made.job.lightings[0]).sets for part in one.parts())
    return " ".join(made.surface_light(part) for part in parts)


def _splat_light(made: keys.Keys) -> str:
    return " ".join(
        made.splat_light(s, made.job.render.spp) for s in made.splat_sets.mixture(made.job.lightings[0]).sets
    )


def _exported(made: keys.Keys) -> str:
    index = layer_records.describe(plan(made.job))
    return export.picture_key(index, index.views[0], 0, np.eye(4))


ARTEFACTS: dict[str, Artefact] = {
    "made proxy": lambda made: made.made_proxy,
    "colours": lambda made: made.proxy,
    "captured level": lambda made: made.captured_level,
    "estimate": lambda made: made.estimate(estimated(made)),
    "map": lambda made: made.map_of(sky()),
    "sky": lambda made: made.sky_of(SKY_MODEL, "sky"),
    "sky of an estimate": lambda made: made.sky_of(estimated(made), "sky"),
    "views": lambda made: made.views,
    "places": lambda made: made.splat_places,
    "splat light": _splat_light,
    "cells": lambda made: made.surface_cells,
    "surface transport": lambda made: made.surface_transport,
    "surface light": _surface_light,
    "light": _light,
    "composite": lambda made: made.composite(made.job.cameras[0]),
    "frame": _frame,
    "EXR": lambda made: _frame(made, ".exr"),
    "PNG": lambda made: _frame(made, ".png"),
    "unlit frame": lambda made: _frame(made, lit=False),
    "unlit EXR": lambda made: _frame(made, ".exr", lit=False),  # it holds the mattes
    "unlit PNG": lambda made: _frame(made, ".png", lit=False),
    "exported picture": _exported,
}
# Public names of Keys: those that are keys of an artefact, and those that only help to find one.
KEYED = {"made_proxy", "proxy", "captured_level", "estimate", "map_of", "sky_of", "splat_places", "views"}
KEYED |= {"splat_light", "surface_cells", "surface_transport", "surface_light", "light", "composite", "frame", "file"}
KEYED |= {
    "splat_distances",
    "splat_sky",
    "light_with_objects",
    "light_of_lobes",
    "in_front",
    "object_matte",
    "object_boxes",
    "mirrored",
}
HELPING = {"job", "splat_sets", "sets", "lights", "needs", "mixture", "files"}

FILES = {"frame", "EXR", "PNG", "exported picture"}
ON_SPLATS = {"places", "splat light"}
ON_SURFACE = {"cells", "surface transport", "surface light"}
ON_PROXY = {"captured level", "light", *ON_SPLATS, *ON_SURFACE, *FILES}  # on one with the splats' colours
UNLIT = {"composite", "unlit frame", "unlit EXR", "unlit PNG"}
SEEDED = {"estimate", "sky of an estimate"}
TRACED = {"light", *FILES}
DECIDES: dict[str, set[str]] = {
    "render.profile": {"colours", *ON_PROXY},
    "render.spp": {"splat light", *TRACED},
    "render.noise": {"surface light", *TRACED},
    "render.max_depth": {"colours", *ON_PROXY},
    "render.indirect": TRACED,
    "render.seed": {"colours", *SEEDED, *ON_PROXY},
    "render.variant": set(ARTEFACTS) - {"map"},
    "render.denoise": TRACED,
    "render.threads": set(),
    "render.max_memory": set(),
    "render.lens_samples": set(),  # of pinholes
    "render.ao_distance": TRACED,
    "compositor.profile": UNLIT | FILES,
    "compositor.sort": UNLIT | FILES,
    "compositor.work_buffer": set(),
    "compositor.min_pixel_size": set(),
    "compositor.alpha_clip": UNLIT | FILES,
    "compositor.cutoff": UNLIT | FILES,
    "compositor.color_space": UNLIT | FILES,
    "compositor.tone": set(),
    "compositor.exposure": set(),
    "compositor.linear": set(),
    "compositor.eight_bit": set(),
    "compositor.supersampling": UNLIT | FILES,
    "compositor.max_memory": set(),
    "relight.mode": {"colours", *ON_PROXY},
    "relight.profile": FILES,
    "relight.space": set(),
    "relight.blend": FILES,
    "relight.brightness": set(),
    "relight.background": FILES,
    "relight.texture_scale": TRACED,
    "relight.delta": FILES,
    "relight.max_ratio": FILES,
    "relight.per": FILES,
    "relight.repair": FILES,
    "relight.gloss": FILES,
    "relight.sh": UNLIT | FILES,
    "display.exposure": {"PNG", "unlit PNG", "exported picture"},
    "display.tone": {"PNG", "unlit PNG", "exported picture"},
    "display.view": {"PNG", "unlit PNG", "exported picture"},
    "display.background": {"PNG", "unlit PNG", "exported picture"},
    "display.transparent": {"PNG", "unlit PNG", "exported picture"},
    "display.backdrop": {"EXR", "unlit EXR", "PNG", "unlit PNG", "exported picture"},
    "output.directory": set(),
    "output.store": set(),
    "output.exr": UNLIT | TRACED,
    "output.png": set(),
    "output.layers": {"frame", "EXR", "PNG", "unlit EXR"},
    "output.aovs": UNLIT | TRACED,
    "output.half": {"EXR", "unlit EXR"},
    "output.color_space": {"EXR", "unlit EXR"},
    "output.compression": {"EXR", "unlit EXR"},
    "dataset.layouts": set(),
    "dataset.normalize": set(),
    "dataset.split": set(),
    "dataset.held_out": set(),
    "dataset.seed": set(),
    "dataset.license": set(),
    "dataset.hdr": set(),
    "engine.clustered": set(),
    "engine.physical_units": set(),
    "engine.hdr_format": set(),
}


def keys_of(job: Job) -> dict[str, str]:
    made = keys.Keys(job)
    return {name: key(made) for name, key in ARTEFACTS.items()}


def different(before: Job, after: Job) -> set[str]:
    old, new = keys_of(before), keys_of(after)
    return {name for name in ARTEFACTS if old[name] != new[name]}


@pytest.mark.parametrize("name", NAMES)
def test_a_setting_is_in_the_keys_of_what_it_decides(name: str) -> None:
    """What changes the bytes changes the key, and nothing else does."""
    assert name in DECIDES, f"{name}: say in DECIDES of which artefacts it changes the bytes"
    assert different(ROOM, with_other(ROOM, name)) == DECIDES[name]


def test_a_sky_to_be_followed_is_in_the_frames_keys() -> None:
    """That it is followed, and which splats lie off the proxy; what it is they hold already, as light."""
    follows = replace(ROOM, relight=replace(ROOM.relight, background="environment"))
    assert different(ROOM, follows) == FILES | UNLIT
    for job in (ROOM, follows):
        assert ("composite" in different(job, replace(job, proxy=mesh(0.4)))) == (job is follows)
    lit, captured = (replace(x, environment=sky(2.0)) for x in (ROOM.lightings[0], CAPTURED))
    for other in (replace(follows, lightings=(lit,)), replace(follows, captured=captured)):
        assert different(follows, other) >= FILES


def test_what_stands_behind_unlit_frames_is_in_their_files_keys() -> None:
    """They show the captured light's surroundings; without a backdrop nothing of it."""
    behind = replace(ROOM, display=DisplaySettings(backdrop=Backdrop()))
    unlit = {"unlit EXR", "unlit PNG"}
    for job, expected in ((ROOM, set()), (behind, unlit)):
        other = replace(job, captured=replace(CAPTURED, environment=sky(2.0)))
        assert different(job, other) & UNLIT == expected
    picture = replace(behind, display=DisplaySettings(backdrop=Backdrop(picture="a.png", identity="1")))
    moved, other = (
        replace(picture, display=DisplaySettings(backdrop=x))
        for x in (Backdrop(picture="b.png", identity="1"), Backdrop(picture="a.png", identity="2"))
    )
    assert different(picture, moved) <= {"exported picture"} and different(picture, other) >= {"EXR", "PNG", *unlit}


def test_every_artefact_has_its_place_in_the_table() -> None:
    """Who adds one says here what decides it."""
    public = {name for name in dir(keys.Keys) if not name.startswith("_")} | {"job"}
    assert public == KEYED | HELPING
    assert set(DECIDES) == set(NAMES)


def test_every_part_of_a_job_has_its_place() -> None:
    """Who adds one says what it decides: settings in DECIDES, content in IN_ROOM."""
    content = {
        "splats",
        "proxy",
        "made_proxy",
        "capture_cameras",
        "capture_pictures",
        "albedo_from_splats",
        "cameras",
        "lightings",
    }
    content |= {"pooled", "captured", "objects", "materials", "masks", "own_splats"}
    in_no_key = {"source", "splat_files", "inputs", "notes"}
    assert {field.name for field in fields(Job)} == content | in_no_key | set(SETTINGS)


def test_a_material_s_finish_is_in_the_keys_of_frames_that_show_it_alone() -> None:
    finish = (Dress(roughness=0.5),)
    assert different(ROOM, replace(ROOM, materials=finish)) == set()
    shiny = replace(ROOM, relight=replace(ROOM.relight, gloss=True))
    assert different(shiny, replace(shiny, materials=finish)) == FILES
    made = [keys.Keys(replace(shiny, materials=x)) for x in ((), finish)]
    one, other = (x.light_of_lobes(x.mixture(DAY).sets[0], VIEW) for x in made)
    assert one != other and one != made[0].light(made[0].mixture(DAY).sets[0], VIEW)


SURE = {"mitsuba", "drjit", "llvm", "numpy", "scipy"}


@pytest.mark.parametrize("package", ["mirelight", *sorted(SURE)])
def test_a_version_is_in_the_keys_of_what_it_decides(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    known = dict(provenance.versions())
    assert known.keys() >= SURE
    old = keys_of(ROOM)
    monkeypatch.setattr(provenance, "versions", lambda: {**known, package: "99"})
    changed = {name for name, key in keys_of(ROOM).items() if old[name] != key}
    composited = UNLIT if package in ("drjit", "llvm", "mirelight") else {"unlit EXR"}  # which holds mattes
    pictures = {"PNG", "unlit PNG"} if package == "numpy" else set()
    small = {"map"} if package in ("numpy", "mirelight") else set()
    assert changed == set(ARTEFACTS) - {"map"} - UNLIT | composited | pictures | small


IN_ROOM: dict[str, tuple[Job, set[str]]] = {
    "another proxy": (
        replace(ROOM, proxy=mesh(0.4)),
        {"colours", "unlit EXR", *SEEDED, *ON_PROXY},
    ),
    "other splats": (
        replace(ROOM, splats=cloud(1.0)),
        {"colours", "views", *SEEDED, *ON_PROXY, *UNLIT} - {"made proxy"},
    ),
    "other axes of the capture's file": (
        replace(ROOM, own_splats=OwnSplats(cloud(), 2 * np.eye(4))),
        {"views"},
    ),
    "other cameras of the capture": (
        replace(ROOM, capture_cameras=(VIEW,)),
        {"colours", "views", *SEEDED, *ON_PROXY},
    ),
    "other pictures of the capture": (
        replace(ROOM, capture_pictures=(Deferred.of(np.zeros((1, 1, 4), np.float32)),)),
        {"colours", "views", *SEEDED, *ON_PROXY} - {"made proxy"},
    ),
    "another capture's light": (
        replace(ROOM, captured=replace(CAPTURED, lights=(replace(CAPTURED.lights[0], intensity=9.0),))),
        {"colours", *ON_PROXY},
    ),
    "another camera": (
        replace(ROOM, cameras=(VIEW.resized(21, 10),)),
        {"light", *FILES, *UNLIT},
    ),
    "a lighting's own way of relighting": (
        replace(ROOM, lightings=(replace(DAY, relight=replace(ROOM.relight, max_ratio=3.0)),)),
        FILES,
    ),
}


@pytest.mark.parametrize("what", IN_ROOM)
def test_content_is_in_the_keys_of_what_it_decides(what: str) -> None:
    job, expected = IN_ROOM[what]
    assert different(ROOM, job) == expected


def test_where_a_lighting_has_its_own_way_the_job_s_counts_for_nothing() -> None:
    own = replace(ROOM, lightings=(replace(DAY, relight=RelightSettings(mode="ratio", delta=0.5)),))
    assert different(own, replace(own, relight=replace(own.relight, delta=0.25))) == set()


def test_a_scene_takes_over_a_level_of_its_own_kind_alone() -> None:
    """As after an edit of the job's profile."""
    known = prepare(JOB)
    vars(known)["captured_level"] = 0.5  # as if it had been found
    same = replace(JOB, relight=replace(JOB.relight, delta=0.5))
    assert vars(prepare(same, like=known)).get("captured_level") == 0.5
    assert "captured_level" not in vars(prepare(replace(JOB, render=RenderSettings(profile="playcanvas")), like=known))


def test_a_scene_takes_over_what_the_capture_s_cameras_see() -> None:
    """As `mirelight estimate` does for its picture: whatever the light; not of other cameras."""
    known = prepare(JOB)
    vars(known)["views"] = ()  # as if they had been looked at
    lit = replace(JOB, captured=replace(CAPTURED, lights=()), albedo_from_splats=not JOB.albedo_from_splats)
    assert "views" in vars(prepare(lit, like=known))
    assert "views" not in vars(prepare(replace(JOB, capture_cameras=(VIEW,)), like=known))


# --- what is in no key -----------------------------------------------------------------------------------------------


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
