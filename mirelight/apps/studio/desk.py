"""What is open in the studio: nothing yet, what is being looked at, or a session; another one when it is asked for."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from mirelight.apps.studio.document import opened, way_of
from mirelight.apps.studio.session import Session
from mirelight.base.errors import InputError, MirelightError


class Desk:
    """Opens captures and jobs, one after another.

    Args:
        name: of the first capture or job; None: the page asks for it.
        folder: the page's splats go below it.
        out: where to save; None: beside what is opened.
        tell: called with a line where something cannot be made.
    """

    def __init__(
        self, name: str | None, folder: Path, out: str | None = None, tell: Callable[[str], None] = lambda line: None
    ) -> None:
        self._strict = name is not None  # what a person typed fails as commands do
        self.folder, self._out, self._tell = folder, out, tell
        self._news = threading.Condition()
        self._asked: tuple[str, str] | None = None if name is None else (name, "")
        self._name = name or ""
        self._count = 0
        self.session: Session | None = None
        self.trouble = ""

    @property
    def opening(self) -> str:
        """What is being looked at; "": nothing."""
        return self._name if self.session is None else ""

    def open(self, name: str, up: str = "") -> None:
        """Ask for a capture or a job, in place of what is open; any thread may."""
        with self._news:
            self._asked, self._name, self.session, self.trouble = (name, up), name, None, ""
            self._news.notify_all()

    def turn(self, up: str) -> None:
        """Open the capture again with another direction as up; see :func:`way_of`.

        Raises:
            InputError: nothing is open; there is no such direction.
        """
        if not self._name:
            raise InputError("the studio", "nothing is open")
        way_of(up)
        self.open(self._name, up)

    def read(self) -> None:
        """Open the saved file, which another hand has changed.

        Raises:
            InputError: it cannot be used; what is open stays.
        """
        if self.session is None:
            raise InputError("the studio", "nothing is open")
        path = self.session.document.path
        opened(path, None)
        self.open(str(path))

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Open what is asked for and trace, until Ctrl-C, or until `until` says so.

        Raises:
            MirelightError: the first one cannot be opened.
        """
        while not until():
            with self._news:
                asked, self._asked = self._asked, None
                if asked is None:
                    self._news.wait(0.2)
                    continue
            self._count += 1
            try:
                folder = self.folder / str(self._count)
                folder.mkdir()
                session = Session(opened(asked[0], self._out, asked[1]), folder, self._tell)
            except MirelightError as error:
                if self._strict and self._count == 1:
                    raise
                self._name, self.trouble = "", str(error).splitlines()[0]
                continue
            with self._news:
                self.session = session if self._asked is None else None
            session.run(lambda: self._asked is not None or until())
