"""Options that several commands share, declared in one way and read in one way."""

from __future__ import annotations

import argparse
import re
from dataclasses import replace
from typing import TYPE_CHECKING

from mirelight.base.errors import InputError

if TYPE_CHECKING:
    from mirelight.batch import Order
    from mirelight.io.job import Override


def add_job(parser: argparse.ArgumentParser, what: str = "job file (TOML)") -> None:
    """The job, and what is laid over it."""
    parser.add_argument("job", metavar="JOB", help=what)
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="lay a setting over the job file: render.spp=256, lights[0].intensity=3 (may be given again)",
    )


def add_frames(parser: argparse.ArgumentParser) -> None:
    """Adds the options that choose frames by camera and lighting."""
    parser.add_argument(
        "--camera", metavar="NAME", nargs="+", action="extend", help="only these cameras (* and ? work)"
    )
    add_lightings(parser)


def add_lightings(parser: argparse.ArgumentParser) -> None:
    """Adds the option that chooses lightings."""
    parser.add_argument("--lighting", metavar="NAME", nargs="+", action="extend", help="only these lightings")


def add_machine(parser: argparse.ArgumentParser) -> None:
    """What light is traced with."""
    parser.add_argument("--variant", help="Mitsuba variant: llvm_ad_rgb or cuda_ad_rgb")
    parser.add_argument("--threads", metavar="N", help="CPU threads")


def add_tracing(parser: argparse.ArgumentParser) -> None:
    """How light is traced, and what with."""
    parser.add_argument("--spp", metavar="N", help="samples a pixel (render.spp)")
    parser.add_argument(
        "--denoise", action=argparse.BooleanOptionalAction, default=None, help="denoise the light (render.denoise)"
    )
    add_machine(parser)


def add_quiet(parser: argparse.ArgumentParser, but: str = "errors") -> None:
    """No more output than needed."""
    parser.add_argument("-q", "--quiet", action="store_true", help=f"say nothing but {but}")


def add_json(parser: argparse.ArgumentParser) -> None:
    """Adds `--json`, for results that a program reads."""
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def order_of(args: argparse.Namespace) -> Order:
    """The arguments of a command that takes an order: job, settings, frames and folder."""
    return replace(
        _settings_of(args),
        out=args.out,
        cameras=None if args.camera is None else tuple(args.camera),
        lightings=None if args.lighting is None else tuple(args.lighting),
    )


def overrides(args: argparse.Namespace) -> list[Override]:
    """What the arguments lay over the job."""
    return _settings_of(args).overrides()


def _settings_of(args: argparse.Namespace) -> Order:
    from mirelight.batch import Order

    given = {name: getattr(args, name, None) for name in ("spp", "denoise", "variant", "threads")}
    return Order(job=args.job, settings=tuple(args.set), **given)


def count_of(text: str | None, option: str) -> int | None:
    """A number of processes or tasks; None where it was not given.

    Raises:
        InputError: it is none.
    """
    if text is None:
        return None
    if not re.fullmatch(r"[1-9]\d{0,3}", text):
        raise InputError(f"{option} {text}", "not a number of them", "give a whole number from 1 on")
    return int(text)
