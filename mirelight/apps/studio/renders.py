"""Frames that a page asks for, one after another in processes of their own, as `mirelight render` makes them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mirelight.apps.studio.helper import Helper
from mirelight.apps.studio.worker import Ordered
from mirelight.base.errors import InputError

MOST = 200  # that are remembered


@dataclass(slots=True, eq=False)
class Render:
    """One frame, and how far it is."""

    number: int
    order: Ordered
    state: str = "waiting"  # running, done, failed, ended
    done: float = 0.0
    said: str = ""
    picture: Path | None = None
    version: int = 0  # of the picture
    helper: Helper | None = field(default=None, repr=False)

    def told(self) -> dict[str, Any]:
        """As a page hears of it."""
        return {
            "number": self.number,
            "camera": self.order.camera,
            "lighting": self.order.lighting,
            "state": self.state,
            "done": self.done,
            "said": self.said,
            "version": self.version,
            "file": "" if self.picture is None or self.state != "done" else str(self.picture),
        }


class Renders:
    """The queue.

    Args:
        changed: called from any thread when something is new.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._lock = threading.Lock()
        self._all: list[Render] = []
        self._closed = False

    def ask(self, order: Ordered) -> int:
        """Queue a frame; its number.

        Raises:
            InputError: there are too many.
        """
        with self._lock:
            if sum(x.state in ("waiting", "running") for x in self._all) >= MOST:
                raise InputError("the queue", f"{MOST} frames", "wait for some of them")
            number = self._all[-1].number + 1 if self._all else 1
            self._all = [*self._all[-MOST:], Render(number, order)]
        self._next()
        return number

    def cancel(self, number: int) -> None:
        """Take a frame out of the queue, or end it."""
        with self._lock:
            found = next((x for x in self._all if x.number == number), None)
            if found is None or found.state not in ("waiting", "running"):
                return
            helper, found.state = found.helper, "ended"
        if helper is not None:
            helper.end()
        self._next()

    @property
    def busy(self) -> bool:
        """Whether one is being made."""
        return any(x.state == "running" for x in self._all)

    def told(self) -> list[dict[str, Any]]:
        """All, as a page hears of them."""
        with self._lock:
            return [x.told() for x in self._all]

    def picture(self, number: int) -> Path | None:
        """Of a frame, as far as it is."""
        return next((x.picture for x in self._all if x.number == number), None)

    def close(self) -> None:
        """End what is being made."""
        with self._lock:
            self._closed = True
            helpers = [x.helper for x in self._all if x.helper is not None and x.state == "running"]
        for helper in helpers:
            helper.end()

    def _next(self) -> None:
        with self._lock:
            first = next((x for x in self._all if x.state == "waiting"), None)
            if first is not None and not self.busy and not self._closed:
                first.state = "running"
                first.helper = Helper(first.order, lambda message: self._hear(first, message))
        self._changed()

    def _hear(self, render: Render, message: Mapping[str, Any]) -> None:
        with self._lock:
            if "picture" in message:
                render.picture, render.version = Path(message["picture"]), render.version + 1
            render.done = message.get("done", render.done)
            render.said = message.get("line", render.said)
            if render.state == "running":
                if "failed" in message:
                    render.state, render.said = "failed", str(message["failed"])
                elif "finished" in message:
                    render.state, render.done, render.said = "done", 1.0, ""
                elif "ended" in message:
                    render.state, render.said = "failed", render.said or "it ended early"
        if "ended" in message:
            self._next()
        else:
            self._changed()
