"""The mixer's server: who is answered, what may be written, and that nothing else is."""

from __future__ import annotations

import http.client
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast
from urllib.parse import urlsplit

import numpy as np
import pytest

from mirelight.apps.mixer.asked import camera_of
from mirelight.apps.mixer.news import News
from mirelight.apps.mixer.saved import Saved
from mirelight.apps.mixer.server import claimed, serving
from mirelight.apps.mixer.session import Session, State, Traced
from mirelight.apps.mixer.stills import Still, View
from mirelight.base.errors import InputError
from mirelight.io import job as jobs

JOB = """
splats = "splats.ply"
proxy = "proxy.obj"
mix = { lamp = 0.25 }

[captured]
environment = { radiance = [1, 1, 1] }

[[lights]]
type = "point"
name = "lamp"
position = [1, 2, 3]

[[lights]]
type = "point"
name = "other"
position = [0, 2, 0]

[[cameras]]
position = [0, 0, 4]
target = [0, 0, 0]
"""
VIEW = {
    "number": 7,
    "lighting": "lighting",
    "factors": {"lamp": [1, 0.5, 0]},
    "exposure": 0.5,
    "fov": 40,
    "near": 0.1,
    "width": 64,
    "height": 48,
    "pose": np.eye(4).ravel().tolist(),
}


class Deaf:
    """Stands for a session: notes what it is asked."""

    def __init__(self) -> None:
        self.asked: list[Any] = []

    def move(self, layer: int, light: int, position: np.ndarray) -> int | None:
        self.asked.append((layer, light, position.tolist()))
        return 5 if layer == 0 else None

    def ask_still(self, view: View) -> None:
        self.asked.append(view)

    def drop_still(self) -> None:
        self.asked.append(None)

    def state(self, after: int = -1, seconds: float = 0.0) -> State:
        layer = Traced(version=3, samples=8, scale=0.5, packed=b"12345678")
        return State(4, {2: layer}, {(2, 0): (0.0, 1.0, 2.0)}, "lamp", 0.5, Still(7, 0.5, "tracing", b"PNG", 9), "")


class Asker:
    """Sends requests to the server as any program of the machine could."""

    def __init__(self, address: str, session: Deaf, folder: Path) -> None:
        parts = urlsplit(address)
        self.port, self.token = parts.port or 0, parts.path.split("/")[1]
        self.session, self.folder = session, folder

    def ask(self, name: str, body: bytes | None = None, token: str | None = None, **named: str) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        method = "GET" if body is None else "PUT"
        connection.request(method, f"/{self.token if token is None else token}/{name}", body, named)
        answer = connection.getresponse()
        return answer.status, answer.read()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("served")
    (out / "splats.ply").write_bytes(
        b"ply\nformat ascii 1.0\nelement vertex 0\n"
        + b"property float x\nproperty float y\nproperty float z\nend_header\n"
    )
    (out / "proxy.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (out / "job.toml").write_text(JOB)
    (out / "secret").write_text("secret")
    (out / "page").mkdir()
    (out / "page" / "layers.json").write_text("{}")
    (out / "page" / "index.html").write_text("<html>")
    (out / "page" / "other.txt").write_text("secret")
    (out / "page" / "view.mjs").symlink_to(out / "secret")
    return out


@pytest.fixture
def asker(folder: Path) -> Iterator[Asker]:
    (folder / "mix.toml").unlink(missing_ok=True)
    session = Deaf()
    saved = Saved(jobs.parse(folder / "job.toml")[0])
    with serving(cast(Session, session), folder / "page", saved) as address:
        assert address.startswith("http://127.0.0.1:") and address.endswith("/index.html")
        yield Asker(address, session, folder)


def test_the_page_is_told_that_it_is_served(asker: Asker) -> None:
    assert asker.ask("index.html") == (200, b"<html>")
    assert json.loads(asker.ask("layers.json")[1]) == {"live": True}
    assert (asker.folder / "page" / "layers.json").read_text() == "{}"


@pytest.mark.parametrize(
    "name",
    [
        "other.txt",
        "view.mjs",
        "../secret",
        "..%2fsecret",
        "/etc/passwd",
        "",
        "mixer-7ce74b56",
        "live",
        "mix.toml",
        "x" * 3000,
    ],
)
def test_nothing_but_the_page_is_read(asker: Asker, name: str) -> None:
    status, body = asker.ask(name)
    assert status == 404 and b"secret" not in body and b"root:" not in body


def test_strangers_are_refused(asker: Asker) -> None:
    body = json.dumps({"layer": 0, "light": 0, "position": [0, 0, 0]}).encode()
    for token in ("", "x", asker.token[:-1]):
        assert asker.ask("live/state", token=token)[0] == 403
        assert asker.ask("live/light", body, token=token)[0] == 403
    for named in ({"Host": "evil.example"}, {"Host": "localhost"}, {"Origin": "http://evil.example"}):
        assert asker.ask("live/light", body, **named)[0] == 403
        assert asker.ask("mix.toml", b"", **named)[0] == 403
    assert asker.session.asked == [] and not (asker.folder / "mix.toml").exists()


def test_news_layers_and_stills(asker: Asker) -> None:
    news = json.loads(asker.ask("live/state?after=0")[1])
    assert news["layers"] == [{"layer": 2, "version": 3, "samples": 8, "scale": 0.5}]
    assert news["moved"] == [{"layer": 2, "light": 0, "position": [0, 1, 2]}]
    assert news["still"] == {"number": 7, "done": 0.5, "state": "tracing", "version": 9}
    assert asker.ask("live/layer/2/3") == (200, b"12345678")
    assert asker.ask("live/still/9") == (200, b"PNG")
    for gone in ("live/layer/2/2", "live/layer/1/3", "live/still/8", "live/layer/2/3x"):
        assert asker.ask(gone)[0] == 404


def test_what_is_asked_reaches_the_session(asker: Asker) -> None:
    assert asker.ask("live/light", b'{"layer": 0, "light": 1, "position": [1, 2.5, -3]}') == (200, b"5")
    assert asker.ask("live/still", json.dumps(VIEW).encode())[0] == 204
    assert asker.ask("live/still", b'{"number": null}')[0] == 204
    moved, view, dropped = asker.session.asked
    assert moved == (0, 1, [1, 2.5, -3]) and dropped is None
    assert (view.number, view.lighting, view.exposure) == (7, "lighting", 0.5)
    assert (view.camera.width, view.camera.height, view.camera.near) == (64, 48, 0.1)
    assert [(x.layer, x.factor.tolist()) for x in view.factors] == [("lamp", [1, 0.5, 0])]


def test_a_huge_canvas_gets_a_smaller_still() -> None:
    camera = camera_of({**VIEW, "width": 7680, "height": 4320})
    assert (camera.width, camera.height) == (1920, 1080)


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"[]",
        b"{",
        b"[" * 4000,
        b'{"layer": 1, "light": 0, "position": [0, 0, 0]}',
        b'{"layer": true, "light": 0, "position": [0, 0, 0]}',
        b'{"layer": 0, "light": -1, "position": [0, 0, 0]}',
        b'{"layer": 0, "light": 0, "position": [0, 0]}',
        b'{"layer": 0, "light": 0, "position": [0, 0, NaN]}',
        b'{"layer": 0, "light": 0, "position": [0, 0, Infinity]}',
        b'{"layer": 0, "light": 0, "position": [0, 0, 1e99]}',
        b'{"layer": 0, "light": 0, "position": ["0", 0, 0]}',
    ],
)
def test_bad_moves_are_one_line(asker: Asker, body: bytes) -> None:
    status, said = asker.ask("live/light", body)
    assert status == 422 and said.startswith(b"the page: ") and len(said.splitlines()) == 1


