"""`mirelight render` as a real process: what is written, skipped, resumed, interrupted and refused."""

from __future__ import annotations

import json
import os
import pty
import resource
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from mirelight.io.exr import read_exr
from mirelight.io.gltf.write import write_glb
from mirelight.io.image import read_fingerprint
from mirelight.model import PointLight, ProxyMesh

from .conftest import COMMAND, JOB, Run, environment

FRAMES = [f"{camera}.{lighting}" for camera in ("front", "orbit.0001", "orbit.0002") for lighting in ("day", "night")]
MANY = ["--set", "cameras[1].frames=400", "--camera", "orbit", "--lighting", "night"]  # enough to be interrupted


def files(folder: Path) -> list[str]:
    """Everything in a folder, temporary files too; not what the store keeps beside the frames."""
    return sorted(path.name for path in folder.iterdir() if path.name != ".mirelight")


def temporary_files(out: Path) -> list[Path]:
    return [path for path in out.rglob(".*") if path.is_file()]


def wait_for_frames(process: subprocess.Popen[str], out: Path, count: int) -> None:
    """Until that many EXR files stand in the folder."""
    while len(list(out.glob("[!.]*.exr"))) < count:
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)


def test_all_frames_then_none_then_what_changed(run: Run, folder: Path) -> None:
    done = run("render", "job.toml")
    assert done.returncode == 0, done.stderr
    out = folder / "out"
    assert files(out) == sorted(f"{name}{suffix}" for name in FRAMES for suffix in (".exr", ".png"))
    assert done.stdout.startswith("6 frames in out; ")
    assert [line.split(":")[0] for line in done.stderr.splitlines() if line[0] == "["] == [
        f"[{i}/6] {name}" for i, name in enumerate(FRAMES, start=1)
    ]
    picture = read_exr(out / "front.day.exr").channels
    assert picture["R"].shape == (48, 64) and float(picture["A"].max()) > 0.5

    before = {name: (out / name).stat().st_mtime_ns for name in files(out)}
    again = run("render", "job.toml")
    assert again.stdout.startswith("6 frames in out, 6 of them already there; ")
    assert before == {name: (out / name).stat().st_mtime_ns for name in files(out)}

    (out / "front.night.png").unlink()  # half of a frame is no frame
    (out / "orbit.0001.day.exr").write_bytes(b"\x76\x2f\x31\x01 damaged")
    one = run("render", "job.toml")
    assert one.stdout.startswith("6 frames in out, 4 of them already there; ")
    fingerprint = read_fingerprint(out / "orbit.0001.day.exr")
    assert fingerprint is not None

    changed = run("render", "job.toml", "--set", "lightings[0].environment.radiance=2", "--lighting", "day")
    assert changed.stdout.startswith("3 frames in out; ")
    assert read_fingerprint(out / "orbit.0001.day.exr") != fingerprint


