"""The loopback server: who may ask, for what, and how much it takes."""

from __future__ import annotations

import http.client
import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from mirelight.apps.realtime.server import Inbox, _Server, serve


class Asker:
    """Sends requests to a server as any program of the machine could."""

    def __init__(self, address: str, inbox: Inbox) -> None:
        parts = urlsplit(address)
        self.host, self.port = parts.hostname or "", parts.port or 0
        self.token, self.inbox = parts.path.strip("/"), inbox

    def ask(self, path: str, method: str = "GET", body: bytes | None = None, **headers: str) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection(self.host, self.port, timeout=60)
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request(method, path, body, named)
        answer = connection.getresponse()
        return answer.status, answer.read()

    def raw(self, text: str) -> bytes:
        with socket.create_connection((self.host, self.port), timeout=60) as connection:
            connection.sendall(text.replace("\n", "\r\n").encode())
            return connection.recv(1000)


@pytest.fixture
def asker(tmp_path: Path) -> Iterator[Asker]:
    folder = tmp_path / "page"
    (folder / "engine").mkdir(parents=True)
    (folder / "scene.json").write_bytes(b"{}")
    (folder / "engine" / "a b.mjs").write_bytes(b"1")
    (tmp_path / "secret").write_bytes(b"secret")
    (folder / "link").symlink_to(tmp_path / "secret")
    (folder / "up").symlink_to(tmp_path)
    os.mkfifo(folder / "pipe")
    with serve(folder, {"capture.html": b"<html>"}, {"frame": 8}) as (address, inbox):
        yield Asker(address, inbox)


def test_files_and_pages_are_served(asker: Asker) -> None:
    base = f"/{asker.token}"
    assert asker.ask(f"{base}/capture.html") == (200, b"<html>")
    assert asker.ask(f"{base}/scene.json?x=1") == (200, b"{}")
    assert asker.ask(f"{base}/engine/a%20b.mjs") == (200, b"1")
    assert asker.ask(f"{base}/captured/frame", "PUT", b"12345678") == (204, b"")
    assert asker.inbox.get_nowait() == ("frame", b"12345678")


@pytest.mark.parametrize(
    "name",
    [
        "link",
        "up/secret",
        "../secret",
        "%2e%2e/secret",
        "/etc/passwd",
        "%2fetc/passwd",
        "pipe",
        "engine",
        "",
        "a%00b",
        "x" * 5000,
    ],
)
def test_nothing_else_is(asker: Asker, name: str) -> None:
    status, body = asker.ask(f"/{asker.token}/{name}")
    assert status == 404
    assert b"secret" not in body and b"root:" not in body


def test_who_does_not_know_the_token_or_comes_by_another_name_is_refused(asker: Asker) -> None:
    good = f"/{asker.token}/scene.json"
    for path in ("/scene.json", "/", "/x/scene.json", f"/{asker.token[:-1]}/scene.json"):
        assert asker.ask(path)[0] == 403
    for host in ("evil.example", f"localhost:{asker.port}", "127.0.0.1", ""):
        assert asker.ask(good, Host=host)[0] == 403
    assert asker.ask(good, Origin="http://evil.example")[0] == 403
    assert asker.ask("/captured/frame", "PUT", b"1")[0] == 403
    for method in ("HEAD", "POST", "DELETE", "OPTIONS"):
        assert asker.ask(good, method)[0] == 501
    assert asker.inbox.empty()


@pytest.mark.parametrize(
    ("length", "code"), [("-1", 400), ("1e3", 400), ("abc", 400), ("9" * 40, 400), ("9", 413), ("+4", 400), ("", 411)]
)
def test_bad_lengths_are_refused(asker: Asker, length: str, code: int) -> None:
    head = f"PUT /{asker.token}/captured/frame HTTP/1.1\nHost: 127.0.0.1:{asker.port}\n"
    answer = asker.raw(f"{head}Content-Length: {length}\n\n")
    assert int(answer.split()[1]) == code
    assert asker.inbox.empty()


def test_a_name_that_nothing_waits_for_is_refused(asker: Asker) -> None:
    assert asker.ask(f"/{asker.token}/captured/other", "PUT", b"1")[0] == 404
    assert asker.ask(f"/{asker.token}/captured/frame", "PUT", b"1", Transfer_Encoding="chunked")[0] == 411
    assert asker.inbox.empty()


def test_fifty_connections_at_once_are_all_taken(tmp_path: Path) -> None:
    """Before any of them is answered."""
    with _Server(("127.0.0.1", 0), BaseHTTPRequestHandler) as server, ExitStack() as held:
        for _ in range(50):
            held.enter_context(socket.create_connection(("127.0.0.1", server.server_port), timeout=5))
