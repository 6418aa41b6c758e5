"""`--scheduler ADDRESS`: the workers of a Dask scheduler, each of which makes one camera after the other.

A task is a camera: its order as text, its name, and what comes back are words. Pictures go through the folder that all
share. Few tasks are out at a time, so that a run that ends leaves none behind.
"""

from __future__ import annotations

import contextlib
import json
import logging
import queue
import secrets
import time
from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

from mirelight.base import extras
from mirelight.base.errors import BackendError, InputError, MirelightError, RenderError
from mirelight.base.version import __version__
from mirelight.batch import dask_worker, executor, messages
from mirelight.batch.executor import Progress, RenderSummary
from mirelight.batch.messages import Word
from mirelight.batch.order import Order, fingerprint
from mirelight.batch.tally import FrameTally
from mirelight.io.safety import read_file
from mirelight.pipeline.plan import Group, Plan
from mirelight.store import Store

_LOOK = 0.2  # seconds between two looks at signals
_COUNT = 2.0  # seconds between two counts of the workers
_BUSY = 1.0  # seconds before a camera of another process is asked for again
_GRACE = 60.0  # seconds that workers have to end their step
_FIRST = 5  # seconds for whatever listens at an address to say that it is a scheduler
_ANSWER = 10  # seconds for a scheduler to answer
_FETCH = 2  # seconds for a task's words to come
_AHEAD = 2  # tasks for each worker that are out


def require() -> None:
    """See that Dask is there, before any work.

    Raises:
        BackendError: it is not.
    """
    extras.require("dask")
    try:
        import distributed  # noqa: F401
    except ImportError:  # there, and broken
        raise extras.needed("dask") from None


def run(order: Order, plan: Plan, store: Store, address: str, progress: Progress) -> RenderSummary:
    """`mirelight.batch.executor.run` by the workers of a Dask scheduler.

    A worker that dies is the scheduler's to notice: its camera goes to another one. Where workers die again and again
    (`allowed-failures`, 3), Dask blames all that lay with them: each such camera is tried alone when the rest is done,
    and recorded as failed if that ends workers, too.

    Args:
        order: what `plan` was made from, for the workers to make theirs.
        plan: the frames, or a shard of them.
        address: the scheduler's, or its `--scheduler-file`.

    Raises:
        InputError: no scheduler answers there.
        BackendError: its workers cannot run this mirelight.
        MirelightError: a worker met what stops everything (a full disk, a file it cannot see), in its words.
        RenderError: the scheduler is gone.
    """
    progress.started(plan.tasks)
    left, done = executor.to_give(plan, store, progress)
    if not left:
        return done
    with _connected(address) as client:
        return done + _Office(client, address, order.anywhere(), plan, left, store, progress).run()


