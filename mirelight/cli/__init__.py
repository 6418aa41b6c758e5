"""The command line. Only argparse is loaded before a command is known, so that help is instant."""

from __future__ import annotations

import argparse
import contextlib
import gc
import io
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import NoReturn

from mirelight.base.errors import MirelightError, RenderError, printable
from mirelight.base.version import __version__

BAD = 2  # exit code of expected trouble: bad input, no backend, a full disk
INTERRUPTED = 130  # 128 + SIGINT, as shells have it
TERMINATED = 143  # 128 + SIGTERM


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the return value is the exit code (0, 2, or 130 and 143 where it was stopped)."""
    _prepare_streams()
    parser = make_parser()
    args = parser.parse_args(arguments)
    if args.command is None:
        parser.print_help()
        return BAD
    try:
        with _in_order():
            code = _run(args)
        return code if _flushed() else BAD
    except RenderError as e:  # raised where only arrays are known
        _say(f"{_subject(args)}: {e}")
        return BAD
    except MirelightError as e:
        for line in str(e).splitlines():
            _say(line)
        return BAD
    except KeyboardInterrupt:
        _say("interrupted")
        return INTERRUPTED
    except MemoryError:
        _say(f"{_subject(args)}: out of memory; use a smaller resolution or fewer splats, or a machine with more")
        return BAD
    except OSError as e:
        if e.filename is None:  # files are read and written by name; what has none is a stream
            _close_stdout(e)
        else:
            _say(f"{e.filename}: {e.strerror or e}")
        return BAD


def _prepare_streams() -> None:
    """Output that can always be written: characters that the stream's encoding lacks become escapes.

    A stream that the caller has closed is replaced by the null device, so that no file that is opened later gets its
    number, and with it what libraries print.
    """
    for number, mode in ((0, os.O_RDONLY), (1, os.O_WRONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)  # the lowest free number, this one
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # as Python starts where the stream is closed
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 (until the process ends)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _flushed() -> bool:
    """Whether all that was printed has reached stdout; says so where it has not, and prints no more there."""
    try:
        sys.stdout.flush()
    except OSError as e:
        _close_stdout(e)
        return False
    return True


def _close_stdout(error: OSError) -> None:
    """Print no more there. The reader of a pipe may go when it likes, as `| head` does; all else is said."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    if not isinstance(error, BrokenPipeError):
        _say(f"stdout: cannot be written ({error.strerror or error})")


def _subject(args: argparse.Namespace) -> str:
    """The file that a command is about."""
    for name in ("job", "file", "capture", "folder", "paths"):
        found = getattr(args, name, None)
        if found:
            return str(found if isinstance(found, str) else found[0])
    return str(args.command)


def _say(line: str) -> None:
    with contextlib.suppress(OSError):
        print(f"mirelight: {printable(line)}", file=sys.stderr)


@contextlib.contextmanager
def _in_order() -> Iterator[None]:
    """SIGTERM ends the block in order, so that no temporary file is left; after it the process is as it was."""
    thresholds = gc.get_threshold()
    gc.set_threshold(100_000, 20, 100)  # plans of many frames hold a million objects and no cycles
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before or signal.SIG_DFL)
        gc.set_threshold(*thresholds)


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(TERMINATED)


def _run(args: argparse.Namespace) -> int:
    match args.command:
        case "new":
            from mirelight.cli.new import run_new

            return run_new(args)
        case "render":
            from mirelight.cli.render import run_render

            return run_render(args)
        case "submit":
            from mirelight.cli.submit import run_submit

            return run_submit(args)
        case "status":
            from mirelight.cli.status import run_status

            return run_status(args)
        case "verify":
            from mirelight.cli.verify import run_verify

            return run_verify(args)
        case "inspect":
            from mirelight.cli.inspect import run_inspect

            return run_inspect(args)
        case "compare":
            from mirelight.cli.compare import run_compare

            return run_compare(args)
        case "realtime":
            from mirelight.cli.realtime import run_realtime

            return run_realtime(args)
        case "mix":
            from mirelight.cli.mix import run_mix

            return run_mix(args)
        case "explain":
            from mirelight.cli.explain import run_explain

            return run_explain(args)
        case "proxy":
            from mirelight.cli.proxy import run_proxy

            return run_proxy(args)
        case "estimate":
            from mirelight.cli.estimate import run_estimate

            return run_estimate(args)
        case "export":
            from mirelight.cli.export import run_export

            return run_export(args)
        case "sheet":
            from mirelight.cli.sheet import run_sheet

            return run_sheet(args)
        case "film":
            from mirelight.cli.film import run_film

            return run_film(args)
        case "watch":
            from mirelight.cli.watch import run_watch

            return run_watch(args)
        case "bake":
            from mirelight.cli.bake import run_bake

            return run_bake(args)
        case "match":
            from mirelight.cli.match import run_match

            return run_match(args)
        case "cache":
            from mirelight.cli.cache import run_cache

            return run_cache(args)
        case "schema":
            from mirelight.cli.report import print_json
            from mirelight.io.job import json_schema

            print_json(json_schema())
            return 0
        case _:
            from mirelight.apps import doctor

            return doctor.run()


