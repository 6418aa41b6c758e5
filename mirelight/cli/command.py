"""A command of the program, as the table of commands holds it."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

Group: TypeAlias = Literal["start", "render", "look", "compare", "data"]

GROUPS: dict[Group, str] = {
    "start": "start",
    "render": "render",
    "look": "look",
    "compare": "compare",
    "data": "data and housekeeping",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """One command. Nothing heavy is loaded before it is called."""

    name: str
    group: Group  # what one wants of it
    help: str  # a line in the list of commands
    description: str
    examples: tuple[str, ...]  # what may be typed, without "mirelight"
    arguments: Callable[[argparse.ArgumentParser], None]  # declares them
    call: Callable[[argparse.Namespace], int]  # runs it; an exit code
    page: str  # of the documentation: a name of `mirelight.base.pages`
