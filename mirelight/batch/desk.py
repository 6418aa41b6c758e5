"""What `--scheduler` runs on the workers of a Dask scheduler: a desk, on which one camera after the other is made."""

from __future__ import annotations

import contextlib
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

from mirelight.base.errors import MirelightError
from mirelight.base.version import __version__
from mirelight.batch import post
from mirelight.batch.crew import threads_of
from mirelight.batch.executor import RenderSummary
from mirelight.batch.order import Order
from mirelight.batch.post import Reporter, Word
from mirelight.batch.worker import Bench
from mirelight.pipeline.plan import FrameTask


def host(worker: str) -> str:
    """Of an address like tcp://10.0.0.7:40123."""
    return worker.partition("://")[2].rpartition(":")[0] or worker


class _Desk:
    """What a worker process keeps from one camera to the next. One thread does all, as kernels and scenes want it."""

    def __init__(self) -> None:
        self.thread = ThreadPoolExecutor(1, thread_name_prefix="mirelight")
        self.halted: set[str] = set()  # runs that were told to end
        self._bench: tuple[str, Bench, _Teller] | None = None

    def make(self, task: _Task) -> list[str]:
        """The words of a camera made, in the desk's thread."""
        if task.run in self.halted:
            return []
        said = _Said(task)
        try:
            made = self._made(task, said)
        except MirelightError as e:
            said.say(Word(post.FATAL, (str(e),)))
        except KeyboardInterrupt:
            if self._bench is not None and self._bench[1].store.partial:
                said.say(Word(post.PARTIAL, tuple(str(path) for path in self._bench[1].store.partial)))
                self._bench[1].store.partial = ()
        else:
            word = (made.rendered, made.skipped, made.failed) if made is not None else ()
            said.say(Word(post.BUSY if made is None else post.DONE, word))
        return said.lines

    def _made(self, task: _Task, said: _Said) -> RenderSummary | None:
        for again in (False, True):
            bench, teller = self._ready(task, said, again)
            if not again and not bench.plans(task.camera, task.expected):
                continue  # files have changed since this worker read them
            teller.said, teller.halted = said, self.halted
            return bench.make(task.camera, task.expected)
        return None

    def _ready(self, task: _Task, said: _Said, anew: bool) -> tuple[Bench, _Teller]:
        if self._bench is None or self._bench[0] != task.order or anew:
            if self._bench is not None:
                self._bench[1].store.close()
                self._bench = None
            order = Order.read(task.order)
            if task.beside:
                order = replace(order, threads=str(threads_of(task.beside)))
            teller = _Teller(said, self.halted)
            self._bench = task.order, Bench(order, teller), teller
        _, bench, teller = self._bench
        bench.store.begin(task.run)
        return bench, teller

    def rest(self, run: str) -> None:
        """No more work of that run."""
        if self._bench is not None:
            self._bench[1].store.rest(run)


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
        if word.kind not in (post.SAMPLES, post.NOTE):
            self.lines.append(line)
        if word.kind not in (post.DONE, post.BUSY, post.FATAL):
            with contextlib.suppress(Exception):
                self.task.worker.log_event(self.task.run, [self.task.worker.address, self.task.camera, line])


class _Teller(Reporter):
    """Tells of the task in hand, and ends it between two steps once its run was told to end."""

    def __init__(self, said: _Said, halted: set[str]) -> None:
        super().__init__(lambda word: self.said.say(word))
        self.said, self.halted = said, halted

    def _check(self) -> None:
        if self.said.task.run in self.halted:
            raise KeyboardInterrupt

    def samples(self, task: FrameTask, done: int, total: int) -> None:
        super().samples(task, done, total)
        self._check()

    def finished(self, task: FrameTask, skipped: bool) -> None:
        super().finished(task, skipped)
        self._check()


_DESK: _Desk | None = None
_OPENING = threading.Lock()


def _desk() -> _Desk:
    global _DESK
    with _OPENING:
        if _DESK is None:
            _DESK = _Desk()
        return _DESK


def make(order: str, camera: str, expected: str, run: str, beside: dict[str, int]) -> tuple[str, list[str]]:
    """A task: make what is missing of a camera's frames; the worker's address, and words."""
    from distributed import get_worker

    worker = get_worker()
    desk = _desk()
    task = _Task(order, camera, expected, run, beside, worker)
    return worker.address, desk.thread.submit(desk.make, task).result()


def version() -> str:
    """Of mirelight there."""
    return __version__


def halt(run: str) -> None:
    """That run ends at the next step."""
    _desk().halted.add(run)


def rest(run: str) -> None:
    """No more work of that run."""
    _desk().rest(run)
