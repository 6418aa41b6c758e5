"""`[sweep]`: which lightings come out, under which names, and how many traces they share."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from mirelight.base import colour
from mirelight.base.errors import InputError
from mirelight.io import job
from mirelight.model import Job, PointLight, SkyModel, SunLight
from mirelight.pipeline import keys, requirements

from .conftest import Complaints, WriteJob

HEAD = 'splats = "splats.ply"\nproxy = "proxy.glb"\n'
LAMP = '[[lights]]\nname = "key"\ntype = "point"\nposition = [0, 2, 0]\n'


def lamps(work: Job) -> list[PointLight]:
    found = [lighting.lights[0] for lighting in work.lightings]
    assert all(isinstance(x, PointLight) for x in found)
    return found  # type: ignore[return-value]


def test_a_grid_crosses_its_axes_and_says_the_values_in_the_names(write_job: WriteJob) -> None:
    work = job.load(
        write_job(
            HEAD
            + LAMP
            + '[environment]\nradiance = 1.0\n[[sweep.axes]]\nfield = "lights[0].intensity"\nvalues = [1, 2.5]\n'
            + '[[sweep.axes]]\nfield = "environment.rotation"\nrange = [-90, 90]\nsteps = 3\n'
        )
    )
    assert [x.name for x in work.lightings] == [
        f"lighting-intensity{a}-rotation{b}" for a in ("1", "2p5") for b in ("m90", "0", "90")
    ]
    assert [x.intensity for x in lamps(work)] == [1, 1, 1, 2.5, 2.5, 2.5]
    assert [x.environment.rotation for x in work.lightings if x.environment] == [-90, 0, 90] * 2
    assert work.pooled


def test_paired_axes_go_side_by_side(write_job: WriteJob) -> None:
    text = (
        HEAD
        + LAMP
        + '[sweep]\nhow = "paired"\n[[sweep.axes]]\nfield = "lights.key.intensity"\n'
        + "range = [1, 100]\nlog = true\nsteps = 3\n"
        + '[[sweep.axes]]\nfield = "lights.key.color"\nkelvin = [2000, 10000]\nsteps = 3\n'
    )
    work = job.load(write_job(text))
    assert np.allclose([x.intensity for x in lamps(work)], [1, 10, 100])
    colors = np.array([x.color for x in lamps(work)])
    assert np.allclose(colour.luminance(colors), 1, atol=1e-6)
    assert np.all(np.diff(colors[:, 2] / colors[:, 0]) > 0)  # bluer and bluer


def test_draws_are_seeded_spread_evenly_and_keep_their_first(write_job: WriteJob) -> None:
    def positions(count: int, seed: int, kind: str = "dome") -> np.ndarray:
        axis = f"{kind} = {{ center = [1, 2, 3], radius = 4 }}\ndraws = {count}\n"
        text = f'{HEAD}{LAMP}[sweep]\nseed = {seed}\n[[sweep.axes]]\nfield = "lights.key.position"\n{axis}'
        return np.array([x.position for x in lamps(job.load(write_job(text)))])

    some, more, other = positions(20, 1), positions(400, 1), positions(20, 2)
    assert np.array_equal(some, more[:20])
    assert not np.allclose(some, other)
    assert np.allclose(np.linalg.norm(more - [1, 2, 3], axis=1), 4)
    heights = (more[:, 1] - 2) / 4
    assert heights.min() >= 0 and abs(heights.mean() - 0.5) < 4 * 0.29 / 20  # uniform in height: equal areas
    whole = (positions(400, 1, "sphere")[:, 1] - 2) / 4
    assert whole.min() < -0.9 and abs(whole.mean()) < 4 * 0.58 / 20


def test_a_direction_points_to_the_centre(write_job: WriteJob) -> None:
    sun = '[[lights]]\ntype = "sun"\ndirection = [0, -1, 0]\n'
    text = f'{HEAD}{sun}[[sweep.axes]]\nfield = "lights.sun.direction"\ndome = {{}}\nsteps = 30\n'
    found = [x.lights[0] for x in job.load(write_job(text)).lightings]
    directions = np.array([x.direction for x in found if isinstance(x, SunLight)])
    assert len(directions) == 30 and directions[:, 1].max() < 0  # all from above
    assert np.allclose(directions.mean(axis=0), [0, -0.5, 0], atol=0.05)


def test_the_sun_of_a_day_follows_the_clock(write_job: WriteJob) -> None:
    sky = "[environment]\nsky = { latitude = 48.2, longitude = 16.4, time = 2026-06-21T12:00:00+02:00 }\n"
    day = "range = [2026-06-21T06:00:00+02:00, 2026-06-21T20:00:00+02:00]\nsteps = 15\n"
    work = job.load(write_job(f'{HEAD}{sky}[[sweep.axes]]\nfield = "environment.sky.time"\n{day}'))
    heights = [x.sky.to_sun[1] for x in work.lightings if isinstance(x.sky, SkyModel)]
    assert len(heights) == 15 and 6 <= int(np.argmax(heights)) <= 8  # noon by the sun is at 13:00 there
    assert work.lightings[0].name == "lighting-time20260621T060000"


def test_files_of_a_folder(write_job: WriteJob, tmp_path: Path) -> None:
    from PIL import Image

    (tmp_path / "hdris").mkdir()
    for name in ("b.dusk.png", "a.png"):
        Image.new("RGB", (4, 2), (9, 9, 9)).save(tmp_path / "hdris" / name)
    text = f'{HEAD}environment = {{ path = "hdris/a.png", rotation = 30 }}\n'
    text += '[[sweep.axes]]\nfield = "environment.path"\nfiles = "hdris/*.png"\n'
    work = job.load(write_job(text))
    assert [x.name for x in work.lightings] == ["lighting-a", "lighting-b_dusk"]
    assert all(x.environment is not None and x.environment.rotation == 30 for x in work.lightings)
    assert {"hdris/a.png", "hdris/b.dusk.png"} <= set(work.inputs)


def many(count: int) -> str:
    return "".join(f'[[lights]]\nname = "lamp.{i}"\ntype = "point"\nposition = [{i}, 2, 0]\n' for i in range(count))


@pytest.mark.parametrize(("count", "traces"), [(3, 1), (12, 1), (30, 4)])  # 30: three packs, and all on as a whole
def test_lights_one_by_one_are_traced_together(write_job: WriteJob, count: int, traces: int) -> None:
    work = job.load(write_job(f"{HEAD}{many(count)}[sweep]\none_at_a_time = true\n"))
    names = [x.name for x in work.lightings]
    assert names == ["lighting", *(f"lighting-lamp_{i}" for i in range(count))]
    assert not any(re.search(r"\.", name) for name in names)
    made = keys.Keys(work)
    sets = {one.digest: one for lighting in work.lightings for one in made.mixture(lighting).sets}
    assert len(sets) == traces
    assert len({u.digest for one in sets.values() for u in one.units}) == count


def test_two_hundred_places_of_a_lamp_share_seventeen_traces_and_only_the_last_set_grows(write_job: WriteJob) -> None:
    def sets(draws: int) -> list[str]:
        axis = f'field = "lights.key.position"\nsphere = {{}}\ndraws = {draws}\n'
        work = job.load(write_job(f"{HEAD}{LAMP}[[sweep.axes]]\n{axis}"))
        made = keys.Keys(work)
        return list(dict.fromkeys(s.digest for x in work.lightings for s in made.mixture(x).sets))

    few, many = sets(200), sets(205)
    assert len(few) == 17 and len(many) == 18
    assert few[:16] == many[:16]


def test_strengths_and_colours_trace_one_set(write_job: WriteJob) -> None:
    axes = '[[sweep.axes]]\nfield = "lights.key.intensity"\nrange = [1, 9]\ndraws = 40\n'
    axes += '[[sweep.axes]]\nfield = "lights.key.color"\nkelvin = [2000, 9000]\ndraws = 5\n'
    work = job.load(write_job(HEAD + LAMP + axes))
    made = keys.Keys(work)
    assert len(work.lightings) == 200
    assert len({s.digest for x in work.lightings for s in made.mixture(x).sets}) == 1


def test_captured_may_name_a_lighting_that_is_swept(write_job: WriteJob) -> None:
    text = f'{HEAD}captured = "day"\n[[lightings]]\nname = "day"\nenvironment = {{ radiance = 1.0 }}\n'
    text += '[sweep]\nlightings = ["day"]\n[[sweep.axes]]\nfield = "environment.intensity"\nvalues = [1, 3]\n'
    work = job.load(write_job(text))
    assert work.captured is not None and work.captured.name == "day"
    assert [x.name for x in work.lightings] == ["day-intensity1", "day-intensity3"]


MISTAKES = {
    'field = "lights.fill.intensity"\nvalues = [1]': "no light 'fill' in lighting 'lighting'",
    'field = "lights[3].intensity"\nvalues = [1]': "leads nowhere",
    'field = "environment.rotation"\nvalues = [1]': "leads nowhere",
    'field = "lights..x"\nvalues = [1]': "is not a key",
    'field = "lights.key.intensity"\nvalues = [-1]': "greater than or equal to 0",
    'field = "lights.key.brightness"\nvalues = [1]': "brightness",
    'field = "lights.key.position"\nfiles = "none/*.exr"': "no file fits 'none/*.exr'",
    'field = "lights.key.intensity"\nvalues = [1]\nrange = [1, 2]': "both values and range are given",
    'field = "lights.key.intensity"\nrange = [1, 2]': "no count",
    'field = "lights.key.intensity"\nrange = [0, 2]\nlog = true\nsteps = 2': "not above 0",
    'field = "lights.key.intensity"\nrange = [0, [1]]\nsteps = 2': "not of one kind",
    'field = "lights.key.intensity"\nrange = [0, 1]\nsteps = 2\ndraws = 2': "both steps and draws",
    'field = "lights.key.intensity"': "nothing is given for it",
}


@pytest.mark.parametrize("axis", MISTAKES)
def test_mistakes_are_one_line_with_their_place(write_job: WriteJob, axis: str) -> None:
    path = write_job(f"{HEAD}{LAMP}[[sweep.axes]]\n{axis}\n")
    with pytest.raises(InputError) as raised:
        job.load(path)
    said = str(raised.value)
    assert MISTAKES[axis] in said and "\n" not in said
    assert said.startswith(f"{path}:"), said


def test_too_much_is_refused_before_it_is_made(complaints: Complaints, write_job: WriteJob) -> None:
    axis = '[[sweep.axes]]\nfield = "lights.key.intensity"\nrange = [1, 2]\nsteps = 1000\n'
    with pytest.raises(InputError, match="1,000,000 lightings"):
        job.load(write_job(HEAD + LAMP + axis * 2))
    with pytest.raises(InputError, match="paired axes of 1000, 2 values"):
        text = HEAD + LAMP + '[sweep]\nhow = "paired"\n' + axis + axis.replace("1000", "2")
        job.load(write_job(text))
    assert "nothing to sweep" in complaints(HEAD + LAMP + "[sweep]\nseed = 3\n")[0]


def test_black_bodies_have_their_known_chromaticities() -> None:
    """Planckian locus, CIE 1931: 2856 K (illuminant A) at (0.4476, 0.4074), 6500 K at (0.3135, 0.3237)."""
    xyz = np.linalg.inv(
        [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
    )
    for kelvin, expected in ((2856, (0.4476, 0.4074)), (6500, (0.3135, 0.3237)), (10000, (0.2807, 0.2884))):
        color = xyz @ colour.blackbody(kelvin)
        assert np.allclose(color[:2] / color.sum(), expected, atol=0.004)


def test_paired_draws_share_a_word_and_crossed_ones_do_not(write_job: WriteJob) -> None:
    lamps = "".join(f'[[lights]]\nname = "{x}"\ntype = "point"\nposition = [0, 2, 0]\n' for x in "ab")
    axes = "".join(
        f'[[sweep.axes]]\nfield = "lights.{x}.intensity"\nrange = [1, 9]\ndraws = 2\n' for x in "ab"
    )  # intensity0000 and so on
    paired = job.load(write_job(f'{HEAD}{lamps}[sweep]\nhow = "paired"\n{axes}'))
    assert [x.name for x in paired.lightings] == ["lighting-intensity0000", "lighting-intensity0001"]
    crossed = job.load(write_job(f"{HEAD}{lamps}{axes}"))
    assert crossed.lightings[1].name == "lighting-intensity0000-intensity0001"


@pytest.mark.parametrize(
    ("more", "layers", "aovs"),
    [
        ("", False, False),
        ("aovs = ['depth']", False, ("depth",)),
        ("layers = true", True, False),
        ("store = 'frames'", True, True),
    ],
)
def test_frames_of_a_sweep_hold_the_picture_alone(
    write_job: WriteJob, more: str, layers: bool, aovs: bool | tuple[str, ...]
) -> None:
    axis = '[[sweep.axes]]\nfield = "lights.key.intensity"\nvalues = [1, 2]\n'
    output = job.load(write_job(f"{HEAD}{LAMP}{axis}[output]\n{more}\n")).output
    assert (output.layers, output.aovs) == (layers, aovs)
    plain = job.load(write_job(f"{HEAD}{LAMP}[output]\n")).output
    assert plain.layers is True and plain.aovs is True


CAPTURED = "captured = { environment = { radiance = 1.0 } }\n"


def test_relight_settings_are_swept_and_trace_nothing_more(write_job: WriteJob) -> None:
    axes = '[[sweep.axes]]\nfield = "relight.blend"\nvalues = [0.25, 1]\n'
    axes += '[[sweep.axes]]\nfield = "relight.max_ratio"\nrange = [4, 16]\nlog = true\nsteps = 3\n'
    work = job.load(write_job(f"{HEAD}{CAPTURED}{LAMP}[relight]\ndelta = 0.01\n{axes}"))
    assert [x.name for x in work.lightings] == [
        f"lighting-blend{a}-max_ratio{b}" for a in ("0p25", "1") for b in (4, 8, 16)
    ]
    found = [work.relight_of(x) for x in work.lightings]
    assert [(x.blend, round(x.max_ratio, 9)) for x in found] == [(a, b) for a in (0.25, 1) for b in (4, 8, 16)]
    assert all(x.mode == "ratio" and x.delta == 0.01 for x in found)
    made, camera = keys.Keys(work), work.cameras[0]
    assert len({s.digest for x in work.lightings for s in made.mixture(x).sets}) == 1
    assert len({made.frame(camera, x) for x in work.lightings}) == 6
    alone = job.load(write_job(f"{HEAD}{CAPTURED}{LAMP}[relight]\ndelta = 0.01\nblend = 0.25\nmax_ratio = 8\n"))
    whole = job.load(
        write_job(f"{HEAD}{CAPTURED}{LAMP}[relight]\ndelta = 0.01\n{axes}[output]\naovs = true\nlayers = true\n")
    )
    assert keys.Keys(alone).frame(camera, alone.lightings[0]) == keys.Keys(whole).frame(camera, whole.lightings[1])


def test_modes_are_swept_beside_lights_of_the_proxys_file(write_job: WriteJob) -> None:
    """The job's lights are those of the proxy's file, which no axis names."""
    axis = '[[sweep.axes]]\nfield = "relight.mode"\nvalues = ["tint", "ratio"]\n'
    work = job.load(write_job(f"{HEAD}{CAPTURED}[sweep]\none_at_a_time = true\n{axis}"))
    assert [x.name for x in work.lightings] == [
        f"lighting-mode-{mode}{light}" for mode in ("tint", "ratio") for light in ("", "-lamp", "-moon")
    ]
    assert [work.relight_of(x).mode for x in work.lightings] == ["tint"] * 3 + ["ratio"] * 3
    assert [requirements.compares_in(work, x) for x in work.lightings] == [False] * 3 + [
        True
    ] * 3 and requirements.compares(work)
    assert len(work.lightings[0].lights) == 2 and len(work.lightings[4].lights) == 1


RELIGHT_MISTAKES = {
    'field = "relight.texture_scale"\nvalues = [0.5]': "texture_scale, which decides what is traced",
    'field = "relight.blend"\nvalues = [2]': "less than or equal to 1",
    'field = "relight.blent"\nvalues = [0.5]': "blent",
    'field = "relight.mode"\nvalues = ["mix"]': "'tint', 'ratio' or 'albedo'",
}


@pytest.mark.parametrize("axis", RELIGHT_MISTAKES)
def test_mistakes_of_relight_settings(write_job: WriteJob, axis: str) -> None:
    path = write_job(f"{HEAD}{CAPTURED}{LAMP}[[sweep.axes]]\n{axis}\n")
    with pytest.raises(InputError) as raised:
        job.load(path)
    assert RELIGHT_MISTAKES[axis] in str(raised.value) and "\n" not in str(raised.value)


def test_modes_of_one_sweep_share_the_proxys_albedo(write_job: WriteJob) -> None:
    text = f'splats = "splats.ply"\nproxy = {{ path = "proxy.glb", albedo = "splats" }}\n{CAPTURED}{LAMP}'
    with pytest.raises(InputError, match="modes that share a proxy"):
        job.load(write_job(f'{text}[[sweep.axes]]\nfield = "relight.mode"\nvalues = ["tint", "ratio"]\n'))
