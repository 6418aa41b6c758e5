"""`mirelight status`: every frame counted once, who is at work, why frames failed, and exit codes for scripts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mirelight.batch.status import status
from mirelight.cli.status import lines
from mirelight.io import owner
from mirelight.store.claims import Claims
from mirelight.store.journal import Journal, Row

from .conftest import Run

ORBIT = ("--set", "cameras[1].frames=3", "--set", "render.spp=1")  # with front: 4 cameras under 2 lightings


def read(run: Run, code: int) -> dict[str, Any]:
    told = run("status", "out", "--json")
    assert told.returncode == code, told.stderr
    return dict(json.loads(told.stdout))


def test_each_frame_is_counted_once(folder: Path, run: Run) -> None:
    assert run("status", "out").returncode == 2
    out = folder / "out"
    out.mkdir()
    told = run("status", "out")
    assert told.returncode == 2 and "no record of what is to be made" in told.stderr
    assert run("render", "job.toml", *ORBIT, "--shard", "1/2").returncode == 0  # front, orbit.0002

    found = read(run, 1)
    assert (found["state"], found["frames"], found["there"]) == ("stopped", 8, 4)
    assert found["missing"] == [f"orbit.000{i}.{light}" for i in (1, 3) for light in ("day", "night")]
    assert found["seconds_left"] > 0 and found["command"].startswith("mirelight render /")

    aside = out / ".mirelight"
    (plan,) = (aside / "plans").iterdir()
    files = {name: keys for name, _, _, keys, _ in json.loads(plan.read_text())["frames"]}
    journal = Journal(aside / "journal")
    journal.add(Row("orbit.0001.day", {}, 0.0, "Traceback\nValueError: no such view", files["orbit.0001.day"]))
    journal.add(Row("orbit.0003.day", {}, 0.0, "of other inputs", {".exr": "old"}))
    journal.close()
    claims = Claims(aside / "claims")
    with claims.claim("orbit.0003.day"), claims.claim("front.day"):  # the second has nothing left to make
        found = read(run, 3)
        assert found["state"] == "running" and found["missing"] == ["orbit.0001.night"]
        (one,) = found["in_flight"]
        assert one["frames"] == ["orbit.0003.day", "orbit.0003.night"] and one["camera"] == "orbit.0003"
        assert found["failed"] == [{"frame": "orbit.0001.day", "error": "ValueError: no such view"}]
        text = list(lines(status(out)))
        assert text[0].endswith("out: 4 of 8 frames there, 2 in flight, 1 failed, 1 missing")
        assert text[1].startswith("in flight  orbit.0003.day and 1 more of its camera: process ")
        assert text[2] == "failed     orbit.0001.day: ValueError: no such view"
        assert text[3] == "missing    orbit.0001.night" and text[4].endswith("with 1 at work")
        (claim,) = (x for x in (aside / "claims").glob("orbit*"))
        claim.write_text(claim.read_text().replace(owner.token(), f"{owner.machine()}-4194305"))  # killed
        assert read(run, 1)["in_flight"] == []
        claim.unlink()

    (out / "front.day.png").unlink()
    assert "front.day" in read(run, 1)["missing"]
    done = run("render", "job.toml", *ORBIT)
    assert done.returncode == 0, done.stderr
    told = run("status", "out")
    assert (told.returncode, told.stdout) == (0, "out: 8 of 8 frames there\n")


def test_layers_alone_are_known_too(folder: Path, run: Run) -> None:
    layers = ("--set", "output.store=layers", *ORBIT)
    assert run("render", "job.toml", *layers, "--shard", "1/2").returncode == 0
    found = read(run, 1)
    assert (found["frames"], found["there"]) == (8, 4) and found["seconds_left"] > 0
    assert run("render", "job.toml", *layers).returncode == 0
    assert read(run, 0)["there"] == 8
