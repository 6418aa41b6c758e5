"""`--workers N`: processes of our own, each of which makes one camera after the other.

The process that starts them gives out names of cameras and watches. A worker that dies is replaced and its camera given
out again; one that dies twice over the same camera has met something in it, which is recorded, and the rest goes on.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import subprocess
import sys
import time
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import replace

from mirelight.base.errors import RenderError
from mirelight.base.machine import cores
from mirelight.batch import executor, messages
from mirelight.batch.executor import Progress, RenderSummary
from mirelight.batch.messages import Word
from mirelight.batch.order import Order, fingerprint
from mirelight.batch.tally import FrameTally
from mirelight.pipeline.plan import Group, Plan
from mirelight.store import Store

_LOOK = 0.2  # seconds between two looks at signals
_BUSY = 1.0  # seconds before a camera of another process is asked for again
_GRACE = 60.0  # seconds that workers have to end their step
_DEATHS = 2  # over one camera, or without one


def threads_of(workers: int) -> int:
    """CPU threads for each of so many workers: an equal share of this process's cores."""
    return max(1, cores() // workers)


def run(order: Order, plan: Plan, store: Store, workers: int, progress: Progress) -> RenderSummary:
    """Makes the frames of a plan by worker processes, as `mirelight.batch.executor.run` does in one.

    Args:
        order: what `plan` was made from, for the workers to make theirs.
        plan: the frames, or a shard of them.
        workers: how many processes, at least one.

    Raises:
        MirelightError: a worker met what stops everything (a full disk, a broken file), in its words.
        RenderError: workers end before they have begun.
    """
    progress.started(plan.tasks)
    left, done = executor.to_give(plan, store, progress)
    if not left:
        return done
    count = min(workers, len(left))
    if order.threads is None and plan.job.render.threads is None:
        order = replace(order, threads=str(threads_of(workers)))
    made = _Processes(order, left, store, progress)
    with made.ended_in_order():
        return done + made.run(count)


class _Worker:
    """A process, what it was asked for and what it said last."""

    def __init__(self, order: Order) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "mirelight.batch.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C goes to the watcher, which ends its workers
        )
        assert self.process.stdin is not None and self.process.stdout is not None
        self.pipe = self.process.stdout.fileno()
        self.group: Group | None = None
        self.frame = ""
        self.spoke = False
        self._rest = b""
        self.say(order.text())

    def say(self, line: str) -> None:
        """A line to its stdin; a dead worker is noticed elsewhere."""
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):
            self.process.stdin.write(line.encode() + b"\n")
            self.process.stdin.flush()

    def ask(self, group: Group) -> None:
        """Have the frames of a camera made."""
        self.group, self.frame = group, group.name
        self.say(Word(group.name, (fingerprint(group),)).line())

    def words(self) -> Iterator[Word] | None:
        """What it said since; None: it has ended."""
        read = os.read(self.pipe, 1 << 16)
        if not read:
            return None
        *lines, self._rest = (self._rest + read).split(b"\n")
        return iter([word for word in map(Word.read, lines) if word is not None])

    def end(self, number: int | None = None) -> None:
        """No more work; with a signal: at the end of the step it is in."""
        with contextlib.suppress(OSError):
            if number is not None:
                self.process.send_signal(number)
            if self.process.stdin is not None:
                self.process.stdin.close()


class _Processes:
    def __init__(self, order: Order, groups: list[Group], store: Store, progress: Progress) -> None:
        self._order, self._progress = order, progress
        self._book = FrameTally(store, progress)
        self._due = deque(groups)
        self._later: deque[tuple[float, Group]] = deque()  # of other processes; when to ask again
        self._workers: list[_Worker] = []
        self._look = selectors.DefaultSelector()
        self._deaths: Counter[str] = Counter()

    def run(self, count: int) -> RenderSummary:
        for _ in range(count):
            self._start_worker()
        while self._workers or self._due or self._later:
            for key, _ in self._look.select(_LOOK):
                self._hear(key.data)
            if self._later and self._later[0][0] <= time.monotonic():
                self._due.append(self._later.popleft()[1])
            for worker in [x for x in self._workers if x.spoke and x.group is None]:
                self._give(worker)
            self._progress.working([x.frame for x in self._workers if x.frame])
            if self._later and not any(x.group for x in self._workers) and not self._due:
                self._progress.waiting(len(self._later))
        return self._book.done

    def _start_worker(self) -> None:
        worker = _Worker(self._order)
        self._workers.append(worker)
        self._look.register(worker.pipe, selectors.EVENT_READ, worker)

    def _give(self, worker: _Worker) -> None:
        if self._due:
            worker.ask(self._due.popleft())
        elif not self._later and not any(x.group for x in self._workers):
            worker.end()

    def _hear(self, worker: _Worker) -> None:
        words = worker.words()
        if words is None:
            self._on_worker_exit(worker)
            return
        for word in words:
            self._take(worker, word)

    def _take(self, worker: _Worker, word: Word) -> None:
        worker.spoke = True
        task = self._book.hear(worker.group, word)
        if task is not None:
            worker.frame = task.name
        if word.kind == messages.BUSY:
            assert worker.group is not None
            self._later.append((time.monotonic() + _BUSY, worker.group))
        if word.kind in (messages.BUSY, messages.DONE):
            worker.group, worker.frame = None, ""
            self._deaths.pop("", None)

    def _on_worker_exit(self, worker: _Worker) -> None:
        """A worker has ended: by itself, with its work done, or in the middle of it."""
        self._look.unregister(worker.pipe)
        self._workers.remove(worker)
        code = worker.process.wait()
        worker.end()
        group = worker.group
        if group is None and worker.spoke and not (self._due or self._later):
            return  # its work is done, or nothing is left to give it
        name = group.name if group is not None else ""
        self._deaths[name] += 1
        how = _cause(code)
        if group is None:
            if self._deaths[name] >= _DEATHS + len(self._workers):
                when = "while they wait for work" if worker.spoke else "before they have begun"
                raise RenderError(f"worker processes end {when} ({how}); see the lines above")
        elif self._deaths[name] < _DEATHS:
            self._progress.note(f"a worker process ended ({how}) while it made {worker.frame}; once more")
            self._due.appendleft(group)
        else:
            self._book.give_up(group, f"its worker process ended {_DEATHS} times ({how})")
        self._start_worker()

    @contextlib.contextmanager
    def ended_in_order(self) -> Iterator[None]:
        """However the block ends, no worker outlives it."""
        try:
            yield
        except BaseException as e:
            self._end(signal.SIGINT if isinstance(e, KeyboardInterrupt) else signal.SIGTERM)
            raise
        finally:
            for worker in self._workers:
                worker.process.kill()
                worker.process.wait()
            self._look.close()

    def _end(self, number: int) -> None:
        """Have all end after their step; what they still say of frames is heard."""
        for worker in self._workers:
            worker.end(number)
        until = time.monotonic() + _GRACE
        while self._workers and time.monotonic() < until:
            for key, _ in self._look.select(_LOOK):
                worker = key.data
                words = worker.words()
                if words is None:
                    self._look.unregister(worker.pipe)
                    self._workers.remove(worker)
                    worker.process.wait()
                    continue
                for word in words:
                    if word.kind in (messages.FINISHED, messages.PARTIAL):
                        with contextlib.suppress(KeyboardInterrupt, SystemExit):
                            self._take(worker, word)


def _cause(code: int) -> str:
    """An exit code for people."""
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"by {signal.Signals(-code).name}"
    return f"with code {code}"