@contextlib.contextmanager
def _connected(address: str) -> Iterator[Any]:
    from distributed import Client

    for name in ("distributed", "distributed.client", "distributed.core", "distributed.comm"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is said in a line of our own
    try:
        where = _address(address)
        kind = _kind(where)
        if kind != "Scheduler":
            raise ValueError(kind)
        client = Client(where, timeout=_ANSWER, set_as_default=False)
    except Exception as e:  # what it makes of addresses, files and answers that are none
        found = f"no Dask scheduler answers there ({type(e).__name__})"
        remedy = "start one with `dask scheduler`, and give the address that it prints"
        raise InputError(f"--scheduler {address}", found, remedy) from None
    try:
        yield client
    finally:
        with contextlib.suppress(Exception):
            client.close(timeout=2)


def _address(given: str) -> str:
    """The address that was given, or that a scheduler's file holds."""
    file = Path(given)
    if not file.is_file():
        return given
    address = json.loads(read_file(file))["address"]
    if not isinstance(address, str):
        raise TypeError
    return address


def _kind(address: str) -> str:
    """What of Dask answers at an address. A `Client` would wait for ever for what listens and says nothing, and leave
    threads behind that complain."""
    import asyncio

    from distributed.comm import connect
    from distributed.core import send_recv
    from distributed.security import Security

    async def asked() -> str:
        comm = await connect(address, timeout=_FIRST, **Security().get_connection_args("client"))
        try:
            return str((await send_recv(comm, op="identity"))["type"])
        finally:
            comm.abort()

    return asyncio.run(asyncio.wait_for(asked(), _FIRST))


class _Office:
    """Gives out cameras and hears of frames, in the process of the command."""

    def __init__(
        self, client: Any, address: str, order: Order, plan: Plan, left: list[Group], store: Store, progress: Progress
    ) -> None:
        self._client, self._address, self._text = client, address, order.text()
        self._shares_cores = order.threads is None and plan.job.render.threads is None
        self._run = secrets.token_hex(6)
        self._book = FrameTally(store, progress)
        self._progress = progress
        self._groups = {group.name: group for group in left}
        self._due = deque(left)
        self._later: deque[tuple[float, Group]] = deque()  # of other processes; when to ask again
        self._out: dict[Any, Group] = {}  # by future
        self._blamed: deque[Group] = deque()  # workers died over them, or over others that lay beside: once more, alone
        self._alone = ""
        self._heard: queue.Queue[tuple[str, Any]] = queue.Queue()
        self._frames: dict[str, str] = {}  # by worker, what it is at
        self._workers: dict[str, int] = {}  # threads by address
        self._known: set[str] = set()  # workers that were asked who they are
        self._counted = 0.0
        self._said: set[str] = set()

    def run(self) -> RenderSummary:
        self._client.subscribe_topic(self._run, lambda event: self._heard.put(("word", event[1])))
        try:
            while self._due or self._later or self._out or self._blamed:
                self._count()
                self._give()
                self._hear()
                self._progress.working(list(self._frames.values()))
                if self._later and not self._out and not self._due:
                    self._progress.waiting(len(self._later))
        except BaseException:
            self._stop()
            raise
        finally:
            with contextlib.suppress(Exception):
                self._client.run(dask_worker.rest, self._run, on_error="ignore")
        return self._book.done

    def _count(self) -> None:
        """Who works for the scheduler now."""
        now = time.monotonic()
        if now - self._counted < _COUNT:
            return
        self._counted = now
        try:
            self._workers = dict(self._client.nthreads())
        except Exception as e:
            raise self._gone() from e
        self._frames = {x: name for x, name in self._frames.items() if x in self._workers}
        if not self._workers:
            self._once(f"the scheduler at {self._address} has no workers yet; waiting for some")
        new = sorted(set(self._workers) - self._known)
        if not new:
            return
        self._known.update(new)
        if max(self._workers[x] for x in new) > 1:
            self._once("workers make one frame at a time: start them with --nthreads 1, as many as fit in memory")
        for worker, said in self._client.run(dask_worker.version, workers=new, on_error="return").items():
            if isinstance(said, OSError):
                continue  # it has just ended
            if isinstance(said, BaseException):
                text = f"the worker {worker} cannot run mirelight ({type(said).__name__}: {said})"
                raise BackendError(f"{text}; install version {__version__} there")
            if said != __version__:
                raise BackendError(f"the worker {worker} has mirelight {said}; install version {__version__} there")

    def _give(self) -> None:
        while self._later and self._later[0][0] <= time.monotonic():
            self._due.append(self._later.popleft()[1])
        if self._blamed and not (self._due or self._later or self._out):
            self._due.append(self._blamed.popleft())
            self._alone = self._due[0].name
        hosts = Counter(dask_worker.host(x) for x in self._workers)
        while self._due and len(self._out) < _AHEAD * len(self._workers):
            group = self._due.popleft()
            beside = dict(hosts) if self._shares_cores else {}
            future = self._client.submit(
                dask_worker.make, self._text, group.name, fingerprint(group), self._run, beside, pure=False, retries=0
            )
            self._await(group, future)

    def _hear(self) -> None:
        until = time.monotonic() + _LOOK
        while (left := until - time.monotonic()) > 0:
            try:
                kind, value = self._heard.get(timeout=left)
            except queue.Empty:
                return
            if kind == "word":
                self._word(value)
            else:
                self._ended(value)

    def _word(self, value: Any) -> None:
        worker, camera, line = value
        word = Word.read(line)
        if word is not None and word.kind != messages.FATAL:  # that comes back as its task's result, too
            task = self._book.hear(self._groups.get(camera), word)
            if task is not None:
                self._frames[worker] = task.name

    def _await(self, group: Group, future: Any) -> None:
        self._out[future] = group
        future.add_done_callback(lambda x: self._heard.put(("done", x)))

    def _ended(self, future: Any) -> None:
        """A task has come back, or will not."""
        group = self._out.pop(future, None)
        if group is None:
            return
        if future.status == "cancelled":
            raise self._gone()
        from asyncio import CancelledError as AsyncCancelled  # takes 50 ms that runs without Dask need not spend

        try:
            error = future.exception(timeout=_FETCH)
            worker, lines = future.result(timeout=_FETCH) if error is None else ("", [])
        except (AsyncCancelled, CancelledError):
            raise self._gone() from None
        except TimeoutError:  # its worker died before it could be asked what it did: the task is being done again
            self._await(group, future)
            return
        killed = type(error).__name__ == "KilledWorker"
        if killed and group.name != self._alone:
            self._blamed.append(group)
        elif error is not None:
            why = "its worker process ended again and again" if killed else f"{type(error).__name__}: {error}"
            self._book.give_up(group, why)
        self._frames.pop(worker, None)
        for line in lines:
            word = Word.read(line)
            if word is None:
                continue
            if word.kind == messages.BUSY:
                self._later.append((time.monotonic() + _BUSY, group))
            elif word.kind == messages.FATAL:
                raise MirelightError(f"{word.values[0]} (on the worker {worker})")
            else:
                self._book.hear(group, word)

    def _stop(self) -> None:
        """Have the workers end after their step; what they still say of frames is heard."""
        if self._client.status != "running":
            return
        with contextlib.suppress(Exception):
            self._client.run(dask_worker.halt, self._run, on_error="ignore")
        until = time.monotonic() + _GRACE
        while self._out and self._client.status == "running" and time.monotonic() < until:
            with contextlib.suppress(MirelightError, KeyboardInterrupt, SystemExit):
                self._hear()

    def _gone(self) -> RenderError:
        there = "what was made is there, and the same command goes on once a scheduler runs"
        return RenderError(f"the Dask scheduler at {self._address} is gone; {there}")

    def _once(self, line: str) -> None:
        if line not in self._said:
            self._said.add(line)
            self._progress.note(line)
