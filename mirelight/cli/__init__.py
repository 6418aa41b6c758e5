"""The command line. Only argparse is loaded before a command is known, so that help is instant."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType
from typing import NoReturn

from mirelight import __version__
from mirelight.errors import MirelightError

BAD = 2  # exit code of expected trouble: bad input, no backend, a full disk
INTERRUPTED = 130  # 128 + SIGINT, as shells have it
TERMINATED = 143  # 128 + SIGTERM


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the return value is the exit code (0, 2, or 130 and 143 where it was stopped)."""
    parser = _parser()
    args = parser.parse_args(arguments)
    if args.command is None:
        parser.print_help()
        return BAD
    signal.signal(signal.SIGTERM, _terminate)
    try:
        code = _run(args)
        sys.stdout.flush()
        return code
    except MirelightError as e:
        for line in str(e).splitlines():
            _say(line)
        return BAD
    except KeyboardInterrupt:
        _say("interrupted")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of a pipe has gone, as `| head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BAD
    except MemoryError:
        _say("out of memory; use a smaller resolution or fewer splats, or a machine with more")
        return BAD
    except OSError as e:
        _say(f"{e.filename or 'the system'}: {e.strerror or e}")
        return BAD


def _say(line: str) -> None:
    print(f"mirelight: {line}", file=sys.stderr)


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    """SIGTERM ends the program in order, so that no temporary file is left."""
    raise SystemExit(TERMINATED)


def _run(args: argparse.Namespace) -> int:
    match args.command:
        case "render":
            from mirelight.cli.render import run_render

            return run_render(args)
        case "inspect":
            from mirelight.cli.report import run_inspect

            return run_inspect(args.file, args.json)
        case "compare":
            from mirelight.cli.compare import run_compare

            return run_compare(args)
        case "realtime":
            from mirelight.cli.realtime import run_realtime

            return run_realtime(args)
        case "explain":
            from mirelight.cli.explain import run_explain

            return run_explain(args)
        case "schema":
            import json

            from mirelight.io.job import json_schema

            print(json.dumps(json_schema(), indent=2, ensure_ascii=False))
            return 0
        case _:
            from mirelight import doctor

            return doctor.run()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="mirelight",
        description="Offline, physically based relighting of Gaussian-splat captures.",
        epilog="Exit codes: 0 done; 1 a requirement of compare is unmet; 2 bad input or no way to go on (one line says "
        "why); 130 interrupted.",
    )
    parser.add_argument("--version", action="version", version=f"mirelight {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")

    render = commands.add_parser(
        "render",
        help="render the frames of a job file",
        description="Render every camera of a job under every lighting. Frames that exist with unchanged inputs are "
        "skipped, so an interrupted run goes on when it is started again.",
    )
    render.add_argument("job", metavar="JOB", help="job file (TOML)")
    render.add_argument(
        "--camera", metavar="NAME", nargs="+", action="extend", help="only these cameras (* and ? work)"
    )
    render.add_argument("--lighting", metavar="NAME", nargs="+", action="extend", help="only these lightings")
    render.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="lay a setting over the job file: render.spp=256, lights[0].intensity=3 (may be given again)",
    )
    render.add_argument("-o", "--out", metavar="DIR", help="write there, relative to the current folder")
    render.add_argument("--variant", help="Mitsuba variant: llvm_ad_rgb, cuda_ad_rgb or scalar_rgb")
    render.add_argument("--threads", metavar="N", help="CPU threads")
    render.add_argument("-q", "--quiet", action="store_true", help="say nothing but errors")

    inspect = commands.add_parser(
        "inspect",
        help="say what is in a splat, mesh, glTF, image or job file",
        description="Counts, bounds, lights, cameras, and the memory that a file will take.",
    )
    inspect.add_argument("file", metavar="FILE", help="the file")
    inspect.add_argument("--json", action="store_true", help="as JSON")

    from mirelight.cli.compare import add_compare
    from mirelight.cli.explain import add_explain
    from mirelight.cli.realtime import add_realtime

    add_compare(commands)
    add_realtime(commands)
    add_explain(commands)
    commands.add_parser("schema", help="print the JSON Schema of job files")
    commands.add_parser("doctor", help="say what this machine has, and whether a small render passes")
    return parser