def test_choices_overrides_and_folder(run: Run, folder: Path) -> None:
    done = run(
        *("render", "job.toml", "--quiet", "--out", "a/b", "--camera", "orbit", "--lighting", "n*"),
        *("--set", "output.exr=false", "--set", "resolution_scale=0.5", "--threads", "1"),
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert files(folder / "a" / "b") == ["orbit.0001.night.png", "orbit.0002.night.png"]
    from PIL import Image

    with Image.open(folder / "a" / "b" / "orbit.0001.night.png") as image:
        assert image.size == (32, 24)


def test_the_lighting_alone(run: Run, folder: Path) -> None:
    (folder / "lit.toml").write_text('proxy = "proxy.glb"\nresolution = [64, 48]\nrender = { spp = 2 }\n')
    done = run("render", "lit.toml")
    assert done.returncode == 0, done.stderr
    assert files(folder / "out") == ["camera.lighting.exr", "camera.lighting.png"]
    assert float(read_exr(folder / "out" / "camera.lighting.exr").channels["R"].max()) > 0


def test_a_killed_run_goes_on(run: Run, folder: Path) -> None:
    frames = ("--set", "cameras[1].frames=30", "--camera", "orbit", "--lighting", "night")
    process = subprocess.Popen(
        [*COMMAND, "render", "job.toml", *frames], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    wait_for_frames(process, folder / "out", 3)
    process.kill()
    process.communicate()
    whole = [folder / "out" / name for name in files(folder / "out") if not name.startswith(".")]
    assert all(read_fingerprint(path) for path in whole)  # files appear whole or not at all
    pairs = [path for path in whole if path.suffix == ".png" and path.with_suffix(".exr") in whole]
    assert 2 <= len(pairs) < 30

    done = run("render", "job.toml", *frames)
    assert done.returncode == 0
    assert done.stdout.startswith(f"30 frames in out, {len(pairs)} of them already there; ")
    assert len(list((folder / "out").glob("[!.]*.exr"))) == 30
    assert not temporary_files(folder / "out")


def test_a_resumed_run_makes_the_same_pixels(run: Run, folder: Path) -> None:
    job = ("render", "job.toml", "--lighting", "night", "--set", "cameras[1].frames=3")
    assert run(*job, "--camera", "orbit", "--out", "whole").returncode == 0
    assert run(*job, "--camera", "orbit.0002", "--out", "parts").returncode == 0
    assert run(*job, "--camera", "orbit", "--out", "parts").stdout.startswith("3 frames in parts, 1 of them")
    for frame in (1, 2, 3):
        whole, part = (read_exr(folder / name / f"orbit.{frame:04d}.night.exr") for name in ("whole", "parts"))
        assert whole.channels.keys() == part.channels.keys()
        for name, channel in whole.channels.items():
            np.testing.assert_array_equal(channel, part.channels[name], err_msg=name)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted(folder: Path, number: signal.Signals, code: int) -> None:
    process = subprocess.Popen(
        [*COMMAND, "render", "job.toml", *MANY], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    wait_for_frames(process, folder / "out", 2)
    process.send_signal(number)
    stdout, stderr = process.communicate(timeout=120)
    assert process.returncode == code, stderr
    assert "Traceback" not in stderr and stdout == ""
    last = stderr.splitlines()[-1]
    there = len([path for path in (folder / "out").glob("*.png") if ".partial" not in path.name])
    assert last.startswith("mirelight: interrupted; ") and last.endswith("the same command goes on from there")
    assert f"{there} of 400 frames are in out" in last
    assert not temporary_files(folder / "out")


def test_the_frame_that_an_interrupt_stops_is_kept_apart(folder: Path, run: Run) -> None:
    """Its files are usable pictures, are not taken for the frame, and go when the frame is done."""
    long = ["render", "job.toml", "--camera", "front", "--lighting", "night"]
    out = folder / "out"
    for seconds in (3, 10, 30, 90):  # until the signal comes after the first samples, however slow the machine is
        process = subprocess.Popen(
            [*COMMAND, *long, "--set", "render.spp=1000000"], cwd=folder, stderr=subprocess.PIPE, text=True
        )
        time.sleep(seconds)
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=120)
        assert process.returncode == 130 and "Traceback" not in stderr
        if out.exists() and files(out):
            break
    partial = ["front.night.partial.exr", "front.night.partial.png"]
    assert files(out) == partial, stderr
    assert "mirelight: the frame in progress, as far as it got: " + ", ".join(f"out/{x}" for x in partial) in stderr
    image = read_exr(out / partial[0])
    assert image.channels["R"].max() > 0 and np.isfinite(image.channels["R"]).all()
    assert json.loads(image.metadata["mirelight/provenance"])["partial"] is True
    assert 0 < json.loads(image.metadata["mirelight/sampling"])["samples"]["min"] < 1_000_000
    assert read_fingerprint(out / partial[0]) is None and read_fingerprint(out / partial[1]) is None
    done = run(*long)
    assert done.returncode == 0 and files(out) == ["front.night.exr", "front.night.png"]


def test_a_terminal_sees_a_live_line(folder: Path) -> None:
    leader, follower = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, "render", "job.toml", "--camera", "front"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=follower,
        env={**os.environ, "COLUMNS": "120", "TERM": "xterm"},
    )
    os.close(follower)
    shown = b""
    while True:
        try:
            shown += os.read(leader, 4096)
        except OSError:  # the other end is closed
            break
        if not shown:
            break
    os.close(leader)
    stdout, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    assert stdout.startswith(b"2 frames in out; ")
    assert b"reading the job" in shown and b"front.night" in shown
    assert b"2/2 frames" in shown and b" left" in shown


# --- what cannot be written ------------------------------------------------------------------------------------------


def test_an_output_folder_that_cannot_be(run: Run, folder: Path) -> None:
    (folder / "file").write_text("")
    done = run("render", "job.toml", "--out", "file/frames")
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1 and "file/frames: cannot be written" in done.stderr
    done = run("render", "job.toml", "--out", "file")
    assert done.returncode == 2 and done.stderr.endswith(
        "file: cannot be written (it is a file, no folder); nothing half-written was left\n"
    )


def test_a_folder_without_permission(assets: Path) -> None:
    """Root may write anywhere, so the process first becomes nobody where it is root's."""
    program = """
import os, sys
from mirelight.cli import main
assert main(["render", "job.toml", "--camera", "front", "--out", "open", "--quiet"]) == 0  # everything is imported now
if os.geteuid() == 0:
    os.seteuid(65534)
sys.exit(main(["render", "job.toml", "--out", "closed"]))
"""
    with tempfile.TemporaryDirectory() as name:  # pytest's own folders are closed to others
        folder = Path(name)
        shutil.copytree(assets, folder, dirs_exist_ok=True)
        folder.chmod(0o755)
        (folder / "job.toml").write_text(JOB)
        (folder / "closed").mkdir(mode=0o555)
        done = subprocess.run([COMMAND[0], "-c", program], cwd=folder, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (2, ""), done.stderr
        said = "closed: cannot be written (no permission to write there); nothing half-written was left"
        assert done.stderr == f"mirelight: {folder}/{said}\n"
        assert files(folder / "closed") == []


def test_a_full_disk_leaves_nothing_half_written(run: Run, folder: Path) -> None:
    """A limit on file sizes, which fails in the middle of a file as a full disk does."""
    arguments = ("render", "job.toml", "--camera", "front", "--lighting", "night", "--set", "resolution=[256, 192]")
    assert run(*arguments, "--out", "warm").returncode == 0  # compiled kernels are cached now
    size = (folder / "warm" / "front.night.exr").stat().st_size

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size // 2, size // 2))

    command = [*COMMAND, *arguments, "--out", "full"]
    env = environment(PYTHONDONTWRITEBYTECODE="1")  # which Python would cut off, and fail by ever after
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, preexec_fn=limit, env=env)
    assert done.returncode == 2, done.stderr
    assert "front.night.exr: cannot be written" in done.stderr
    assert files(folder / "full") == []


def test_colours_that_cannot_be_told_are_said(run: Run, folder: Path) -> None:
    dark = 'captured={lights=[{type="point",position=[0,3,0],intensity=0}]}'
    one = (
        "render",
        "job.toml",
        "--camera",
        "front",
        "--lighting",
        "day",
        "--set",
        'proxy={path="proxy.glb",albedo="splats"}',
    )
    done = run(*one, "--set", dark)
    assert done.returncode == 0
    lines = [line for line in done.stderr.splitlines() if "colours" in line]
    assert lines == [
        'mirelight: no captured light falls on the splats, so their colours (albedo = "splats") cannot be told; '
        "look at the captured lighting, or give the proxy an albedo"
    ]
    quiet = run(*one, "--set", dark, "-q", "-o", "other")
    assert (quiet.returncode, quiet.stderr) == (0, "")


@pytest.mark.parametrize("arguments", [[], ["--workers", "2"], ["-o", "deep/er"], ["--set", "output.store=layers"]])
@pytest.mark.parametrize("wrong", ["splats.ply", "proxy.glb"])
def test_input_found_bad_before_any_frame_leaves_nothing(
    run: Run, folder: Path, wrong: str, arguments: list[str]
) -> None:
    if wrong == "splats.ply":
        content = (folder / wrong).read_bytes()
        (folder / wrong).unlink()
        (folder / wrong).write_bytes(content[:-100])
    else:
        (folder / wrong).unlink()
        line = ProxyMesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 1]], np.int32))
        write_glb(folder / wrong, line, [PointLight(name="lamp", position=np.zeros(3))])
    before = sorted(folder.rglob("*"))
    done = run("render", "job.toml", *arguments)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and wrong in done.stderr
    assert sorted(folder.rglob("*")) == before


