"""Kills renders at random moments and takes them up again: python -m tests.cli.kill_runs [--runs 30] [--seed 1]

Each run renders 24 frames (12 cameras, 2 lightings) with two worker processes into a folder of its own. A worker, the
parent, or both get SIGKILL, once or twice, while they start, prepare, trace or write; then the same command makes the
rest. Held against an undisturbed run of one process: every file's bytes; how often each frame was made; what is left in
the folder. Exit code 1 where anything differs.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from .ball import write_ball

COMMAND = [sys.executable, "-m", "mirelight", "render", "job.toml", "--workers", "2"]
FRAMES = 24
VICTIMS = ("worker", "parent", "both")
JOB = """\
splats = "splats.ply"
proxy = "proxy.glb"
resolution = [32, 24]

[[cameras]]
type = "turntable"
name = "orbit"
target = [0, 0, 0]
radius = 6
frames = 12

[[lightings]]
name = "day"
environment = { radiance = 1 }

[[lightings]]
name = "night"
lights_from = "proxy"

[render]
spp = 2
"""


@dataclass
class Tally:
    """What all runs came to."""

    runs: int = 0
    kills: Counter[str] = field(default_factory=Counter)
    other_bits: int = 0
    missing: int = 0
    in_flight: int = 0  # frames that processes were at when they were killed, at most
    made_twice: int = 0
    left_over: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    @property
    def sound(self) -> bool:
        """Whether nothing was lost, changed or left."""
        wrong = self.other_bits or self.missing or self.left_over or self.failed
        return not wrong and self.made_twice <= self.in_flight

    def __str__(self) -> str:
        kills = ", ".join(f"{self.kills[x]} of {x}" for x in VICTIMS)
        return (
            f"{self.runs} runs of {FRAMES} frames, {sum(self.kills.values())} kills ({kills}): "
            f"{self.missing} frames missing, {self.other_bits} files with other bits, "
            f"{self.made_twice} frames made twice ({self.in_flight} were in flight at most), "
            f"{len(self.left_over)} files left over, {len(self.failed)} runs failed"
        )


def scene(folder: Path) -> None:
    """A ball of splats over a floor with a lamp, and the job."""
    write_ball(folder)
    (folder / "job.toml").write_text(JOB, encoding="utf-8")


def render(folder: Path, out: str, errors: Path) -> subprocess.Popen[bytes]:
    """Start a render whose stderr goes to a file."""
    with errors.open("ab") as file:
        return subprocess.Popen([*COMMAND, "--out", out], cwd=folder, stdout=subprocess.DEVNULL, stderr=file)


def workers(parent: int) -> list[int]:
    """Numbers of the worker processes of a render."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            its = int(entry.joinpath("stat").read_text().rpartition(")")[2].split()[1])
            command = entry.joinpath("cmdline").read_bytes()
        except (OSError, ValueError):
            continue
        if its == parent and b"mirelight.batch.worker" in command:
            found.append(int(entry.name))
    return found


def made(out: Path) -> list[str]:
    """Names of the frames that were written, as often as they were."""
    lines = [x for file in (out / ".mirelight" / "journal").glob("*.jsonl") for x in file.read_bytes().splitlines()]
    names = []
    for line in lines:
        try:
            names.append(str(json.loads(line)["frame"]))
        except ValueError:
            continue  # torn by a kill
    return names


def disturb(folder: Path, out: str, victim: str, chance: random.Random, tally: Tally) -> None:
    """Start a render and kill it at a random moment: before a frame is made, or some time behind one of them."""
    errors = folder / f"{out}.log"
    process = render(folder, out, errors)
    after, late = chance.randrange(FRAMES), chance.uniform(0, 0.4)
    began = time.monotonic()
    wait = chance.uniform(0, 4)
    while process.poll() is None:
        if time.monotonic() - began >= wait and after == 0:
            break
        if after and len(made(folder / out)) >= after:
            time.sleep(late)
            break
        time.sleep(0.02)
    there = workers(process.pid)
    if victim != "parent" and there:
        os.kill(chance.choice(there), signal.SIGKILL)
        tally.in_flight += 1
    if victim != "worker" and process.poll() is None:
        process.kill()
        tally.in_flight += len(there)
    tally.kills[victim] += 1
    process.wait()
    until = time.monotonic() + 90
    while any(Path(f"/proc/{x}/exe").exists() for x in there) and time.monotonic() < until:
        time.sleep(0.05)  # workers without a parent end after their step
    if process.returncode not in (0, -signal.SIGKILL):
        tally.failed.append(f"{out}: exit code {process.returncode} with a killed {victim}; see {errors}")


def compare(whole: Path, parts: Path, tally: Tally) -> None:
    """Hold a folder against that of the undisturbed run."""
    for path in sorted(whole.glob("[!.]*.*")):
        other = parts / path.name
        if not other.exists():
            tally.missing += 1
        elif other.read_bytes() != path.read_bytes():
            tally.other_bits += 1
    extra = {x.name for x in parts.glob("[!.]*.*")} - {x.name for x in whole.glob("[!.]*.*")}
    hidden = [x.name for x in parts.rglob(".*") if x.is_file()]
    claims = [x.name for x in (parts / ".mirelight" / "claims").iterdir()]
    tally.left_over += [*extra, *hidden, *claims]
    names = made(parts)
    tally.made_twice += len(names) - len(set(names))


def campaign(folder: Path, runs: int, seed: int) -> Tally:
    """All runs, in a folder of their own."""
    chance, tally = random.Random(seed), Tally()
    scene(folder)
    subprocess.run([*COMMAND[:-2], "--out", "whole", "-q"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    for number in range(runs):
        out = f"run{number}"
        victims = [VICTIMS[number % 3], *chance.sample(VICTIMS, chance.randrange(2))]
        for victim in victims:
            disturb(folder, out, victim, chance, tally)
        last = render(folder, out, folder / f"{out}.log")
        if last.wait(timeout=600) != 0:
            tally.failed.append(f"{out}: exit code {last.returncode} at the end")
        compare(folder / "whole", folder / out, tally)
        tally.runs += 1
        print(f"run {number + 1}: {' and '.join(victims)} killed; so far {tally}", flush=True)
    return tally


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tally = campaign(Path(folder), args.runs, args.seed)
    print(tally)
    for line in (*tally.failed, *tally.left_over):
        print(line)
    return 0 if tally.sound else 1


if __name__ == "__main__":
    sys.exit(main())
