"""The studio's server and its job: what is answered, what may be edited and written, and that nothing else is."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from mirelight.apps.studio import opened
from mirelight.apps.studio.desk import Desk
from mirelight.apps.studio.server import serving
from mirelight.apps.studio.session import Session
from mirelight.base.errors import InputError
from mirelight.cli import main
from mirelight.io import job as jobs
from mirelight.io import splats
from mirelight.io.gltf.write import write_glb
from mirelight.io.hdr import write_hdr
from mirelight.model import digest

from .mixer_scene import walls

JOB = """
splats = "corner.ply"
proxy = "proxy.glb"
captured = { environment = { radiance = 1 } }
lights = [{ type = "point", position = [0, 1, 0], kelvin = 3000 }, { type = "sun", elevation = 30 }]
environment = { sky = { latitude = 48, longitude = 11, time = 2026-06-21T12:00:00+02:00 }, intensity = 1e-4 }
moved = { point = [0, 2, 0] }
"""


class Asker:
    """Sends requests as any program of the machine could."""

    def __init__(self, address: str, session: Session, folder: Path) -> None:
        parts = urlsplit(address)
        self.port, self.token = parts.port or 0, parts.path.split("/")[1]
        self.session, self.folder = session, folder

    def ask(self, name: str, body: Any = None, token: str | None = None, **named: str) -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
        method = "GET" if data is None else "PUT"
        connection.request(method, f"/{self.token if token is None else token}/{name}", data, named)
        answer = connection.getresponse()
        return answer.status, answer.read().decode("utf-8", "replace")


@pytest.fixture(scope="module")
def asker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Asker]:
    folder = tmp_path_factory.mktemp("studio")
    cloud, proxy = walls(8)
    splats.write(cloud, folder / "corner.ply")
    write_glb(folder / "proxy.glb", proxy, (), ())
    (folder / "job.toml").write_text(JOB)
    (folder / "page").mkdir()
    (folder / "page" / "other.txt").write_text("secret")
    desk = Desk(None, folder / "page")
    (folder / "page" / "1").mkdir()
    session = desk.session = Session(opened(str(folder / "job.toml"), None), folder / "page" / "1")
    with serving(desk) as address:
        yield Asker(address, session, folder)
    session.run(lambda: True)


def test_a_job_that_is_opened_and_saved_means_the_same(asker: Asker) -> None:
    status, name = asker.ask("live/save", b"")
    assert (status, json.loads(name)) == (200, "job.studio.toml")
    before, after = (jobs.load(asker.folder / x) for x in ("job.toml", "job.studio.toml"))
    assert digest(before.lightings) == digest(after.lightings)
    assert digest(before.captured) == digest(after.captured)
    assert before.cameras == after.cameras or digest(before.cameras) == digest(after.cameras)
    again = opened(str(asker.folder / "job.studio.toml"), None)
    assert again.path == asker.folder / "job.studio.toml"  # goes on in the same file
    told = json.loads(asker.ask("live/studio")[1])
    assert told["job"]["lightings"][0]["environment"]["sky"]["time"] == "2026-06-21T12:00:00+02:00"
    assert told["job"]["lightings"][0]["lights"][0]["position"] == [0, 2, 0]


def test_an_edit_is_taken_or_refused_in_a_line(asker: Asker) -> None:
    told = json.loads(asker.ask("live/studio")[1])["job"]
    shown = told["lightings"][0]["name"]
    number = iter(range(1, 100))

    def edit(job: Any) -> tuple[int, str]:
        return asker.ask("live/job", {"number": next(number), "shown": shown, "job": job})

    status, said = edit(told)
    assert status == 200 and json.loads(said)["lightings"] == [{"name": shown, "lights": ["point", "sun-2"]}]
    text = asker.session._text
    wrong = json.loads(json.dumps(told))
    wrong["lightings"][0]["lights"][0]["intensity"] = -1
    status, said = edit(wrong)
    assert status == 422 and said.startswith("lightings[0].lights[0].intensity: ") and "\n" not in said
    hostile: Any
    for hostile in ({**told, "output": {"directory": "/"}}, {**told, "splats": "/etc/passwd"}, [], 7):
        assert edit(hostile)[0] == 422
    assert asker.ask("live/job", b"\xff\x00")[0] == 422
    assert asker.ask("live/job", b"x", **{"Content-Length": str((1 << 20) + 1)})[0] == 413
    assert asker.session._text == text


def test_captured_light_beside_others_has_lights_of_its_own(asker: Asker) -> None:
    """What is estimated, or another lighting's, has none: it stays a name, and is saved as one."""
    known = "{ environment = { radiance = 2 } }"
    text = """splats = "corner.ply"
proxy = "splats"
lightings = ["captured", { name = "dim", environment = { radiance = 0.1 } }]
captured = """
    (asker.folder / "beside.toml").write_text(text + known)
    both = opened(str(asker.folder / "beside.toml"), None).data["lightings"]
    assert [(x["name"], x["environment"]["radiance"]) for x in both] == [("captured", 2), ("dim", 0.1)]
    for said in ('"estimate"', "{ estimate = true, exposure = 1 }", '"dim"'):
        (asker.folder / "estimated.toml").write_text(text + said)
        document = opened(str(asker.folder / "estimated.toml"), None)
        assert [sorted(x) for x in document.data["lightings"]] == [["name"], ["environment", "name"]]
        job = document.job(document.text({}))
        assert job.captured is not None and [x.name for x in job.lightings] == ["captured", "dim"]
        assert job.lightings[0].sky == job.captured.sky