def test_a_page_of_bad_input_leaves_nothing(run: Run, folder: Path) -> None:
    (folder / "proxy.glb").unlink()
    line = ProxyMesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 1]], np.int32))
    write_glb(folder / "proxy.glb", line, [PointLight(name="lamp", position=np.zeros(3))])
    before = sorted(folder.rglob("*"))
    done = run("mix", "job.toml", "-o", "page/of/it", "--set", 'captured="day"')
    assert done.returncode == 2 and "a mesh without area" in done.stderr
    assert sorted(folder.rglob("*")) == before


def test_input_found_bad_later_takes_nothing_away(run: Run, folder: Path) -> None:
    assert run("render", "job.toml", "--camera", "front").returncode == 0
    before = sorted(folder.rglob("*"))
    (folder / "proxy.glb").unlink()
    (folder / "proxy.glb").write_bytes(b"glTF")
    assert run("render", "job.toml").returncode == 2
    assert sorted(folder.rglob("*")) == before


def test_a_folder_that_was_there_stays(run: Run, folder: Path) -> None:
    (folder / "out").mkdir()
    (folder / "splats.ply").unlink()
    (folder / "splats.ply").write_bytes(b"ply")
    assert run("render", "job.toml").returncode == 2
    assert not list((folder / "out").iterdir())
