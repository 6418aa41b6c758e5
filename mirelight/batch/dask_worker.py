"""What `--scheduler` runs on the workers of a Dask scheduler: one camera after the other."""

from __future__ import annotations

import contextlib
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

from mirelight.base.errors import MirelightError
from mirelight.base.version import __version__
from mirelight.batch import messages
from mirelight.batch.executor import RenderSummary
from mirelight.batch.messages import Reporter, Word
from mirelight.batch.order import Order
from mirelight.batch.processes import threads_of
from mirelight.batch.worker import WorkerContext


def host(worker: str) -> str:
    """Of an address like tcp://10.0.0.7:40123."""
    return worker.partition("://")[2].rpartition(":")[0] or worker


class _DaskWorker:
    """What a worker process keeps from one camera to the next. One thread does all, as kernels and scenes want it."""

    def __init__(self) -> None:
        self.thread = ThreadPoolExecutor(1, thread_name_prefix="mirelight")
        self.halted: set[str] = set()  # runs that were told to end
        self._context: tuple[str, WorkerContext, _Teller] | None = None

    def make(self, task: _Task) -> list[str]:
        """The words of a camera made, in the thread of the worker."""
        if task.run in self.halted:
            return []
        said = _Said(task)
        try:
            made = self._made(task, said)
        except MirelightError as e:
            said.say(Word(messages.FATAL, (str(e),)))
        except KeyboardInterrupt:
            if self._context is not None and self._context[1].store.partial:
                said.say(Word(messages.PARTIAL, tuple(str(path) for path in self._context[1].store.partial)))
                self._context[1].store.partial = ()
        else:
            said.say(messages.outcome(made))
        return said.lines

    def _made(self, task: _Task, said: _Said) -> RenderSummary | None:
        for again in (False, True):
            context, teller = self._ready(task, said, again)
            if not again and not context.plans(task.camera, task.expected):
                continue  # files have changed since this worker read them
            teller.said, teller.halted = said, self.halted
            return context.make(task.camera, task.expected)
        return None

    def _ready(self, task: _Task, said: _Said, anew: bool) -> tuple[WorkerContext, _Teller]:
        if self._context is None or self._context[0] != task.order or anew:
            if self._context is not None:
                self._context[1].store.close()
                self._context = None
            order = Order.read(task.order)
            if task.beside:
                order = replace(order, threads=str(threads_of(task.beside)))
            teller = _Teller(said, self.halted)
            self._context = task.order, WorkerContext(order, teller), teller
        _, context, teller = self._context
        context.store.begin(task.run)
        return context, teller

    def rest(self, run: str) -> None:
        """No more work of that run."""
        if self._context is not None:
            self._context[1].store.rest(run)


class _Task:
    """A camera to make, as it came."""

    def __init__(self, order: str, camera: str, expected: str, run: str, beside: dict[str, int], worker: Any) -> None:
        self.order, self.camera, self.expected, self.run, self.worker = order, camera, expected, run, worker
        self.beside = beside.get(host(worker.address), 1) if beside else 0  # workers of this machine; 0: never mind


class _Said:
    """Words told at once, by the way; those that count come back with the task."""

    def __init__(self, task: _Task) -> None:
        self.task = task
        self.lines: list[str] = []

    def say(self, word: Word) -> None:
        line = word.line()
        if word.kind not in (messages.SAMPLES, messages.NOTE):
            self.lines.append(line)
        if word.kind not in (messages.DONE, messages.BUSY, messages.FATAL):
            with contextlib.suppress(Exception):
                self.task.worker.log_event(self.task.run, [self.task.worker.address, self.task.camera, line])


class _Teller(Reporter):
    """Tells of the task in hand, and ends it between two steps once its run was told to end."""

    def __init__(self, said: _Said, halted: set[str]) -> None:
        super().__init__(lambda word: self.said.say(word))
        self.said, self.halted = said, halted

    def check(self) -> None:
        """Raises KeyboardInterrupt."""
        if self.said.task.run in self.halted:
            raise KeyboardInterrupt


_HERE: _DaskWorker | None = None
_OPENING = threading.Lock()


def _here() -> _DaskWorker:
    global _HERE
    with _OPENING:
        if _HERE is None:
            _HERE = _DaskWorker()
        return _HERE


def make(order: str, camera: str, expected: str, run: str, beside: dict[str, int]) -> tuple[str, list[str]]:
    """A task: make what is missing of a camera's frames; the worker's address, and words."""
    from distributed import get_worker

    worker = get_worker()
    here = _here()
    task = _Task(order, camera, expected, run, beside, worker)
    return worker.address, here.thread.submit(here.make, task).result()


def version() -> str:
    """The version of mirelight on that worker."""
    return __version__


def halt(run: str) -> None:
    """That run ends at the next step."""
    _here().halted.add(run)


def rest(run: str) -> None:
    """No more work of that run."""
    _here().rest(run)
