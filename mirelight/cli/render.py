"""`mirelight render`: load the job, make the frames that are missing, write each as soon as it is there."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mirelight.base.errors import InputError, MirelightError
from mirelight.batch import Order, Shard, executor, processes, scheduler
from mirelight.batch.forecast import Forecast, forecast
from mirelight.batch.preview import Previews
from mirelight.cli import export, new, progress, say, stop
from mirelight.cli.codes import BAD, DONE
from mirelight.cli.options import count_of, order_of
from mirelight.cli.report import size
from mirelight.model import Job
from mirelight.model.shown import count
from mirelight.pipeline.completeness import check
from mirelight.pipeline.plan import light_keys, warnings
from mirelight.store import Store
from mirelight.store.planned import CAPTURE


def run_render(args: argparse.Namespace) -> int:
    """The command. Progress goes to stderr, one line or JSON at the end to stdout."""
    tally = progress.chosen(args.quiet)
    store: Store | None = None
    order = order_of(args)
    sets: list[str] = []
    shard = None if args.shard is None else Shard.parse(args.shard)
    workers = _workers(args)
    try:
        with tally:
            work = _load(args, order, tally)
            whole = order.plan(work)
            _check(work)
            frames = whole if shard is None else shard.of(whole)
            for line in warnings(frames):
                tally.note(f"mirelight: {line}")
            if args.dry_run:
                with stop.Watched(tally) as watched:
                    found = forecast(frames, watched)
                _say_forecast(found, args.json)
                return DONE
            store = Store(work)
            store.open()
            every = order.cameras is None and order.lightings is None
            store.planned.keep(whole, [*order.anywhere().arguments()[1:], *_without_job(args)], whole=every)
            with stop.Watched(tally) as watched:
                if args.scheduler is not None:
                    scheduler.run(order, frames, store, args.scheduler, watched)
                elif workers is not None:
                    processes.run(order, frames, store, workers, watched)
                else:
                    executor.run(frames, store, watched, Previews(store, watched) if args.preview else None)
            store.tidy(light_keys(whole))
        if not tally.failures:
            sets = export.at_end(work, store, args.quiet)
    except BaseException as e:
        code = stop.exit_code(e)
        if code is None:
            if store is not None and isinstance(e, MirelightError):
                store.withdraw()
            raise
        _say_what_is_left(tally, store)
        return code
    finally:
        if store is not None:
            store.close()
    return _ended(args, tally, store, sets)


def _without_job(args: argparse.Namespace) -> list[str]:
    """What was rendered in place of a job file, for who looks at the folder later."""
    light = [] if args.light is None else [f"--light={args.light}"]
    return [*light, f"{CAPTURE}{Path(args.job).absolute()}"] if new.is_capture(args.job) else light


def _workers(args: argparse.Namespace) -> int | None:
    """How many processes; also that no two ways of rendering are asked for."""
    workers = count_of(args.workers, "--workers")
    if args.scheduler is not None:
        if workers is not None:
            raise InputError("--workers", "given together with --scheduler", "a scheduler's workers are started apart")
        scheduler.require()
    if args.preview and (workers is not None or args.scheduler is not None):
        other = "--workers" if workers is not None else "--scheduler"
        raise InputError("--preview", f"given together with {other}", "leave one of them out")
    return workers


def _check(work: Job) -> None:
    check(work)
    if work.dataset.layouts:
        from mirelight.dataset import export as sets_of  # loads SciPy

        sets_of.check(work)


def _ended(args: argparse.Namespace, tally: progress.Tally, store: Store, sets: Sequence[str]) -> int:
    """Says what is there and what is not; the exit code."""
    failed = [{"frame": frame, "error": error} for frame, error in tally.failures]
    there = {"folder": store.folder, "frames": tally.there, "skipped": tally.skipped}
    existed = f", {tally.skipped} of them already there" if tally.skipped else ""
    said = f"{_frames(tally.there)} in {_shown(store.folder)}{existed}; {progress.duration(tally.elapsed)}"
    made = {**there, "seconds": round(tally.elapsed, 3), "failed": failed, "notes": list(sets)}
    say.outcome(args, made, [said, *sets])
    if failed:
        say.remark(f"{_frames(len(failed))} failed; the others are there; the same command tries them again")
        return BAD
    return DONE


def _say_forecast(found: Forecast, as_json: bool) -> None:
    if as_json:
        say.as_json(found)
        return
    views = f"{count(found.cameras, 'camera')}, {count(found.lightings, 'lighting')}"
    traces = f"{count(found.traces, 'trace')} of unit lights"
    say.result(f"{_frames(found.frames)} ({views}), {found.there} of them there")
    say.result(f"{traces}; about {progress.duration(found.seconds)} on this machine as it is now")
    if found.fills is not None:
        fills = count(found.fills, "fill")
        say.result(f"{fills} of the surface, for any light; light of {found.gathered} sources to gather on it")
    say.result(f"about {found.bytes / 1e6:,.1f} MB of new files, {size(found.memory)} of memory")
    for line in found.remarks:
        say.result(line)


def _load(args: argparse.Namespace, order: Order, tally: progress.Tally) -> Job:
    light = "" if args.light is None and new.is_stage(args.job) else args.light
    if light is None:
        new.refuse_capture(args.job)
        return order.load()
    if not new.is_capture(args.job):
        raise InputError(args.job, "a job together with --light", "change its lights, or name a splat file")
    for option, value in (("--workers", args.workers), ("--scheduler", args.scheduler)):
        if value is not None:
            raise InputError(args.job, f"a splat file together with {option}", "write a job file first: mirelight new")
    tally.note("mirelight: looking at the capture")
    heard = tally.making
    work = new.first_job(args.job, light, order.overrides(), lambda line: tally.note(f"mirelight: {line}"), heard)
    if args.out is None:
        return work
    return replace(work, output=replace(work.output, directory=Path(args.out).absolute()))


def _say_what_is_left(tally: progress.Tally, store: Store | None) -> None:
    line = "interrupted before the first frame"
    if store is not None and tally.total:
        done = f"{tally.there} of {_frames(tally.total)} are in {_shown(store.folder)}"
        line = f"interrupted; {done}, and the same command goes on from there"
        if store.partial:
            paths = ", ".join(_shown(path) for path in store.partial)
            say.remark(f"the frame in progress, as far as it got: {paths}")
    say.remark(line)


def _frames(count: int) -> str:
    return f"{count} frame" if count == 1 else f"{count} frames"


def _shown(path: Path) -> str:
    """The path as the user would name it from here."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)
