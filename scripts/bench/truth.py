"""How close relit frames come to path-traced truth: proxies, captured light, indirect light, samples, denoising.

A fixed protocol: seven captures (a courtyard from two sides under a soft sun, and from all round under a hard one and a
soft one, a stage between soft boxes, a room with the sun through its windows and under clouds,
a room with a patch of sun past white), three new lightings
each, one camera each that no splat was made from. Every frame is made by mirelight's own calls in mode `ratio` with
the splats' colours on the proxy.

    python scripts/bench truth [--more] [--only NAME] [--rows FILE] [--pictures DIR] [--cache DIR] [--processes N]

Captures run side by side. What is made is kept in the cache folder (out/bench_truth), under digests of what it is made
from: a run that was stopped goes on where it was. Needs the extras `scenes`, `denoise`, `compare`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from bench.common import Table, path
from bench.truth_captures import NAMES, QUICK, WHOLE, Size, capture
from bench.truth_rows import Bench, Row
from bench.truth_store import ROOT, Store
from bench.truth_tables import tables

FULL = Size(96, 54, truth_spp=256)
SMALL = Size(96, 54, truth_spp=64, most=1)

OTHER_LIGHT = (
    "courtyard, walked round, soft sun",
    "interior, clouds",
    "sunroom, sun",
)  # captures that no goal is set for
GOALS = tuple(name for name in NAMES if name not in OTHER_LIGHT)

Costs = dict[str, dict[str, float]]  # CPU seconds by kept thing and part of the protocol


def rows_of(
    name: str, start: float, cache: Path, pictures: Path | None, quick: bool, more: bool
) -> tuple[list[Row], Costs]:
    """All rows of a capture, and what it and all that it uses has cost; lines to standard error meanwhile.

    Args:
        name: the capture's.
        start: of the run, by `time.monotonic`, which all processes share.
        cache: folder of kept things.
        pictures: folder for pictures; None: none.
        quick: as the option.
        more: as the option.
    """

    def say(text: str) -> None:
        print(f"{time.monotonic() - start:6.0f} s  {text}", file=sys.stderr, flush=True)

    store = Store(cache)
    made = capture(name, SMALL if quick else FULL, store, say)
    rows = list(Bench(made, store, say, pictures, more).rows(quick))
    say(f"{name}: done, {time.process_time():.0f} CPU s in this process so far")
    return rows, store.costs


def relight(names: Sequence[str], chosen: argparse.Namespace, start: float) -> tuple[list[Row], Costs]:
    """All rows, in the order of the names; the captures with the most rows are begun first."""
    work = partial(
        rows_of, start=start, cache=chosen.cache, pictures=chosen.pictures, quick=chosen.quick, more=chosen.more
    )
    rows: dict[str, list[Row]] = {}
    costs: Costs = {}
    with ProcessPoolExecutor(chosen.processes, mp_context=get_context("spawn")) as pool:
        waiting = {name: pool.submit(work, name) for name in sorted(names, key=lambda x: x not in WHOLE)}
        for name in names:
            rows[name], own = waiting[name].result()
            costs |= own
            if chosen.rows is not None:
                found = [_plain(row) for made in rows.values() for row in made]
                chosen.rows.write_text(json.dumps(found, indent=1, allow_nan=False), encoding="utf-8")
    return [row for name in names for row in rows[name]], costs


def _plain(row: Row) -> dict[str, object]:
    """A row as JSON has it, which knows no NaN."""
    return {name: None if value != value else value for name, value in asdict(row).items()}


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--more", action="store_true", help="captures and rows that no goal is set for, too")
    parser.add_argument("--rows", type=path, metavar="FILE", help="write all rows there as they come, as JSON")
    parser.add_argument("--pictures", type=path, help="captured | x factor | frame | truth, of every frame made anew")
    parser.add_argument("--cache", type=path, default=ROOT / "out" / "bench_truth", help="where things are kept")
    parser.add_argument("--only", default="", help="captures whose name holds this")
    parser.add_argument("--processes", type=int, default=min(os.cpu_count() or 1, 2), help="captures at the same time")


def run(chosen: argparse.Namespace) -> list[Table]:
    """The protocol's tables."""
    start = time.monotonic()
    tried = QUICK if chosen.quick else NAMES if chosen.more or chosen.only else GOALS
    names = [name for name in tried if chosen.only in name]
    if not names:
        sys.exit(f"--only {chosen.only}: no capture's name holds this; there are: {'; '.join(tried)}")
    if chosen.rows is not None and not chosen.rows.parent.is_dir():
        sys.exit(f"--rows {chosen.rows}: the folder does not exist")
    rows, costs = relight(names, chosen, start)
    spent: dict[str, float] = {}
    for parts in costs.values():
        for part, seconds in parts.items():
            spent[part] = spent.get(part, 0.0) + seconds
    print(f"{time.monotonic() - start:.0f} s by the clock for what was not kept", file=sys.stderr)
    return tables(rows, spent)
