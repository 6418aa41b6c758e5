"""The commands of a few lines: `mirelight doctor`, `schema` and `completion`."""

from __future__ import annotations

import argparse

from mirelight.cli import options, say
from mirelight.cli.command import Command

SHELLS = ("bash", "zsh", "tcsh")


def _shell(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS, help="bash, zsh or tcsh")


def run_doctor(args: argparse.Namespace) -> int:
    """Exit code 0 where the default variant renders."""
    from mirelight.apps import doctor

    found = doctor.look()
    say.outcome(args, found, found.lines())
    return found.code


def run_schema(args: argparse.Namespace) -> int:
    """Prints the job file's JSON schema."""
    from mirelight.io.job import json_schema

    say.as_json(json_schema())
    return 0


def run_completion(args: argparse.Namespace) -> int:
    """Prints a shell's completion script."""
    from mirelight.cli.completion import script

    say.result(script(args.parser, args.shell))
    return 0


DOCTOR = Command(
    name="doctor",
    group="start",
    help="say what this machine has, and whether a small render passes",
    description="Say which LLVM, browser and optional packages are there, and what a missing one would unlock; then "
    "render something small with each variant.",
    examples=("doctor", "doctor --json"),
    arguments=options.add_json,
    call=run_doctor,
    page="install",
)
COMPLETION = Command(
    name="completion",
    group="start",
    help="print what completes mirelight's words in a shell",
    description="Print a script with which a shell completes commands, options and files.",
    examples=(
        "completion bash > ~/.local/share/bash-completion/completions/mirelight",
        "completion zsh > ~/.zfunc/_mirelight",
    ),
    arguments=_shell,
    call=run_completion,
    page="command line",
)
SCHEMA = Command(
    name="schema",
    group="data",
    help="print the JSON Schema of job files",
    description="Print the JSON Schema of job files, with which editors complete keys and mark mistakes.",
    examples=("schema > job.schema.json",),
    arguments=lambda parser: None,
    call=run_schema,
    page="job file",
)