@pytest.mark.parametrize(
    "change",
    [
        {"pose": [0.0] * 16},
        {"pose": [1.0] * 15},
        {"pose": [2.0, *VIEW["pose"][1:]]},  # type: ignore[index]
        {"fov": 0},
        {"fov": "40"},
        {"near": -1},
        {"width": 0},
        {"height": 1 << 20},
        {"exposure": 1e9},
        {"factors": {"lamp": 1}},
        {"factors": None},
        {"lighting": 3},
        {"number": "7"},
    ],
)
def test_bad_stills_are_one_line(asker: Asker, change: dict[str, Any]) -> None:
    status, said = asker.ask("live/still", json.dumps(VIEW | change).encode())
    assert status == 422 and len(said.splitlines()) == 1
    assert asker.session.asked == []


def test_nothing_else_is_written_and_nothing_large(asker: Asker) -> None:
    for name in ("layers.json", "layers.bin", "../job.toml", "job.toml", "live/layer/2/3", "live/state", "other"):
        assert asker.ask(name, b"1")[0] == 404
    for name, size in (("live/light", 1 << 12), ("live/still", 1 << 18), ("mix.toml", 1 << 20)):
        connection = http.client.HTTPConnection("127.0.0.1", asker.port, timeout=60)
        connection.putrequest("PUT", f"/{asker.token}/{name}")
        connection.putheader("Content-Length", str(size + 1))
        connection.endheaders()
        assert connection.getresponse().status == 413
    assert (asker.folder / "job.toml").read_text() == JOB and not (asker.folder / "mix.toml").exists()


def test_the_job_is_saved_whole(asker: Asker) -> None:
    text = "[mix]\nother = [1, 0.5, 0]\n[moved]\nlamp = [4, 5, 6]\n[display]\nexposure = 1.5\n"
    for _ in range(2):
        assert asker.ask("mix.toml", text.encode()) == (200, b"mix.toml")
    job = jobs.load(asker.folder / "mix.toml")
    (lighting,) = job.lightings
    assert job.display.exposure == 1.5
    assert {k: v.tolist() for k, v in lighting.factors().items()} == {"other": [1, 0.5, 0]}  # in place of the job's
    np.testing.assert_array_equal(cast(np.ndarray, lighting.lights[0].place), [4, 5, 6])
    np.testing.assert_array_equal(cast(np.ndarray, lighting.lights[1].place), [0, 2, 0])


