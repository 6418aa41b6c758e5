"""A server of one folder on this machine's loopback address, for one browser that is told a secret in the address.

Other programs and web pages of the machine can reach the port too. They know neither the token nor, where a name of
theirs is made to lead here (DNS rebinding), send the right Host.
"""

from __future__ import annotations

import hmac
import queue
import re
import secrets
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path, PurePosixPath
from shutil import copyfileobj
from typing import Any
from urllib.parse import unquote

from mirelight.errors import InputError
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
    token = secrets.token_urlsafe(16)
    handler = partial(_Handler, folder=folder.resolve(), pages=pages, limits=limits, inbox=inbox, token=token)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}/{token}", inbox
        finally:
            server.shutdown()
            thread.join()


class _Handler(BaseHTTPRequestHandler):
    """Answers GET with files and PUT with nothing."""

    timeout = _SILENCE

    def __init__(
        self,
        *args: Any,
        folder: Path,
        pages: Mapping[str, bytes],
        limits: Mapping[str, int],
        inbox: Inbox,
        token: str,
    ) -> None:
        self._folder, self._pages, self._limits = folder, pages, limits
        self._inbox, self._token = inbox, token
        super().__init__(*args)

    def do_GET(self) -> None:
        """A page or a file of the folder."""
        name = self._name()
        if name is None:
            return
        if name in self._pages:
            self._head(name, len(self._pages[name]))
            self.wfile.write(self._pages[name])
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
        """Takes ``captured/NAME``."""
        name = (self._name() or "").removeprefix("captured/")
        if not name:
            return
        length = self.headers.get("Content-Length", "")
        if name not in self._limits:
            self._refuse(404)
        elif not _LENGTH.fullmatch(length) or "Transfer-Encoding" in self.headers:
            self._refuse(411 if not length else 400)
        elif int(length) > self._limits[name]:
            self._refuse(413)
        else:
            body = self.rfile.read(int(length))
            if len(body) < int(length):
                self._refuse(400)
                return
            self._inbox.put((name, body))  # before the answer, or "done" could overtake a buffer
            self.send_response(204)
            self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Quiet: a missing file shows as the page's own error."""

    def _name(self) -> str | None:
        """What is asked for, below the token; None where the asker is refused, which it is told."""
        host = f"127.0.0.1:{self.connection.getsockname()[1]}"
        _, token, name = [*self.path.partition("?")[0].split("/", 2), "", ""][:3]
        own = self.headers.get("Host") == host and self.headers.get("Origin", f"http://{host}") == f"http://{host}"
        if not own or not hmac.compare_digest(token.encode(), self._token.encode()):
            self._refuse(403)
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

    def _head(self, name: str, length: int) -> None:
        self.send_response(200)
        self.send_header("Content-Type", _TYPES.get(PurePosixPath(name).suffix, "application/octet-stream"))
        self.send_header("Content-Length", str(length))
        self.end_headers()

    def _refuse(self, code: int) -> None:
        """Answer, and read nothing more from this connection."""
        self.close_connection = True
        self.send_error(code)