def test_up_is_turned_by_hand(asker: Asker) -> None:
    """A direction that is pointed at in the world is one of the capture's own axes."""
    document = opened(asker.folder / "corner.ply", asker.folder / "up.studio.toml", "0 0.6 0.8")
    own = [float(x) for x in document.own_way([0, 3, 0]).split()]
    np.testing.assert_allclose(own, [0, 0.6, 0.8], atol=1e-3)
    for asked in ({"up": "+W"}, {"up": "1 2"}, {"up": "0 0 0"}, {"up": "nan 1 0"}, {"up": "", "way": [1]}, {}):
        assert asker.ask("live/turn", asked)[0] == 422


@pytest.mark.parametrize(
    "name", ["other.txt", "../job.toml", "..%2fjob.toml", "/etc/passwd", "", "live", "live/layer/1"]
)
def test_nothing_but_the_page_is_read(asker: Asker, name: str) -> None:
    status, body = asker.ask(name)
    assert status == 404 and "secret" not in body and "splats =" not in body


def test_strangers_are_refused(asker: Asker) -> None:
    for named in ({"token": "x"}, {"Host": "example.com"}, {"Origin": "http://example.com"}):
        for body in (None, b"{}"):
            assert asker.ask("live/save" if body else "live/studio", body, **named)[0] == 403


def test_panoramas_are_kept_beside_the_job(asker: Asker, tmp_path: Path) -> None:
    def hdr(height: int, width: int, value: float) -> bytes:
        write_hdr(tmp_path / "x.hdr", np.full((height, width, 3), value, np.float32))
        return (tmp_path / "x.hdr").read_bytes()

    def sent(name: str, body: bytes) -> tuple[int, Any]:
        status, said = asker.ask(f"live/upload/{name}", body)
        return status, json.loads(said) if status == 200 else said

    first = sent("..%2f..%2fsky.hdr", hdr(2, 4, 0.5))
    assert first == (200, {"path": "sky.hdr", "intensity": pytest.approx(2, rel=0.02)})
    assert sent("sky.hdr", hdr(2, 4, 0.5))[1]["path"] == "sky.hdr"
    assert sent("sky.hdr", hdr(2, 4, 0.25))[1]["path"] == "sky-2.hdr"
    for name, body in (("sky.exr", b"no picture"), ("a.hdr", hdr(2, 3, 1)), ("a.hdr", hdr(2, 4, 0)), ("a.sh", b"")):
        status, said = sent(name, body)
        assert status == 422 and "\n" not in said, name
    assert sorted(x.name for x in asker.folder.glob("*.[he]*r")) == ["sky-2.hdr", "sky.hdr"]


def test_meshes_are_kept_beside_the_job_and_set_down(asker: Asker, tmp_path: Path) -> None:
    """One that is no mesh is refused in a line, and nothing of it is kept; so is a capture that is none."""
    write_glb(tmp_path / "box.glb", walls(2)[1], (), ())
    status, said = asker.ask("live/object/..%2fbox.glb", (tmp_path / "box.glb").read_bytes())
    assert status == 200 and json.loads(said) == {"path": "box.glb", "bounds": [[-2, 0, -2], [2, 4, 2]]}
    for name, body in (("live/object/no.glb", b"no mesh"), ("live/object/a.exe", b""), ("live/open/no.spz", b"none")):
        status, said = asker.ask(name, body)
        assert status == 422 and "\n" not in said, name
    assert not [*asker.folder.glob("no.*")] and not [*Path.cwd().glob("no.spz")]
    before, shown = asker.session.edits, asker.session._shown
    box = {"path": "box.glb", "drop": True, "transform": {"translation": [0, 2, 0], "scale": 0.2}}
    asker.session.edit(10**6, shown, before | {"objects": [box]})
    job = asker.session._job
    line = asker.session._objects.set_down(job.objects, asker.session._scene.mesh, 7)
    (thing,) = asker.session.state().things.told
    assert line == "" and thing["name"] == "box" and thing["count"] == 12
    assert thing["place"] == pytest.approx([0, 0, 0], abs=1e-5) and thing["asked"] == pytest.approx([0, 2, 0])
    assert len(asker.session.objects(asker.session.state().things.version)) == 12 * 16
    asker.session.edit(10**6, shown, before | {"objects": [box | {"transform": {"translation": [90, 2, 0]}}]})
    line = asker.session._objects.set_down(asker.session._job.objects, asker.session._scene.mesh, 8)
    assert line.startswith("nothing of the proxy lies under 'box'") and "\n" not in line
    assert asker.session.state().things.told == (thing,)  # it stands as it did
    asker.session.edit(10**6 + 1, shown, before)


def test_the_sun_is_found_by_place_and_time(asker: Asker) -> None:
    asked = {"latitude": 23.44, "longitude": 0, "time": "2026-06-21T12:02:00+00:00"}
    status, said = asker.ask("live/sun", asked)
    assert status == 200 and json.loads(said)[0] > 89
    for change in ({"time": ""}, {"time": "2026-06-21T12:00:00"}, {"latitude": 91}, {"longitude": None}):
        assert asker.ask("live/sun", {**asked, **change})[0] == 422


def test_what_cannot_be_edited_is_one_line(asker: Asker, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is served then, and no file that the studio has not written is written over."""
    other = tmp_path / "mine.toml"
    other.write_text("mine = 1\n")
    job = str(asker.folder / "job.toml")
    for arguments in ([job, "-o", str(other)], [job, "--port", "0"], [str(tmp_path / "none.ply")]):
        assert main(["studio", *arguments, "-q"]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert other.read_text() == "mine = 1\n"
    with pytest.raises(InputError, match="sweep"):
        sweep = '\n[[sweep.axes]]\nfield = "lights[0].intensity"\nvalues = [1, 2]\n'
        (asker.folder / "swept.toml").write_text(JOB + sweep)
        opened(str(asker.folder / "swept.toml"), None)
