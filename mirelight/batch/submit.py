"""Scripts for batch systems, as text: every task renders a shard of the cameras, and all write to one folder."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

from mirelight.batch.order import Order


def slurm(order: Order, shards: int) -> str:
    """A Slurm array script: `sbatch FILE` renders the job in `shards` tasks.

    Paths are absolute, so the job's folder must be there on every node. A task that is given again makes only what is
    missing, which is why the script asks to be queued again where a node fails.
    """
    name = _plain(Path(order.job).stem)
    arguments = shlex.join(order.anywhere().arguments())
    return f"""#!/bin/bash
#SBATCH --job-name={name}
#SBATCH --array=1-{shards}
#SBATCH --ntasks=1
#SBATCH --requeue
#SBATCH --output={name}-%A_%a.log
# Set what your cluster asks for, here or on sbatch's command line: --time, --mem, --cpus-per-task, --partition.
set -e
shard="${{SLURM_ARRAY_TASK_ID:-1}}/{shards}"
threads="${{SLURM_CPUS_PER_TASK:+--threads=$SLURM_CPUS_PER_TASK}}"
# SIGTERM before the time limit reaches mirelight, which ends in order; the same script goes on from there.
exec mirelight render {arguments} $threads --shard "$shard"
"""


def openjd(order: Order, shards: int) -> str:
    """An Open Job Description template (jobtemplate-2023-09, as JSON) of `shards` tasks."""
    arguments = ["render", *order.anywhere().arguments(), "--shard", f"{{{{Task.Param.Shard}}}}/{shards}"]
    template = {
        "specificationVersion": "jobtemplate-2023-09",
        "name": _plain(Path(order.job).stem),
        "steps": [
            {
                "name": "render",
                "parameterSpace": {
                    "taskParameterDefinitions": [{"name": "Shard", "type": "INT", "range": f"1-{shards}"}]
                },
                "script": {"actions": {"onRun": {"command": "mirelight", "args": arguments}}},
            }
        ],
    }
    return json.dumps(template, indent=2) + "\n"


def _plain(name: str) -> str:
    """A name that batch systems take."""
    return "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in name)[:64] or "mirelight"
