"""What one studio page asks for: a job that changes under its hands, light for it, frames.

Requests come from any thread. The proxy, the captured light and frames are made by processes of their own; light on
splats is traced on the thread that calls :meth:`Session.run`, the shown lighting's first, and coarse before fine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mirelight.apps.mixer.bundle import bookmark, write_splats
from mirelight.apps.mixer.first_light import STAGES
from mirelight.apps.mixer.layers import limit_of
from mirelight.apps.mixer.news import News
from mirelight.apps.studio import early
from mirelight.apps.studio.around import Around
from mirelight.apps.studio.document import EDITED, Document
from mirelight.apps.studio.helper import Helper
from mirelight.apps.studio.lights import Layer, Lights, Supply
from mirelight.apps.studio.renders import Renders
from mirelight.apps.studio.things import SetDown, Things
from mirelight.apps.studio.worker import Ordered
from mirelight.base.errors import InputError, MirelightError
from mirelight.model import Camera, EstimatedSky, Job, digest
from mirelight.pipeline import requirements
from mirelight.pipeline.scene import Scene, prepare
from mirelight.relighting.modes import mode_of
from mirelight.store import Store

_MOST_CAMERAS = 100  # that a page lists


class _EndedError(Exception):
    """What is being traced is of no more use."""


@dataclass(frozen=True, slots=True)
class State:
    """What a page is told."""

    version: int
    phase: str  # "proxy": a mesh is being made; "ready"; "failed"
    line: str  # what is being made
    number: int  # of the edit that layers are of
    shown: str  # the lighting that they are of
    level: float | None  # of the captured light, cd/m²; None: not known yet
    layers: tuple[Layer, ...]
    things: Things
    around: tuple[int, int]  # version of the picture of what comes from far away, and the edit that it is of
    near: float | None  # share of the splats that lie on the proxy; None: not known yet
    limit: float | None
    tracing: str
    done: float
    trouble: str
    edited: bool  # the saved file has changed by another hand
    estimate: Mapping[str, Any] | None
    renders: list[dict[str, Any]]


class Session:
    """One studio.

    Args:
        document: what is edited.
        folder: where the page's splats are written; the page is served from the one around it.
        tell: called with a line where something cannot be made.
    """

    def __init__(
        self,
        document: Document,
        folder: Path,
        tell: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.document, self._tell = document, tell
        self._news = News()
        self.edits = {key: document.data[key] for key in EDITED if key in document.data}
        self._text = document.text(self.edits)
        self._job = document.job(self._text)
        requirements.check_lit_splats(_bare(self._job))
        self._number, self._shown = 0, self._job.lightings[0].name
        self._store = Store(self._job)
        self._store.open()
        self._scene: Scene = prepare(_bare(self._job), self._store.artefacts)
        assert self._scene.splats is not None
        file, self._order = write_splats(self._scene.splats, folder)
        self.file = f"{folder.name}/{file.name}"
        self._at: Job | None = None  # whose light is traced
        self._stuck: Job | None = None  # whose light cannot be
        self._lights = Supply(self._order, self._say)
        self._refined = ""  # by which key places were asked for
        self._layers: tuple[Layer, ...] = ()
        self._objects = SetDown()
        self._around = Around()
        self._layered, self._layered_name = -1, ""  # the edit and the lighting that they are of
        self._phase, self._line = "proxy", ""
        self._tracing, self._done, self._trouble = "", 0.0, ""
        self._found: Mapping[str, Any] | None = None
        self._near: float | None = None
        self._level: float | None = None
        self._bookmarks: dict[str, dict[str, Any]] = {}  # of cameras that were told, by their digests
        self._file, self._edited = _file_of(document.path), False
        self._helper: Helper | None = None
        self._helping = False
        self._renders = Renders(self._news.changed)

    # --- asked by any thread ---

    def edit(self, number: int, shown: str, edits: Mapping[str, Any]) -> dict[str, Any]:
        """Take another job; what the page is told of it.

        Args:
            number: of the edit; an older one than the last is left alone.
            shown: name of the lighting that the page shows.
            edits: what may be edited, whole.

        Raises:
            InputError: it is no sound job; the one before stays.
        """
        text = self.document.text(edits)
        job = self.document.job(text)
        requirements.check_lit_splats(_bare(job))
        with self._news:
            if number >= self._number:
                self.edits, self._text, self._job, self._number, self._shown = dict(edits), text, job, number, shown
                self._trouble, self._stuck = "", None
                self._news.changed()
        return self.told(job)

    def told(self, job: Job | None = None) -> dict[str, Any]:
        """What a job comes to: its cameras, and the lights of each lighting."""
        job = job or self._job
        cameras = [x for x in job.cameras if x.projection == "perspective"]
        return {
            "cameras": [self._bookmark(x) for x in cameras[:_MOST_CAMERAS]],
            "lightings": [{"name": x.name, "lights": [light.name for light in x.lights]} for x in job.lightings],
        }

    def _bookmark(self, camera: Camera) -> dict[str, Any]:
        assert self._scene.splats is not None
        key = digest(camera)
        if key not in self._bookmarks:
            self._bookmarks[key] = bookmark(camera, self._scene.splats)
        return self._bookmarks[key]

    def save(self) -> str:
        """Write the job; its file's name.

        Raises:
            InputError, OutputError: as :meth:`Document.save`.
        """
        with self._news:
            self.document.save(self._text)
            self._file, self._edited = _file_of(self.document.path), False
            self._news.changed()
        return self.document.path.name

    def render(self, camera: str, lighting: str) -> int:
        """Queue a frame of the job as it is; its number.

        Raises:
            InputError: there is no such camera or lighting; too many are waiting.
        """
        with self._news:
            text, job = self._text, self._job
        for name, there in ((camera, job.cameras), (lighting, job.lightings)):
            if name not in {x.name for x in there}:
                raise InputError("the job", f"nothing named {name!r}")
        return self._renders.ask(Ordered(text=text, path=str(self.document.path), camera=camera, lighting=lighting))

    def still(self, camera: Mapping[str, Any], lighting: str) -> int:
        """As :meth:`render`, of a camera (a table) that the job does not keep."""
        with self._news:
            edits = dict(self.edits)
        cameras = [x for x in edits.get("cameras", []) if x.get("name") != camera.get("name")]
        text = self.document.text({**edits, "cameras": [*cameras, dict(camera)]})
        self.document.job(text)
        name = str(camera.get("name"))
        return self._renders.ask(Ordered(text=text, path=str(self.document.path), camera=name, lighting=lighting))

    def cancel(self, number: int) -> None:
        """End a frame."""
        self._renders.cancel(number)

    def picture(self, number: int) -> Path | None:
        """Of a frame, as far as it is."""
        return self._renders.picture(number)

    def packed(self, version: int) -> bytes:
        """The values of a layer; empty where there are newer ones."""
        return next((x.packed for x in self._layers if x.version == version), b"")

    def misfit(self) -> tuple[float, bytes]:
        """See :meth:`Lights.misfit`; nothing before there is a proxy."""
        return (1.0, b"") if self._lights.best is None else self._lights.best.misfit()

    def mesh(self) -> bytes:
        """See :meth:`Lights.mesh`; nothing before there is a proxy."""
        return b"" if self._lights.best is None else self._lights.best.mesh()

    def around(self, version: int) -> bytes:
        """A PNG file of what the shown lighting has from far away; empty where there is none, or a newer one."""
        return self._around.png if self._around.version == version else b""

    def objects(self, version: int) -> bytes:
        """What :attr:`Things.packed` is; empty where there are newer ones."""
        things = self._objects.things
        return things.packed if things.version == version else b""

    def state(self, after: int = -1, seconds: float = 0.0) -> State:
        """How things stand, once there is something newer than a version, or so many seconds have gone."""
        with self._news:
            self._news.await_newer(after, seconds)
            return State(
                self._news.version,
                self._phase,
                self._line,
                self._layered,
                self._layered_name,
                self._level,
                self._layers,
                self._objects.things,
                (self._around.version, self._around.number),
                self._near,
                limit_of(self._scene),
                self._tracing,
                self._done,
                self._trouble,
                self._edited,
                self._found,
                self._renders.told(),
            )

    @property
    def description(self) -> dict[str, Any]:
        """What a page is told once."""
        job, splats = self._job, self._scene.splats
        assert splats is not None
        return {
            "title": self.document.path.name,
            "count": len(splats),
            "file": self.file,
            "space": job.relight.space or mode_of(job.relight).space or "linear",
            "background": list(job.display.background),
            "tone": job.display.tone,
            "notes": list(self.document.notes),
            "job": self.edits,
            "begun": self.document.begun,
            "up": self.document.up,
            **self.told(),
        }

    # --- the thread that traces ---

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Trace what is shown, until Ctrl-C, or until `until` says so."""
        try:
            self._begin()
            if self._phase != "ready":
                self._lights.warm(self._scene)
            while not until():
                if not self._step():
                    with self._news:
                        self._news.wait(0.2)
                        if not self._edited and self._file is not None and _file_of(self.document.path) != self._file:
                            self._edited = True
                            self._news.changed()
        finally:
            if self._helper is not None:
                self._helper.end()
            self._renders.close()
            self._store.close()

    def _begin(self) -> None:
        """Have the proxy made, and the captured light found where it is only assumed."""
        made = self._job.made_proxy is not None
        if not made:
            self._phase = "ready"
        if made or self.document.begun:
            estimates = self.document.text({**self.edits, **self._adopted}) if self.document.begun else ""
            self._help(Ordered(self._text, str(self.document.path), estimates), "making the proxy mesh")

    def _help(self, order: Ordered, line: str) -> None:
        self._helping, self._line = True, line
        self._helper = Helper(order, self._hear)

    @property
    def _adopted(self) -> dict[str, Any]:
        """What a begun job says once its captured light is found."""
        proxy = self.document.data["proxy"]
        table = {"path": proxy} if isinstance(proxy, str) else dict(proxy)
        return {"captured": "estimate", "proxy": {**table, "albedo": "splats"}}

    def _hear(self, message: Mapping[str, Any]) -> None:
        with self._news:
            if "line" in message:
                self._line = str(message["line"])
            if "proxy" in message:
                self._phase = "ready"
            if "estimate" in message:
                self._found = {**message["estimate"], "edits": self._adopted}
            if "failed" in message:
                self._trouble = str(message["failed"])
                self._phase = "ready" if self._phase == "ready" else "failed"
                self._tell(self._trouble)
            if "ended" in message:
                self._line, self._helping = "", False
            self._news.changed()

    def _step(self) -> bool:
        """Trace one thing, or take what was edited; False: there is nothing to do."""
        with self._news:
            job, number, shown, ready = self._job, self._number, self._shown, self._phase == "ready"
        if not ready or job is self._stuck:
            return False
        try:
            return self._traced(job, number, shown)
        except _EndedError:
            return True
        except (MirelightError, RuntimeError, MemoryError) as error:  # the page lives on
            said = "not enough memory" if isinstance(error, MemoryError) else str(error).strip()
            with self._news:
                self._trouble, self._stuck = (said.splitlines() or ["it failed"])[-1], job
                self._tell(self._trouble)
            return True
        finally:
            with self._news:
                self._tracing = ""

    def _traced(self, job: Job, number: int, shown: str) -> bool:
        lighting = next((x for x in job.lightings if x.name == shown), job.lightings[0])
        taken = job is not self._at or (number, lighting.name) != (self._layered, self._layered_name)
        lights = self._take(job)
        if early.knows_captured(self._scene) or not isinstance(lighting.sky, EstimatedSky):
            self._around.look(self._scene, lighting, number)
        line = self._objects.set_down(job.objects, self._scene.mesh, number)
        if line:
            with self._news:
                self._trouble = line
                self._news.changed()
        if lights is None:
            return False
        due = list(lights.wanted(lighting))
        if self._renders.busy:  # the machine is the frame's
            due = [x for x in due if x[0] == 0]
        if not due and not taken:
            return False
        if due:
            stage, units = min(due, key=lambda x: x[0])
            self._say("light on the splats" if stage == 0 else f"light, {STAGES[stage]} samples", 0.0)
            lights.trace(units, stage)
        layers = lights.layers(lighting)
        with self._news:
            self._near, self._level = lights.near, lights.level or self._level
            if layers is not None:
                self._layers, self._layered, self._layered_name = tuple(layers), number, lighting.name
            self._news.changed()
        return True

    def _take(self, job: Job) -> Lights | None:
        """What lights a job; None: nothing yet."""
        if job is not self._at:
            self._scene, self._at = prepare(_bare(job), self._store.artefacts, like=self._scene), job
        return self._lights.of(self._scene, self._refine)

    def _refine(self) -> None:
        """Have made what fine light takes, once."""
        key = self._scene.keys.splat_places
        with self._news:
            if not self._helping and self._refined != key and self._job is self._at:
                self._refined = key
                self._help(Ordered(self._text, str(self.document.path)), early.REFINING)

    def _say(self, what: str, share: float) -> None:
        """Progress of a trace; ends it where the job has changed."""
        with self._news:
            if self._at is not None and self._job is not self._at:
                raise _EndedError
            if abs(share - self._done) > 0.02 or not self._tracing:
                self._tracing, self._done = what, share
                self._news.changed()


def _bare(job: Job) -> Job:
    """Without what is put into the capture: light on splats is without it."""
    return replace(job, objects=()) if job.objects else job


def _file_of(path: Path) -> tuple[int, int] | None:
    """What tells a file that was written anew; None: there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size
