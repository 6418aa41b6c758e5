"""What is traced for a page that is looked at: lights that were moved, and stills of its view.

Requests come from any thread; everything is traced on the one that calls :meth:`Session.run`. What is newer or more
urgent ends what is being traced: first light of a moved lamp, then a still, then more samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.apps.mixer import rgb9e5
from mirelight.apps.mixer.first_light import STAGES, StagedLight
from mirelight.apps.mixer.layers import MixLayers
from mirelight.apps.mixer.news import News
from mirelight.apps.mixer.stills import Still, Stills, View
from mirelight.base.errors import MirelightError
from mirelight.base.progress import counted
from mirelight.model import F64, Job
from mirelight.model.unit_lights import Unit
from mirelight.pipeline.scene import Scene

Place: TypeAlias = tuple[int, int]  # a layer, and a light in it


class _EndedError(Exception):
    """What is being traced is of no more use, or can wait."""


@dataclass(frozen=True, slots=True, eq=False)
class Traced:
    """A layer as it was traced last."""

    version: int  # counts up; pages ask for what is newer than theirs
    samples: int  # a splat
    scale: float
    packed: bytes  # (N,) RGB9E5 over the scale, little-endian


@dataclass(frozen=True, slots=True)
class State:
    """What a page is told."""

    version: int
    layers: dict[int, Traced]  # those that differ from the page's files
    moved: dict[Place, tuple[float, ...]]  # positions that differ
    tracing: str  # what is traced now; "": nothing
    done: float  # share of it
    still: Still | None
    trouble: str


class Session:
    """What one mixer page asks for, and what is traced for it.

    Args:
        scene: the prepared job.
        layers: as they were exported.
        order: (N,) of the splats in the page's files; None: the capture's own.
        stages: samples a splat of one trace after another; the first is quick whatever it says.
        tell: called with a line where something cannot be traced.
    """

    def __init__(
        self,
        scene: Scene,
        layers: MixLayers,
        stages: tuple[int, ...] = STAGES,
        tell: Callable[[str], None] = lambda line: None,
        order: NDArray[np.intp] | None = None,
    ) -> None:
        self._scene, self._layers, self._stages, self._tell = scene, layers, stages, tell
        self._order = np.arange(layers.values.shape[1]) if order is None else order
        self._news = News()
        self._units = list(layers.units)
        self._moved: dict[Place, tuple[float, ...]] = {}
        self._wanted: dict[int, int] = {}  # layer -> the stage that it waits for; the newest last
        self._asked: View | None = None
        self._shown: Still | None = None
        self._traced: dict[int, Traced] = {}
        self._number = 0
        self._working: tuple[float, int, int | None] = (np.inf, 0, None)  # urgency, number of the request, layer
        self._numbers: dict[int, int] = {}  # layer -> number of its newest request
        self._tracing, self._done, self._trouble = "", 0.0, ""
        self._splats = StagedLight(scene, stages, self._heard)
        self._stills: Stills | None = None

    # --- asked by any thread ---

    def move(self, layer: int, light: int, position: F64) -> int | None:
        """A light of a layer is elsewhere now: the version of the first news of it; None: there is no such light."""
        with self._news:
            if not (0 <= layer < len(self._units) and 0 <= light < len(self._units[layer].lights)):
                return None
            lights = list(self._units[layer].lights)
            lights[light] = lights[light].moved_to(position)
            self._units[layer] = Unit(lights=tuple(lights))
            self._moved[layer, light] = tuple(float(x) for x in position)
            self._wanted.pop(layer, None)
            self._wanted[layer] = 0
            self._number += 1
            self._numbers[layer] = self._number
            self._news.changed()
            return self._news.version

    def ask_still(self, view: View) -> None:
        """A still of a view, in place of any other that was asked for."""
        with self._news:
            self._asked = view
            self._shown = Still(view.number, 0.0, "waiting")
            self._news.changed()

    def drop_still(self) -> None:
        """Nobody looks at the still any more."""
        with self._news:
            self._asked, self._shown = None, None
            self._news.changed()

    def state(self, after: int = -1, seconds: float = 0.0) -> State:
        """How things stand, once there is something newer than a version, or so many seconds have gone."""
        with self._news:
            self._news.await_newer(after, seconds)
            return State(
                self._news.version,
                dict(self._traced),
                dict(self._moved),
                self._tracing,
                self._done,
                self._shown,
                self._trouble,
            )

    # --- the thread that traces ---

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Trace what is asked for, until Ctrl-C, or until there is nothing to do and `until` says so."""
        while True:
            with self._news:
                while (work := self._next()) is None:
                    if until():
                        return
                    self._news.wait(0.5)
                self._working = work
                view = self._asked
            try:
                if work[2] is None:
                    assert view is not None
                    self._make_still(view)
                else:
                    self._trace(work[2])
                trouble = ""
            except _EndedError:
                continue
            except (MirelightError, RuntimeError, MemoryError) as error:  # the page lives on
                trouble = self._said(error, work[2])
                self._tell(trouble)
                self._give_up(work[2])
            finally:
                with self._news:
                    self._working, self._tracing = (np.inf, 0, None), ""
                    self._news.changed()
            with self._news:
                self._trouble = trouble

    def _next(self) -> tuple[float, int, int | None] | None:
        """(urgency, number of the request, layer) of what comes next; least is first."""
        found: list[tuple[float, int, int | None]] = []
        if self._asked is not None:
            found.append((0.5, self._asked.number, None))
        for layer, stage in self._wanted.items():
            found.append((float(stage), self._numbers[layer], layer))
        return min(found, key=lambda x: (x[0], -x[1]), default=None)

    def _heard(self, what: str, share: float) -> None:
        """Progress of a trace; ends it where something else comes first."""
        with self._news:
            urgency, number, layer = self._working
            if urgency == np.inf:  # nobody has asked: it is found where splats lie
                return
            if self._is_over(urgency, number, layer):
                raise _EndedError
            if share - self._done > 0.02 or share < self._done:
                self._done = share
                if layer is None and self._shown is not None:
                    self._shown = replace(self._shown, done=share)
                self._news.changed()

    def _is_over(self, urgency: float, number: int, layer: int | None) -> bool:
        """Whether a request was replaced, or another one comes before it."""
        if layer is not None:
            replaced = self._numbers[layer] != number
        else:
            replaced = self._asked is None or self._asked.number != number
        first = self._next()
        return replaced or (first is not None and first[0] < urgency)

    def _trace(self, layer: int) -> None:
        with self._news:
            stage, unit, number = self._wanted[layer], self._units[layer], self._numbers[layer]
            self._tracing, self._done = self._layers.names[layer], 0.0
            self._news.changed()
        spp = self._stages[stage]
        light = self._splats.light(unit, stage)
        scale, made = rgb9e5.packed_layer(self._layers.layer_of(light)[self._order])
        with self._news:
            if self._numbers[layer] != number and stage > 0:
                return
            self._news.version += 1
            self._traced[layer] = Traced(self._news.version, spp, scale, made)
            if self._numbers[layer] == number:  # else it is asked for anew; what there is shows where it was
                if stage + 1 < len(self._stages):
                    self._wanted[layer] = stage + 1
                else:
                    del self._wanted[layer]
            self._news.changed()

    def _make_still(self, view: View) -> None:
        with self._news:
            self._tracing, self._done = "still", 0.0
            self._news.changed()

        def show(png: bytes, whole: bool) -> None:
            with self._news:
                if self._asked is not view:
                    return
                if whole:
                    self._asked = None
                self._news.version += 1
                self._shown = Still(
                    view.number, 1.0 if whole else self._done, "done" if whole else "tracing", png, self._news.version
                )
                self._news.changed()

        if self._stills is None:
            self._stills = Stills(self._scene, self._moved_job)
        self._stills.make(view, show, counted(self._heard, "still"))

    def _said(self, error: Exception, layer: int | None) -> str:
        """A line for people; what Dr.Jit and the machine say is longer, and its last line says what failed."""
        if isinstance(error, MirelightError):
            return str(error)
        what = "the still" if layer is None else self._layers.names[layer]
        if isinstance(error, MemoryError):
            return f"{what}: not enough memory to trace it"
        return f"{what}: cannot be traced: {(str(error).strip().splitlines() or ['no reason was given'])[-1]}"

    def _give_up(self, layer: int | None) -> None:
        with self._news:
            if layer is None:
                self._asked, self._shown = None, None
            else:
                self._wanted.pop(layer, None)

    def _moved_job(self) -> Job:
        """The job with its lights where they are now."""
        with self._news:
            moved = dict(self._moved)
        job = self._scene.job
        lightings = []
        for one in job.lightings:
            mixed = next((x for x in self._layers.lightings if x.name == one.name), None)
            places = {} if mixed is None else {x.name: (x.layer, x.light) for x in mixed.handles}
            lights = tuple(x.moved_to(moved[places[x.name]]) if places.get(x.name) in moved else x for x in one.lights)
            lightings.append(replace(one, lights=lights))
        return replace(job, lightings=tuple(lightings))
