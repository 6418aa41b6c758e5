"""What scripts/bench truth keeps in a folder, under digests of what it is made from, and what making it has cost.

A run that was stopped goes on where it was; one after a change of code makes again what that code makes. Costs are kept
beside the things, so a run from kept things knows what all of it takes.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from mirelight.model import ProxyMesh, digest

T = TypeVar("T")
F32 = NDArray[np.float32]
Maker = Literal["scenes", "proxies", "light", "rows"]

ROOT = Path(__file__).resolve().parents[2]
SCENES = ("scripts/scenegen", "scripts/bench/truth_captures.py")
MAKERS: dict[Maker, tuple[str, ...]] = {
    "scenes": SCENES,
    "proxies": (*SCENES, "mirelight/proxy", "mirelight/lighting", "mirelight/compositor", "mirelight/model"),
    "light": ("mirelight/estimate", "mirelight/lighting", "mirelight/model", "mirelight/proxy/capture_views.py"),
    "rows": (
        "mirelight/relighting",
        "mirelight/lighting",
        "mirelight/compositor",
        "mirelight/model",
        "mirelight/proxy/capture_views.py",
        "scripts/bench/truth_rows.py",
        "scripts/bench/truth_scores.py",
        "scripts/bench/truth_seen.py",
    ),
}


class Store:
    """A folder of kept things. Several processes may share it: what one makes, the others wait for."""

    def __init__(self, folder: Path) -> None:
        self._code = {maker: _digest(sources) for maker, sources in MAKERS.items()}
        self._folder = folder
        self.costs: dict[str, dict[str, float]] = {}  # by kept thing and part of the protocol, CPU seconds
        self._now: dict[str, float] = {}  # of the thing that is being made

    def cost(self, part: str, make: Callable[[], T]) -> T:
        """What it makes; its CPU seconds are noted under the part of the protocol that they belong to."""
        made, _ = self.timed(part, make)
        return made

    def timed(self, part: str, make: Callable[[], T]) -> tuple[T, float]:
        """What it makes, and its CPU seconds, which are noted as by :meth:`cost`."""
        start = time.process_time()
        made = make()
        seconds = time.process_time() - start
        self._now[part] = self._now.get(part, 0.0) + seconds
        return made, seconds

    def array(self, name: str, part: str, make: Callable[[], F32], maker: Maker = "scenes", of: object = None) -> F32:
        """The array of that name, made unless it is there.

        Args:
            name: of what it is.
            part: of the protocol that it belongs to.
            make: makes it.
            maker: whose code makes it; after a change there it is made again.
            of: what it is made from, where its name does not say all.
        """

        def write(path: Path) -> None:
            np.save(path, self.cost(part, make))

        return np.asarray(np.load(self._kept(name, ".npy", maker, of, write)))

    def mesh(self, name: str, part: str, make: Callable[[], ProxyMesh], maker: Maker = "proxies") -> ProxyMesh:
        """Vertices, faces and mirrors of the mesh of that name, made unless it is there."""

        def pack() -> F32:
            made = make()  # as floats: 2 ** 24 vertices at most
            mirrors = np.flatnonzero(np.zeros(0) if made.mirrors is None else made.mirrors)
            head = [len(made.vertices), len(made.faces), 0]
            marked = np.repeat(mirrors[:, None], 3, axis=1)
            return np.concatenate([[head], made.vertices, made.faces, marked]).astype(np.float32)

        rows = self.array(name, part, pack, maker)
        vertices, faces, mirrors = np.split(rows[1:], np.cumsum(rows[0, :2]).astype(np.int64))
        made = ProxyMesh(vertices=vertices, faces=faces.astype(np.int32))
        return made.with_mirrors(np.isin(np.arange(len(faces)), mirrors[:, 0]))

    def table(self, name: str, make: Callable[[], list[dict[str, Any]]], of: object) -> list[dict[str, Any]]:
        """Rows of plain values, as `array`."""

        def write(path: Path) -> None:
            path.write_text(json.dumps(make()), encoding="utf-8")

        path = self._kept(name, ".rows", "rows", of, write)
        return list(json.loads(path.read_text(encoding="utf-8")))

    def _kept(self, name: str, ending: str, maker: Maker, of: object, write: Callable[[Path], None]) -> Path:
        """Where it is kept, made unless it is there."""
        content = f".{digest(of)[:12]}" if of is not None else ""
        path = self._folder / self._code[maker] / f"{name.replace(' ', '-')}{content}{ending}"
        costs = path.with_name(f"{path.name}.json")
        path.parent.mkdir(parents=True, exist_ok=True)
        with _alone(path):
            if not path.is_file():
                outer, self._now = self._now, {}
                fresh = path.with_name(f"{path.stem}.part{ending}")
                write(fresh)
                costs.write_text(json.dumps(self._now), encoding="utf-8")
                fresh.rename(path)
                self._now = outer
        self.costs[str(path)] = json.loads(costs.read_text(encoding="utf-8"))
        return path


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Others that want the same thing wait."""
    with path.with_name(f"{path.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _digest(sources: Iterable[str]) -> str:
    there = [ROOT / source for source in sources]
    files = [f for x in there for f in ([*x.rglob("*.py"), *x.rglob("*.cpp")] if x.is_dir() else [x])]
    return hashlib.sha256(b"".join(x.read_bytes() for x in sorted(files))).hexdigest()[:12]