class _Parser(argparse.ArgumentParser):
    """Says what is wrong with arguments in one line, like all else that is wrong."""

    def error(self, message: str) -> NoReturn:
        command = self.prog.removeprefix("mirelight").strip()
        _say(f"{command}{': ' if command else ''}{message}; {self.prog} --help says more")
        sys.exit(BAD)


def make_parser() -> argparse.ArgumentParser:
    """Of every command, without importing what it runs."""
    parser: argparse.ArgumentParser = _Parser(
        prog="mirelight",
        description="Offline, physically based relighting of Gaussian-splat captures.",
        epilog="Exit codes: 0 done; 1 a requirement of compare is unmet, or status or verify finds something; 2 bad "
        "input or no way to go on (one line says why); 130 interrupted.",
    )
    parser.add_argument("--version", action="version", version=f"mirelight {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")

    from mirelight.cli.new import add_new

    add_new(commands)
    render = commands.add_parser(
        "render",
        help="render the frames of a job file",
        description="Render every camera of a job under every lighting. Frames that exist with unchanged inputs are "
        "skipped, so an interrupted run goes on when it is started again.",
    )
    render.add_argument("job", metavar="JOB", help="job file (TOML), or a splat file together with --light")
    render.add_argument("--light", metavar="LIGHT", help="of a splat file: sun, point, or a file (.hdr, .exr, .glb)")
    _add_order(render, "--out")
    render.add_argument("--workers", metavar="N", help="render with N processes of this machine")
    render.add_argument("--scheduler", metavar="ADDRESS", help="render with the workers of a Dask scheduler")
    render.add_argument("--shard", metavar="I/N", help="only the I-th of N parts of the cameras")
    render.add_argument("-q", "--quiet", action="store_true", help="say nothing but errors")
    render.add_argument("--preview", action="store_true", help="show every frame as NAME.preview.png until it is there")
    render.add_argument("--dry-run", action="store_true", help="say what it would take, and make nothing")

    watch = commands.add_parser(
        "watch",
        help="render a job again whenever it is saved",
        description="Show what a saved change of the job or of its files touches by quick pictures, then render it; "
        "until Ctrl-C.",
    )
    watch.add_argument("job", metavar="JOB", help="job file (TOML)")
    _add_order(watch, "--out")

    submit = commands.add_parser(
        "submit",
        help="print a script that renders a job on a batch system",
        description="Print a Slurm array script or an Open Job Description template whose tasks render parts of a job.",
    )
    submit.add_argument("job", metavar="JOB", help="job file (TOML)")
    kind = submit.add_mutually_exclusive_group(required=True)
    kind.add_argument("--slurm", action="store_true", help="a script for sbatch")
    kind.add_argument("--openjd", action="store_true", help="an Open Job Description template")
    submit.add_argument("--shards", metavar="N", default="8", help="into how many tasks (8)")
    submit.add_argument("-o", "--file", metavar="FILE", help="write the script there, not to stdout")
    _add_order(submit)

    from mirelight.cli.bake import add_bake
    from mirelight.cli.cache import add_cache
    from mirelight.cli.compare import add_compare
    from mirelight.cli.estimate import add_estimate
    from mirelight.cli.explain import add_explain
    from mirelight.cli.export import add_export
    from mirelight.cli.film import add_film
    from mirelight.cli.inspect import add_inspect
    from mirelight.cli.match import add_match
    from mirelight.cli.mix import add_mix
    from mirelight.cli.proxy import add_proxy
    from mirelight.cli.realtime import add_realtime
    from mirelight.cli.sheet import add_sheet
    from mirelight.cli.status import add_status
    from mirelight.cli.verify import add_verify

    add_inspect(commands)
    add_status(commands)
    add_verify(commands)
    add_compare(commands)
    add_realtime(commands)
    add_mix(commands)
    add_explain(commands)
    add_proxy(commands)
    add_estimate(commands)
    add_export(commands)
    add_match(commands)
    add_bake(commands)
    add_sheet(commands)
    add_film(commands)
    add_cache(commands)
    commands.add_parser("schema", help="print the JSON Schema of job files")
    commands.add_parser("doctor", help="say what this machine has, and whether a small render passes")
    return parser


def _add_order(parser: argparse.ArgumentParser, *names: str) -> None:
    """What chooses frames and settings; `names`: options that have a short form here."""
    short = ("-o",) if names else ()
    parser.add_argument(
        "--camera", metavar="NAME", nargs="+", action="extend", help="only these cameras (* and ? work)"
    )
    parser.add_argument("--lighting", metavar="NAME", nargs="+", action="extend", help="only these lightings")
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="lay a setting over the job file: render.spp=256, lights[0].intensity=3 (may be given again)",
    )
    parser.add_argument(*short, "--out", metavar="DIR", help="write there, relative to the current folder")
    parser.add_argument("--variant", help="Mitsuba variant: llvm_ad_rgb or cuda_ad_rgb")
    parser.add_argument("--threads", metavar="N", help="CPU threads")
