"""Runs cases under limits of time and memory, and says of each what became of it."""

from __future__ import annotations

import json
import os
import re
import select
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from tests.fuzzing.case import CANARY, Case

GOOD = ("ok", "refused")
BAD = ("traceback", "crash", "hang", "memory", "output", "escape", "silent", "wrong", "control", "noisy", "unclear")
SECONDS = 20.0  # of processor time; six times as much by the clock, less what it waited for a processor
MEMORY = 1 << 30  # bytes beyond what the process had before the case
OUTPUT = 1 << 28  # bytes in the case's folder
_BAIT = ("/etc/passwd", "/etc/hostname", "/dev/zero", "/usr")  # names that cases hold
_OF_PYTHON = re.compile(r"[a-z]Error: |Exception: ")
_NOISE = re.compile(r"Warning|warn\(|Exception ignored|^\s+File \"", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a case: one of GOOD or BAD, and why."""

    case: str
    kind: str
    detail: str
    seconds: float
    memory: int  # bytes that it took at most


class Worker:
    """A process that runs cases; it is ended and started anew where one does not come back."""

    def __init__(self, cache: str = "") -> None:
        self._cache = cache  # folder of what mirelight keeps for every command
        self._process: subprocess.Popen[bytes] | None = None
        self._answers = -1

    def run(self, case: Case, folder: Path, said: Path) -> tuple[dict[str, Any] | None, str, float, int]:
        """The answer, or None and why there is none; seconds and bytes taken."""
        process = self._started()
        before = _memory(process.pid, "VmRSS")
        Path(f"/proc/{process.pid}/clear_refs").write_text("5", encoding="ascii")  # forgets the highest mark so far
        began, spent, waited = monotonic(), _seconds(process.pid), _waited(process.pid)
        assert process.stdin is not None
        task = {"folder": str(folder), "arguments": list(case.arguments), "said": str(said), "streams": case.streams}
        process.stdin.write(json.dumps(task).encode() + b"\n")
        process.stdin.flush()
        why = ""
        while not why:
            ready, _, _ = select.select([self._answers], [], [], 0.02)
            took = max(_memory(process.pid, "VmHWM") - before, 0)
            if ready:
                line = self._line()
                if line:
                    return json.loads(line), "", monotonic() - began, took
                why = "crash"
            elif took > MEMORY:
                why = "memory"
            else:
                own = monotonic() - began - (_waited(process.pid) - waited)
                late = own > min(6 * SECONDS, case.seconds)
                why = "hang" if _seconds(process.pid) - spent > SECONDS or late else ""
        self.close()
        return None, why, monotonic() - began, took

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            os.close(self._answers)
            self._process = None

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None:
            self._answers, theirs = os.pipe()
            root = str(Path(__file__).parents[2])
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tests.fuzzing.worker", str(theirs)],
                stdin=subprocess.PIPE,
                pass_fds=[theirs],
                env={**os.environ, "PYTHONPATH": root, "OMP_NUM_THREADS": "1", "MIRELIGHT_CACHE_DIR": self._cache},
            )
            os.close(theirs)
            self._line()
        return self._process

    def _line(self) -> bytes:
        out = b""
        while not out.endswith(b"\n"):
            piece = os.read(self._answers, 1 << 16)
            if not piece:
                return b""
            out += piece
        return out


def run(cases: Iterable[Case]) -> Iterator[Verdict]:
    """Each case in a folder of its own beside files that it must not touch."""
    with _worker() as worker, tempfile.TemporaryDirectory(prefix="hostile-") as name:
        root = Path(name).resolve()
        for case in cases:
            for part in ("case", "said", "outside"):
                shutil.rmtree(root / part, ignore_errors=True)
                (root / part).mkdir()
            (root / "outside" / "canary.png").write_bytes(CANARY)
            case.build(root / "case")
            before = {path: path.lstat().st_mtime_ns for path in (root / "case").rglob("*")}
            answer, why, seconds, memory = worker.run(case, root / "case", root / "said")
            kind, detail = _judged(case, root, answer, before) if answer is not None else (why, "")
            yield Verdict(case.name, kind, detail, seconds, memory)


@contextmanager
def _worker() -> Iterator[Worker]:
    with tempfile.TemporaryDirectory(prefix="hostile-cache-") as cache:
        worker = Worker(cache)
        try:
            yield worker
        finally:
            worker.close()


def _judged(case: Case, root: Path, answer: dict[str, Any], before: dict[Path, int]) -> tuple[str, str]:
    values = (x.partition("=")[2] for x in case.arguments)
    beside = (f"{stem}." for x in case.arguments if (stem := Path(x).stem))  # of FILE.toml there is a FILE.exr
    names = frozenset((*case.arguments, *values, *beside, *(x.name for x in before)))
    said = [(root / "said" / name).read_bytes() for name in ("stdout", "stderr")]
    stderr = said[1].decode("utf-8", "backslashreplace")
    if answer["raised"] or "Traceback (most recent" in stderr:
        return "traceback", answer["raised"] or stderr
    touched = [x for x in _escapes(root, answer["opened"]) if not _of_the_job(root / "case", case, x)]
    if touched:
        return "escape", ", ".join(touched)
    for text in said:
        shown = text.decode("utf-8", "backslashreplace").replace("\n", "").replace("\t", "")
        if not shown.isprintable():
            return "control", ascii(shown[:500])
    if _NOISE.search(stderr):
        return "noisy", stderr
    if sum(x.lstat().st_size for x in (root / "case").rglob("*.partial*")) > OUTPUT:
        return "output", "too much was written"
    wrong = case.after(root / "case") if case.after is not None else ""
    if wrong:
        return "wrong", wrong
    if case.codes and answer["code"] not in case.codes:
        return "wrong", f"exit {answer['code']}, expected {case.codes}; {stderr}"
    if answer["code"] == 0:
        silent = _silent(root / "case", before, case.bright)
        return ("silent", silent) if silent else ("ok", "")
    if answer["code"] == 2:
        lines = stderr.splitlines()
        clear = all(map(_is_ours, lines)) and bool(lines) and _names_a_file(lines[-1], names)
        mute = case.streams in ("closed", "unread")  # nobody hears, or nobody wants to
        return ("refused", stderr) if clear or mute else ("unclear", stderr)
    own = {"compare": (1,), "status": (1, 3), "verify": (1,)}.get(case.arguments[0], ())
    return ("ok", "") if answer["code"] in own else ("crash", f"exit {answer['code']}")


def _is_ours(line: str) -> bool:
    """Progress, or a line that says who speaks, and not what Python calls the trouble."""
    return line.startswith("[") or (line.startswith("mirelight: ") and _OF_PYTHON.search(line) is None)


def _names_a_file(line: str, names: frozenset[str]) -> bool:
    """A message starts with the program and what it is about: a file, a folder, or an option as it was written."""
    from mirelight.base.errors import printable

    written = (printable(name) for name in names if name)
    others = "--", "job.toml", "/case/", ": stdout: ", " frame failed; ", " frames failed; "
    return any(name in line for name in (*written, *_BAIT, *others))


def _escapes(root: Path, opened: list[str]) -> list[str]:
    case, own = str(root / "case"), (str(root / "said"),)
    out = []
    for name in opened:
        path = os.path.realpath(os.path.join(case, name))  # noqa: PTH118 (a pure join: the name may hold anything)
        if path in _BAIT or (path.startswith(str(root)) and not path.startswith((case, *own))):
            out.append(name)
    if (root / "outside" / "canary.png").read_bytes() != CANARY or len(list((root / "outside").iterdir())) != 1:
        out.append("outside was written to")
    return out


def _of_the_job(folder: Path, case: Case, name: str) -> bool:
    """Whether the job, or the command itself, names what was opened: those may lead anywhere."""
    job = folder / "job.toml"
    text = job.read_bytes() if job.is_file() and job.stat().st_size < 1 << 24 else b""
    asked = " ".join(case.arguments) + text.decode("utf-8", "replace")
    return name.removeprefix(f"{folder}/") in asked


def _silent(folder: Path, before: dict[Path, int], bright: bool) -> str:
    """What is wrong with finished files: values that are not finite, or black where light was given."""
    from mirelight.io import splats
    from mirelight.io.exr import read_exr

    for path in sorted(x for x in folder.rglob("*.*") if x.is_file() and before.get(x) != x.stat().st_mtime_ns):
        if path.suffix == ".exr":
            image = read_exr(path)
            for name, plane in image.channels.items():
                if name != "depth.Z" and not name.startswith(("position", "splat_")) and not np.all(np.isfinite(plane)):
                    return f"{path.name}: {name} is not finite"
            if bright and not float(np.max(image.layer("")[..., :3])) > 0:
                return "black"
        elif path.suffix == ".ply" and path.name.startswith("baked"):
            cloud = splats.read(path)
            if not all(np.all(np.isfinite(x)) for x in (cloud.means, cloud.scales, cloud.opacities, cloud.sh)):
                return f"{path.name} is not finite"
        elif path.suffix == ".json":
            json.loads(path.read_bytes(), parse_constant=_refuse)
    return ""


def _refuse(name: str) -> None:
    raise ValueError(f"{name} in JSON")


def _seconds(pid: int) -> float:
    """Processor time of a process so far."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _waited(pid: int) -> float:
    """Seconds that the main thread of a process was ready and others ran."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii").split()[1]) / 1e9
    except (OSError, IndexError, ValueError):  # a kernel that does not count it
        return 0.0


def _memory(pid: int, field: str) -> int:
    try:
        text = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    except OSError:
        return 0
    found = re.search(rf"{field}:\s+(\d+) kB", text)
    return int(found[1]) * 1024 if found else 0
