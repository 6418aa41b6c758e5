"""`mirelight verify`: each kind of damage is found and named, nothing else is, and the next render mends it."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mirelight.batch.checks import Finding, Kind
from mirelight.batch.verify import Verified, verify
from mirelight.io import image, splats
from mirelight.io.gltf.write import write_glb
from mirelight.model import ProxyMesh, SplatCloud
from mirelight.store.arrays import read_arrays, write_arrays
from mirelight.store.journal import Journal, Row

from .conftest import COMMAND, Run

JOB = """\
splats = "splats.ply"
proxy = "proxy.glb"
resolution = [32, 24]

[[cameras]]
name = "front"
position = [0, 0.2, 1.8]
target = [0, 0, 0]

[[lightings]]
name = "all"
lights = [
    { type = "point", name = "left", position = [-2, 3, 3], intensity = 30 },
    { type = "point", name = "right", position = [3, 2, 3], intensity = 20, color = [1, 0.5, 0.2] },
]

[sweep]
one_at_a_time = true

[render]
spp = 4

[output]
layers = true
aovs = true
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a job whose frames are there: one camera, two lights together and each alone."""
    folder = tmp_path_factory.mktemp("made")
    rng = np.random.default_rng(1)
    means = rng.normal(size=(3000, 3))
    cloud = SplatCloud(
        means=(means / np.linalg.norm(means, axis=1, keepdims=True)).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (3000, 1)),
        scales=np.full((3000, 3), 0.04, dtype=np.float32),
        opacities=np.full(3000, 0.9, dtype=np.float32),
        sh=np.zeros((3000, 1, 3), dtype=np.float32),
    )
    splats.write(cloud, folder / "splats.ply")
    ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    write_glb(folder / "proxy.glb", ProxyMesh(vertices=ball.vertices, faces=ball.faces), [])
    (folder / "job.toml").write_text(JOB, encoding="utf-8")
    subprocess.run([*COMMAND, "render", "job.toml", "-q"], cwd=folder, check=True)
    return folder


@pytest.fixture
def out(made: Path, tmp_path: Path) -> Iterator[Path]:
    """Its frames, to be damaged; the job stays where it is."""
    shutil.copytree(made / "out", tmp_path / "out")
    yield tmp_path / "out"


def look(out: Path, rebuild: bool = False) -> tuple[list[tuple[Kind, str]], Verified, list[Finding]]:
    heard: list[Finding] = []
    found = verify(out, heard.append, rebuild=rebuild)
    return [(x.kind, x.what) for x in heard], found, heard


def names(out: Path) -> list[str]:
    return sorted(path.name for path in out.glob("[!.]*.exr"))


def test_a_sound_folder_is_sound(out: Path, run: Run) -> None:
    heard, found, _ = look(out)
    assert heard == [] and found.frames == 3 and not found.notes and not found.unrecorded
    told = run("verify", "out")
    assert (told.returncode, told.stdout) == (0, "out: 3 frames looked at; all is well\n"), told.stderr
    assert run("verify", "nowhere").returncode == run("verify", ".").returncode == 2


def test_damage_is_found_forgotten_and_made_again(made: Path, out: Path, run: Run) -> None:
    exrs = names(out)
    good = {name: (out / name).read_bytes() for name in exrs}
    middle = len(good[exrs[0]]) // 2
    (out / exrs[0]).write_bytes(good[exrs[0]][:middle] + bytes(64) + good[exrs[0]][middle + 64 :])
    (out / exrs[1]).write_bytes(good[exrs[1]][:middle])
    png = Path(exrs[2]).with_suffix(".png").name
    (out / png).unlink()
    light = next((out / ".mirelight" / "light").iterdir())
    light.write_bytes(light.read_bytes()[:-9])
    bad = [("damaged", exrs[0]), ("damaged", exrs[1])]
    heard, found, lines = look(out)
    kept = ("layers", f".mirelight/light/{light.name}")
    assert sorted(heard) == sorted([*bad, ("missing", Path(exrs[2]).stem), kept])
    assert all("\n" not in str(x) and "mirelight render" in x.remedy for x in lines)
    assert found.findings == 4 and found.forgotten == 0 and names(out) == exrs  # nothing touched
    told = run("verify", "out", "--json")
    entry = json.loads(told.stdout)
    assert told.returncode == 1 and entry["frames"] == found.frames and entry["forgotten"] == 0
    assert [(x["kind"], x["what"], x["remedy"]) for x in entry["findings"]] == [
        (x.kind, x.what, x.remedy) for x in lines
    ]

    told = run("verify", "out", "--rebuild")
    assert told.returncode == 1 and "3 files forgotten, for mirelight render to make again" in told.stdout
    assert not light.exists() and not (out / exrs[0]).exists()
    shutil.copytree(out, made / "mended")
    done = run("render", str(made / "job.toml"), "--out", str(made / "mended"), "-q")
    assert done.returncode == 0 and {name: (made / "mended" / name).read_bytes() for name in exrs} == good
    assert look(made / "mended")[0] == []


def test_what_may_not_be_read_is_not_called_damaged(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is known of such files, so none is forgotten."""
    light = next((out / ".mirelight" / "light").iterdir())
    closed = {out / names(out)[0], light}
    monkeypatch.setattr("os.access", lambda path, mode: path not in closed)
    heard, found, lines = look(out, rebuild=True)
    assert heard == [("closed", names(out)[0]), ("closed", f".mirelight/light/{light.name}")]
    assert str(lines[0]).endswith("there is no permission to read it; allow reading it, and verify again")
    assert found.forgotten == 0 and all(path.exists() for path in closed)


