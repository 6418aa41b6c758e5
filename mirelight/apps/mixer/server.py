"""The mixer's page served: its files, what is traced for it, and the one file that it may write."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mirelight.apps.mixer.asked import camera_of, numbers, table, whole
from mirelight.apps.mixer.behind import BEHIND
from mirelight.apps.mixer.bundle import DESCRIPTION, LAYERS, PAGE, SPLATS
from mirelight.apps.mixer.saved import MOST_BYTES, NAME, Saved
from mirelight.apps.mixer.session import Session, State
from mirelight.apps.mixer.stills import View
from mirelight.apps.realtime import engine
from mirelight.apps.realtime.server import PATIENCE, Handler, answering
from mirelight.base.errors import InputError, MirelightError, printable
from mirelight.io.job.fields import LARGEST
from mirelight.model import LayerFactor
from mirelight.store.claims import Claims

_LIMITS = {"live/light": 1 << 12, "live/still": 1 << 18, NAME: MOST_BYTES}
_FILES = {*PAGE, *SPLATS, LAYERS, BEHIND, DESCRIPTION, *(f"engine/{name}" for name in engine.FILES.values())}
_LAYER = re.compile(r"live/layer/([0-9]{1,4})/([0-9]{1,15})")
_STILL = re.compile(r"live/still/([0-9]{1,15})")
_CLAIM = "mixer"


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """The folder is this process's own until the block ends.

    Raises:
        InputError: another process serves or writes it.
        OutputError: it cannot be written.
    """
    claims = Claims(folder)
    try:
        with claims.claim(_CLAIM) as mine:
            if not mine:
                other = next((x.process for x in claims.held() if x.name == _CLAIM), 0)
                whose = f"process {other}" if other else "another process"
                raise InputError(folder, f"{whose} serves or writes this page", "end it, or write into another folder")
            yield
    finally:
        claims.close()


@contextmanager
def serving(session: Session, folder: Path, saved: Saved, port: int = 0) -> Iterator[str]:
    """Answer a page until the block ends; nothing is traced here.

    Args:
        session: what is traced.
        folder: the exported page.
        saved: the file that it may write.
        port: 0: a free one.

    Yields:
        The page's address, with a token in it.

    Raises:
        InputError: the port is in use.
    """
    described = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))
    pages = {DESCRIPTION: json.dumps({**described, "live": True}, ensure_ascii=False).encode()}
    handler = partial(_Page, folder=folder.resolve(), pages=pages, session=session, saved=saved)
    with answering(handler, port) as address:
        yield f"{address}/index.html"


class _Page(Handler):
    """Answers the requests of one browser page."""

    def __init__(self, *args: Any, session: Session, saved: Saved, **named: Any) -> None:
        self._session, self._saved = session, saved
        super().__init__(*args, **named)

    def give(self, name: str) -> None:
        """A file of the page, news, a layer, or a still."""
        layer, still = _LAYER.fullmatch(name), _STILL.fullmatch(name)
        if name in _FILES:
            super().give(name)
        elif name == "live/state":
            state = self._session.state(self.newer_than, PATIENCE)
            self.answer(200, json.dumps(_told(state)).encode(), "state.json")
        elif layer is not None:
            made = self._session.state().layers.get(int(layer[1]))
            self.answer_or_gone(made.packed if made is not None and made.version == int(layer[2]) else b"", "layer")
        elif still is not None:
            shown = self._session.state().still
            self.answer_or_gone(shown.png if shown is not None and shown.version == int(still[1]) else b"", "still.png")
        else:
            self.send_error(404)

    def limit(self, name: str) -> int | None:
        """Of a moved light, a still that is asked for, or the job to be saved."""
        return _LIMITS.get(name)

    def take(self, name: str, body: bytes) -> None:
        """Answers with a line where it cannot be used."""
        try:
            if name == NAME:
                self._saved.save(body)
                self.answer(200, str(self._saved.path.name).encode(), "saved.txt")
            elif name == "live/light":
                version = self._move(table(body))
                self.answer(200, str(version).encode(), "version.txt")
            else:
                self._still(table(body))
                self.answer()
        except MirelightError as error:
            self.answer_error(error)

    def _move(self, asked: Mapping[str, Any]) -> int:
        layer, light = (whole(asked, key, 0, 1 << 20) for key in ("layer", "light"))
        version = self._session.move(layer, light, np.array(numbers(asked, "position", 3, LARGEST)))
        if version is None:
            raise InputError("the page", "a light that the job does not have")
        return version

    def _still(self, asked: Mapping[str, Any]) -> None:
        if asked.get("number") is None:
            self._session.drop_still()
            return
        factors = asked.get("factors")
        if not isinstance(factors, dict) or len(factors) > 1000:
            raise InputError("the page", "no factors")
        lighting = asked.get("lighting")
        if lighting is not None and not isinstance(lighting, str):
            raise InputError("the page", "a lighting without a name")
        mixed = tuple(
            LayerFactor(layer=name, factor=np.clip(numbers(factors, name, 3, LARGEST), 0, None)) for name in factors
        )
        number = whole(asked, "number", 0, 10**15)
        (exposure,) = numbers({"exposure": [asked.get("exposure")]}, "exposure", 1, 40)
        self._session.ask_still(View(number, camera_of(asked), lighting, mixed, exposure))


def _told(state: State) -> dict[str, Any]:
    still = state.still
    return {
        "version": state.version,
        "layers": [
            {"layer": k, "version": x.version, "samples": x.samples, "scale": x.scale} for k, x in state.layers.items()
        ],
        "moved": [{"layer": k, "light": i, "position": list(x)} for (k, i), x in state.moved.items()],
        "tracing": state.tracing,
        "done": round(state.done, 3),
        "still": None
        if still is None
        else {"number": still.number, "done": round(still.done, 3), "state": still.state, "version": still.version},
        "trouble": printable(state.trouble.splitlines()[0]) if state.trouble else "",
    }
