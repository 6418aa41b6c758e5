"""`mirelight submit`: a job as a script for a batch system."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mirelight.batch import submit
from mirelight.cli.render import count_of, order_of
from mirelight.io.atomic import atomic_path


def run_submit(args: argparse.Namespace) -> int:
    """The command. The script goes to stdout, or to a file."""
    order = order_of(args)
    order.plan(order.load())  # a mistake is said now, not on a hundred nodes
    shards = count_of(args.shards, "--shards") or 1
    text = submit.slurm(order, shards) if args.slurm else submit.openjd(order, shards)
    if args.file is None:
        sys.stdout.write(text)
        return 0
    with atomic_path(Path(args.file)) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return 0