def test_a_lost_journal_is_written_again(out: Path, run: Run) -> None:
    aside = out / ".mirelight"
    shutil.rmtree(aside / "journal")
    heard, found, _ = look(out)
    assert heard == [] and found.unrecorded == 3 and found.recorded == 0
    assert look(out, rebuild=True)[1].recorded == 3
    rows = list(Journal(aside / "journal").rows())
    assert {row.frame for row in rows} == {Path(x).stem for x in names(out)}
    assert look(out)[1].unrecorded == 0
    shutil.rmtree(aside)  # nothing at all is known of what was to be made
    heard, found, _ = look(out, rebuild=True)
    assert heard == [] and found.recorded == found.frames == 3
    assert found.notes == ("no record of what was to be made: what is missing cannot be told",)
    again = {row.frame: row.files for row in Journal(aside / "journal").rows()}
    assert again == {row.frame: row.files for row in rows}


def test_failed_and_other_frames_are_told_apart(out: Path) -> None:
    one, other, third = names(out)
    frame = Path(one).stem
    keys = {suffix: image.read_fingerprint(out / f"{frame}{suffix}") or "" for suffix in (".exr", ".png")}
    for suffix in keys:
        (out / f"{frame}{suffix}").unlink()
    journal = Journal(out / ".mirelight" / "journal")
    journal.add(Row(frame, {}, 0.0, "Traceback …\nValueError: no such view", keys))
    journal.close()
    shutil.copy(out / third, out / other)  # a frame under another's name
    (out / "old.day.exr").write_bytes((out / third).read_bytes())
    heard, found, lines = look(out)
    assert heard == [("failed", frame), ("other", other)]
    assert "ValueError: no such view" in str(lines[0]) and "mirelight render" in str(lines[0])
    assert found.notes == ("1 frames are of no run that was started here; remove them where not wanted",)


def rewritten(out: Path, name: str, change: str) -> None:
    """A frame file changed as by a broken renderer, with a journal that knows of no such thing."""
    frame = image.read(out / name)
    assert frame.lighting is not None and frame.splats is not None
    rgba = frame.rgba.copy()
    if change == "nan":
        rgba[3, 4, 1] = np.nan
    elif change == "alpha":
        rgba[3, 4, 3] = 1.5
    elif change == "white":
        rgba[..., :3] = 50.0
    elif change == "empty":
        rgba[:] = 0
    light = frame.lighting
    if change == "dark":
        light = replace(light, layers=tuple(replace(x, direct=x.direct * np.float32(0.5)) for x in light.layers))
    shutil.rmtree(out / ".mirelight" / "journal")
    image.write(replace(frame, rgba=rgba, lighting=light), out / name)


@pytest.mark.parametrize(
    ("change", "kind", "text"),
    [
        ("nan", "values", "1 values of G are not finite"),
        ("alpha", "values", "A reaches from"),
        ("white", "picture", "of the splats' pixels are white"),
        ("empty", "picture", "the camera sees nothing"),
        ("dark", "sum", "off the sum of all-"),
    ],
)
def test_what_files_show_is_looked_at(out: Path, change: str, kind: Kind, text: str) -> None:
    rewritten(out, "front.all.exr", change)
    _, _, lines = look(out)
    assert [x.kind for x in lines] == [kind] and text in str(lines[0]), lines
    assert lines[0].what.startswith("front.all") and lines[0].remedy


def test_a_record_that_leads_elsewhere_is_none(out: Path) -> None:
    """A folder from somebody else must not have files beside it removed."""
    (out.parent / "mine.exr").write_bytes(b"not a frame")
    (plan,) = (out / ".mirelight" / "plans").iterdir()
    plan.write_text(plan.read_text().replace('"front.all"', '"../mine"'))
    assert look(out, rebuild=True)[1].notes == ("no record of what was to be made: what is missing cannot be told",)
    assert (out.parent / "mine.exr").exists()


def test_kept_light_adds_up_where_files_hold_pictures_alone(made: Path, tmp_path: Path, run: Run) -> None:
    """Lightings that are traced as they are, each with noise of its own."""
    less = [x for key in ("output.layers=false", "output.aovs=false", "render.noise=0.5") for x in ("--set", key)]
    done = run("render", str(made / "job.toml"), "--out", "out", *less)
    assert done.returncode == 0, done.stderr
    out = tmp_path / "out"
    heard, found, _ = look(out)
    assert heard == [] and found.notes == ()
    for path in (out / ".mirelight" / "light").glob("*.light"):
        file = read_arrays(path)
        if file.about.get("layers") == ["left", "right"]:
            brighter = {name: x * np.float32(2) if "direct" in name else x for name, x in file.arrays.items()}
            write_arrays(path, brighter, file.about)
    heard, _, lines = look(out)
    assert heard == [("sum", "front.all")] and "off the sum of all-" in str(lines[0])


def test_a_picture_of_another_size_is_found(out: Path) -> None:
    path = out / "front.all.png"
    data = bytearray(path.read_bytes())
    shutil.rmtree(out / ".mirelight" / "journal")
    data[16:20] = struct.pack(">I", 16)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    path.write_bytes(data)
    _, _, lines = look(out)
    assert [(x.kind, x.what) for x in lines] == [("values", "front.all.png")]
    assert "32 x 24" in lines[0].text