@pytest.mark.parametrize(
    "text",
    [
        b"\xff",
        b"mix",
        b"splats = 'other.ply'",
        b"[output]\ndirectory = '/tmp/x'",
        b"[display]\ntone = 'aces'",
        b"[display]\nexposure = 'x'",
        b"[mix]\nlamb = 1",
        b"[mix]\nlamp = -1",
        b"[moved]\nlamp = 1",
        b"[moved]\nlamp = [1, 2]",
        b"[moved.dusk]\nlamp = [1, 2, 3]",
        b"mix = 3",
        b"mix" + b".a" * 40_000 + b" = 1",
        b"x = " + b"[" * 100_000,
        b"[display]\nexposure = 1" + b"0" * 400,
        b"[mix]\nlamp = 0x" + b"f" * 100_000,
        b"[mix]\n" + b"".join(b"n%d = 1\n" % i for i in range(10_001)),
        b"[moved]\n" + b"".join(b"n%d = [1, 2, 3]\n" % i for i in range(10_001)),
    ],
)
def test_what_is_no_mix_is_not_saved(asker: Asker, text: bytes) -> None:
    status, said = asker.ask("mix.toml", text)
    assert status == 422 and len(said.splitlines()) == 1
    assert not (asker.folder / "mix.toml").exists()


def test_a_light_of_several_lightings_is_moved_in_all_of_them(folder: Path) -> None:
    lamp = 'lights = [{ type = "point", name = "lamp", position = [1, 2, 3] }]\n'
    two = "".join(f'[[lightings]]\nname = "{name}"\n{lamp}' for name in ("day", "night"))
    (folder / "two.toml").write_text(
        'proxy = "proxy.obj"\nmoved = { day = { lamp = [7, 8, 9] } }\n'
        f"{two}[[cameras]]\nposition = [0, 0, 4]\ntarget = [0, 0, 0]\n"
    )
    saved = Saved(jobs.parse(folder / "two.toml")[0])
    saved.save(b"[moved]\nlamp = [4, 5, 6]\n")
    day, night = jobs.load(saved.path).lightings
    np.testing.assert_array_equal(cast(np.ndarray, day.lights[0].place), [7, 8, 9])  # its own goes before
    np.testing.assert_array_equal(cast(np.ndarray, night.lights[0].place), [4, 5, 6])
    with pytest.raises(InputError, match=r"moved\.day"):
        saved.save(b"[moved]\nday = [4, 5, 6]\n")
    saved.path.unlink()


def test_a_file_of_the_users_own_is_left_alone(folder: Path) -> None:
    source = jobs.parse(folder / "job.toml")[0]
    saved = Saved(source)
    (folder / "mix.toml").write_text("# mine\n")
    with pytest.raises(InputError, match="a file that was not saved by this job's page; rename it"):
        Saved(source)
    with pytest.raises(InputError, match="a file that was not saved by this job's page"):
        saved.save(b"")
    assert (folder / "mix.toml").read_text() == "# mine\n"


def test_a_saved_job_is_not_written_over_by_its_own_page(asker: Asker) -> None:
    assert asker.ask("mix.toml", b"") == (200, b"mix.toml")
    with pytest.raises(InputError, match=r"mix.toml: a file that was not saved by this job's page; rename it"):
        Saved(jobs.parse(asker.folder / "mix.toml")[0])


def test_a_sweep_is_not_served(folder: Path) -> None:
    sweep = '[[sweep.axes]]\nfield = "lights[0].intensity"\nvalues = [1, 2]\n'
    (folder / "sweep.toml").write_text(JOB.replace("mix = ", "# ") + sweep)
    with pytest.raises(InputError, match="sweep: lightings made by a sweep, which are not saved; take it out"):
        Saved(jobs.parse(folder / "sweep.toml")[0])


def test_a_port_in_use_is_one_line(asker: Asker) -> None:
    saved = Saved(jobs.parse(asker.folder / "job.toml")[0])
    with (
        pytest.raises(InputError, match=rf"--port: {asker.port} cannot be used \(.*\); name another port"),
        serving(cast(Session, asker.session), asker.folder / "page", saved, asker.port),
    ):
        pass


def test_a_folder_is_served_once(tmp_path: Path) -> None:
    with claimed(tmp_path):
        with (
            pytest.raises(InputError, match=r"process \d+ serves or writes this page; end it") as told,
            claimed(tmp_path),
        ):
            pass
        assert len(str(told.value).splitlines()) == 1
    with claimed(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_page_waits_for_news() -> None:
    session = Session.__new__(Session)  # nothing is traced
    session._news = News()
    session._news.version, session._traced, session._moved = 5, {}, {}
    session._tracing, session._done, session._shown, session._trouble = "", 0.0, None, ""
    assert session.state(after=4, seconds=60).version == 5
    threading.Timer(0.2, session.drop_still).start()
    assert session.state(after=5, seconds=60).version == 6
    assert session.state(after=6, seconds=0.01).version == 6
