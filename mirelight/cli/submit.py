"""`mirelight submit`: a job as a script for a batch system."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from mirelight.batch import submit
from mirelight.cli import outputs
from mirelight.cli.options import count_of, order_of
from mirelight.io.atomic import write_file


def run_submit(args: argparse.Namespace) -> int:
    """The command. The script goes to stdout, or to a file."""
    order = replace(order_of(args), out=args.frames)
    work = order.load()
    order.plan(work)  # a mistake is said now, not on a hundred nodes
    shards = count_of(args.shards, "--shards") or 1
    text = submit.slurm(order, shards) if args.slurm else submit.openjd(order, shards)
    if args.out is None:
        sys.stdout.write(text)
        return 0
    out = Path(args.out)
    outputs.in_a_folder(out)
    outputs.spare([out], outputs.files_of(work))
    write_file(out, text)
    return 0
