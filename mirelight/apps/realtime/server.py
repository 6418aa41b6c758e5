"""A server of one folder on this machine's loopback address, for one browser that is told a secret in the address.

Other programs and web pages of the machine can reach the port too. They know neither the token nor, where a name of
theirs is made to lead here (DNS rebinding), send the right Host.
"""

from __future__ import annotations

import hmac
import queue
import re
import secrets
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path, PurePosixPath
from shutil import copyfileobj
from typing import Any
from urllib.parse import unquote

from mirelight.base.errors import InputError, MirelightError, printable
from mirelight.io.safety import open_binary

Inbox = queue.Queue[tuple[str, bytes]]

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css",
    ".mjs": "text/javascript",
    ".js": "text/javascript",
    ".json": "application/json",
    ".wasm": "application/wasm",
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".glb": "model/gltf-binary",
}
_LENGTH = re.compile(r"[0-9]{1,12}")
_SILENCE = 60.0  # seconds after which a connection that says nothing is closed
PATIENCE = 20.0  # seconds that a page waits for news before it asks again
_NEWER = re.compile(r"[?&]after=([0-9]{1,15})$")
_POLL = 0.02  # seconds between two looks whether the block has ended


@contextmanager
def answering(handler: Callable[..., BaseHTTPRequestHandler], port: int = 0) -> Iterator[str]:
    """Serve on the loopback address until the block ends, a thread for each request.

    Args:
        handler: as `http.server` makes it, but for the argument `token`.
        port: 0: a free one.

    Yields:
        The address, a token in it.

    Raises:
        InputError: the port is in use.
    """
    token = secrets.token_urlsafe(16)
    try:
        made = _Server(("127.0.0.1", port), partial(handler, token=token))
    except OSError as error:
        said = f"{port} cannot be used ({error.strerror or error})"
        raise InputError("--port", said, "name another port, or none for a free one") from None
    with made as server:
        thread = threading.Thread(target=server.serve_forever, args=(_POLL,), daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}/{token}"
        finally:
            server.shutdown()
            thread.join()


@contextmanager
def serve(folder: Path, pages: Mapping[str, bytes], limits: Mapping[str, int]) -> Iterator[tuple[str, Inbox]]:
    """Serve until the block ends.

    Args:
        folder: its files and those below are served; nothing that a symbolic link leads to.
        pages: more files by name, which are not in the folder.
        limits: what may be PUT to ``captured/NAME``, by name, and the most bytes of each.

    Yields:
        The address, a token in it, and what was PUT.
    """
    inbox: Inbox = queue.Queue()
    handler = partial(_Captures, folder=folder.resolve(), pages=pages, limits=limits, inbox=inbox)
    with answering(handler) as address:
        yield address, inbox


class _Server(ThreadingHTTPServer):
    """Quiet where a browser has gone before its answer."""

    request_queue_size = 128  # connections that wait to be answered: a page may open fifty at once

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Says what went wrong, unless the other side is no longer there."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class Handler(BaseHTTPRequestHandler):
    """Answers GET with files, for those who know the token and come by the right name.

    Args:
        folder: its files and those below are served.
        pages: more files by name.
        token: first part of every path.
    """

    timeout = _SILENCE

    def __init__(self, *args: Any, folder: Path, pages: Mapping[str, bytes], token: str) -> None:
        self._folder, self._pages, self._token = folder, pages, token
        super().__init__(*args)

    def do_GET(self) -> None:
        """A page or a file of the folder."""
        name = self.asked()
        if name is not None:
            self.give(name)

    def give(self, name: str) -> None:
        """Answer a request with a file."""
        if name in self._pages:
            self.answer(200, self._pages[name], name)
            return
        try:
            with open_binary(self._file(name)) as file:
                length = file.seek(0, 2)
                file.seek(0)
                self._head(name, length)
                copyfileobj(file, self.wfile)
        except InputError:
            self.send_error(404)

    def do_PUT(self) -> None:
        """Take a buffer that the page may send."""
        name = self.asked()
        if name is None:
            return
        most, length = self.limit(name), self.headers.get("Content-Length", "")
        if most is None:
            self.refuse(404)
        elif not _LENGTH.fullmatch(length) or "Transfer-Encoding" in self.headers:
            self.refuse(411 if not length else 400)
        elif int(length) > most:
            self.refuse(413)
        else:
            body = self.rfile.read(int(length))
            if len(body) == int(length):
                self.take(name, body)
            else:
                self.refuse(400)

    def limit(self, name: str) -> int | None:
        """The most bytes that are taken there; None: nothing is."""
        return None

    def take(self, name: str, body: bytes) -> None:
        """What was sent; to be answered."""

    def answer(self, code: int = 204, body: bytes = b"", name: str = "") -> None:
        """What was asked for, its type by the name."""
        if body or name:
            self._head(name, len(body), code)
            self.wfile.write(body)
        else:
            self.send_response(code)
            self.end_headers()

    def answer_or_gone(self, body: bytes, name: str) -> None:
        """What was asked for; where that is empty, it is not there."""
        if body:
            self.answer(200, body, name)
        else:
            self.send_error(404)

    def answer_error(self, error: MirelightError) -> None:
        """The line of what was sent and cannot be used."""
        self.answer(422, printable(str(error).splitlines()[0]).encode(), "error.txt")

    @property
    def newer_than(self) -> int:
        """The version that a page has, which asks for news; -1: none."""
        after = _NEWER.search(self.path)
        return int(after[1]) if after else -1

    def log_message(self, format: str, *args: Any) -> None:
        """Quiet: a missing file shows as the page's own error."""

    def asked(self) -> str | None:
        """What is asked for, below the token; None where the asker is refused, which it is told."""
        host = f"127.0.0.1:{self.connection.getsockname()[1]}"
        _, token, name = [*self.path.partition("?")[0].split("/", 2), "", ""][:3]
        own = self.headers.get("Host") == host and self.headers.get("Origin", f"http://{host}") == f"http://{host}"
        if not own or not hmac.compare_digest(token.encode(), self._token.encode()):
            self.refuse(403)
            return None
        return unquote(name)

    def _file(self, name: str) -> Path:
        """The path in the folder. Raises InputError: it leaves the folder, or goes through a symbolic link."""
        parts = PurePosixPath(name).parts
        path = self._folder.joinpath(*parts)
        try:
            plain = bool(parts) and ".." not in parts and not name.startswith("/") and path.resolve() == path
        except (OSError, ValueError, RuntimeError):
            plain = False
        if not plain:
            raise InputError(path, "not a file of the folder")
        return path

    def _head(self, name: str, length: int, code: int = 200) -> None:
        self.send_response(code)
        self.send_header("Content-Type", _TYPES.get(PurePosixPath(name).suffix, "application/octet-stream"))
        self.send_header("Content-Length", str(length))
        self.end_headers()

    def refuse(self, code: int) -> None:
        """Answer, and read nothing more from this connection."""
        self.close_connection = True
        self.send_error(code)


class _Captures(Handler):
    """Takes ``captured/NAME`` by PUT."""

    def __init__(self, *args: Any, limits: Mapping[str, int], inbox: Inbox, **named: Any) -> None:
        self._limits, self._inbox = limits, inbox
        super().__init__(*args, **named)

    def limit(self, name: str) -> int | None:
        """The most bytes that a buffer may have."""
        return self._limits.get(name.removeprefix("captured/")) if name.startswith("captured/") else None

    def take(self, name: str, body: bytes) -> None:
        """Put what was sent into the inbox, and answer."""
        self._inbox.put((name.removeprefix("captured/"), body))  # before the answer, or "done" could overtake a buffer
        self.answer()
