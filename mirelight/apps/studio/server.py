"""The studio's page served: its files, news, layers and pictures; edits, frames and panoramas that it sends."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

from mirelight.apps.mixer.asked import numbers, table, whole
from mirelight.apps.realtime import engine
from mirelight.apps.realtime.server import PATIENCE, Handler, answering
from mirelight.apps.studio import uploads
from mirelight.apps.studio.desk import Desk
from mirelight.apps.studio.document import MOST_BYTES, edits_of
from mirelight.apps.studio.session import State
from mirelight.base.errors import InputError, MirelightError, printable
from mirelight.io.job.sun_position import sun_position
from mirelight.model.light_classes import LIGHT_CLASSES
from mirelight.model.surface_lights import DESCRIBED

_MIXERS = ("view.mjs", "handles.mjs", "colors.mjs", "live.mjs")
_UPLOAD, _OBJECT, _OPEN = "live/upload/", "live/object/", "live/open/"
_LIMITS = {
    "live/job": MOST_BYTES,
    "live/save": 0,
    "live/read": 0,
    "live/render": 1 << 12,
    "live/cancel": 1 << 10,
    "live/sun": 1 << 10,
    "live/turn": 1 << 10,
}
_LAYER = re.compile(r"live/layer/([0-9]{1,15})")
_AROUND = re.compile(r"live/around/([0-9]{1,15})")
_THINGS = re.compile(r"live/objects/([0-9]{1,15})")
_PICTURE = re.compile(r"live/picture/([0-9]{1,9})/[0-9]{1,9}")


@contextmanager
def serving(desk: Desk, port: int = 0) -> Iterator[str]:
    """Answer a page until the block ends; nothing is traced here.

    Args:
        desk: what is open.
        port: 0: a free one.

    Yields:
        The page's address, with a token in it.

    Raises:
        InputError: the port is in use.
        BackendError: the engine is not installed and cannot be fetched.
    """
    installed = engine.install()
    pages = {x.name: x.read_bytes() for x in resources.files(__package__).joinpath("page").iterdir()}
    pages |= {name: engine.page_file("mixer", name) for name in _MIXERS}
    pages["lights.mjs"] = f"export const LIGHTS = {json.dumps(_kinds(), ensure_ascii=False)};\n".encode()
    pages |= {f"engine/{name}": (installed / name).read_bytes() for name in engine.FILES.values()}
    handler = partial(_Page, folder=desk.folder.resolve(), pages=pages, desk=desk)
    with answering(handler, port) as address:
        yield f"{address}/index.html"


def _kinds() -> dict[str, Any]:
    """By type what a page shows of a light: the unit of its intensity; of those that their record describes, what a
    new one needs, and its numbers."""
    return {
        x.KIND.name: {
            "unit": x.KIND.unit.name,
            "oneSided": x.KIND.one_sided,
            "fields": [
                {"name": y.name, "label": y.label, "default": y.default, "least": y.least if y.least_itself else 1e-4}
                for y in x.KIND.fields
                if x in DESCRIBED
            ],
        }
        for x in LIGHT_CLASSES
    }


class _Page(Handler):
    """Answers one page."""

    def __init__(self, *args: Any, desk: Desk, **named: Any) -> None:
        self._desk = desk
        super().__init__(*args, **named)

    def give(self, name: str) -> None:
        """A file of the page, news, a layer, or a picture."""
        layer, picture, around, things = (x.fullmatch(name) for x in (_LAYER, _PICTURE, _AROUND, _THINGS))
        session = self._desk.session
        if name in self._pages or (session is not None and name == session.file):
            super().give(name)
        elif name == "live/studio":
            empty = {"opening": self._desk.opening, "trouble": self._desk.trouble}
            self.answer(200, _json(empty if session is None else session.description), "studio.json")
        elif session is None:
            self.send_error(404)
        elif name == "live/state":
            self.answer(200, _json(_told(session.state(self.newer_than, PATIENCE))), "state.json")
        elif name == "live/misfit":
            scale, packed = session.misfit()
            self.answer_or_gone(packed and struct.pack("<f", scale) + packed, "misfit")
        elif name == "live/mesh":
            self.answer_or_gone(session.mesh(), "mesh")
        elif around is not None:
            self.answer_or_gone(session.around(int(around[1])), "around.png")
        elif things is not None:
            self.answer_or_gone(session.objects(int(things[1])), "objects")
        elif layer is not None:
            self.answer_or_gone(session.packed(int(layer[1])), "layer")
        elif picture is not None:
            path = session.picture(int(picture[1]))
            try:
                self.answer_or_gone(b"" if path is None else path.read_bytes(), "picture.png")
            except OSError:  # its place was taken by the finished one
                self.send_error(404)
        else:
            self.send_error(404)

    def limit(self, name: str) -> int | None:
        """Of an edit, a frame that is asked for, or a panorama."""
        if name.startswith(_OPEN):
            return uploads.MOST_OF_CAPTURES
        return uploads.MOST_BYTES if name.startswith((_UPLOAD, _OBJECT)) else _LIMITS.get(name)

    def take(self, name: str, body: bytes) -> None:
        """Answers with a line where it cannot be used."""
        try:
            self.answer(200, _json(self._taken(name, body)), "answer.json")
        except MirelightError as error:
            self.answer_error(error)

    def _taken(self, name: str, body: bytes) -> Any:
        if name.startswith(_OPEN):
            return self._desk.open(str(uploads.capture(Path.cwd(), name.removeprefix(_OPEN), body)))
        session = self._desk.session
        if session is None:
            raise InputError("the studio", "nothing is open", "drop a capture on the page")
        if name.startswith(_UPLOAD):
            folder = session.document.path.absolute().parent
            path, intensity = uploads.kept(folder, name.removeprefix(_UPLOAD), body)
            return {"path": path, "intensity": intensity}
        if name.startswith(_OBJECT):
            folder = session.document.path.absolute().parent
            path, bounds = uploads.thing(folder, name.removeprefix(_OBJECT), body)
            return {"path": path, "bounds": bounds}
        if name == "live/read":
            return self._desk.read()
        if name == "live/save":
            return session.save()
        asked = table(body)
        if name == "live/turn":
            way = numbers(asked, "way", 3, 1e3) if "way" in asked else None
            return self._desk.turn(_text(asked, "up") if way is None else session.document.own_way(way))
        if name == "live/job":
            return session.edit(
                whole(asked, "number", 0, 10**15), _text(asked, "shown"), edits_of(_table(asked, "job"))
            )
        if name == "live/render":
            if "view" in asked:
                return session.still(_table(asked, "view"), _text(asked, "lighting"))
            return session.render(_text(asked, "camera"), _text(asked, "lighting"))
        if name == "live/cancel":
            return session.cancel(whole(asked, "number", 0, 10**9))
        return _sun(asked)


def _sun(asked: Mapping[str, Any]) -> list[float]:
    """Elevation and azimuth in degrees by latitude, longitude and time."""
    try:
        time = datetime.fromisoformat(_text(asked, "time"))
        latitude, longitude = float(asked["latitude"]), float(asked["longitude"])
    except (KeyError, TypeError, ValueError):
        raise InputError("the sun", "no place or time", "give latitude, longitude and a time") from None
    if time.tzinfo is None or not (-90 <= latitude <= 90 and -180 <= longitude <= 180):
        raise InputError("the sun", "a place that is none, or a time without its offset from UTC")
    return list(sun_position(latitude, longitude, time))


def _told(state: State) -> dict[str, Any]:
    return {
        "version": state.version,
        "phase": state.phase,
        "line": state.line,
        "number": state.number,
        "shown": state.shown,
        "level": state.level,
        "layers": [
            {"name": x.name, "weight": x.weight.tolist(), "version": x.version, "samples": x.samples, "scale": x.scale}
            for x in state.layers
        ],
        "around": state.around,
        "objects": {"version": state.things.version, "number": state.things.number, "told": state.things.told},
        "near": state.near,
        "limit": state.limit,
        "tracing": state.tracing,
        "done": round(state.done, 3),
        "trouble": printable(state.trouble),
        "edited": state.edited,
        "estimate": state.estimate,
        "renders": state.renders,
    }


def _json(value: Any) -> bytes:
    return json.dumps(value, ensure_ascii=False, default=_time).encode()


def _time(value: object) -> str:
    if isinstance(value, datetime):
        return value.isoformat()
    raise TypeError(type(value).__name__)


def _text(asked: Mapping[str, Any], key: str) -> str:
    value = asked.get(key)
    if not isinstance(value, str):
        raise InputError("the page", f"{key} is no text")
    return value


def _table(asked: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = asked.get(key)
    if not isinstance(value, dict):
        raise InputError("the page", f"{key} is no table")
    return value
