"""The parser of the command line, made from the table of commands; help in groups, with examples, and colours."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from mirelight.base.pages import page
from mirelight.base.version import __version__
from mirelight.cli import say
from mirelight.cli.codes import BAD, EVERY
from mirelight.cli.command import GROUPS, Command
from mirelight.cli.commands import COMMANDS

# Names of other programs, and of earlier versions, where spelling alone does not lead to ours.
_ELSEWHERE = {
    "csv": "out",
    "file": "out",
    "html": "out",
    "output": "out",
    "samples": "spp",
    "serve": "mix",
    "preview": "watch",
    "video": "film",
    "frames": "camera",
    "report": "out",
}


class Parser(argparse.ArgumentParser):
    """Says what is wrong with arguments in one line, like all else that is wrong, and what was meant."""

    command: Command | None = None  # that it is of

    def error(self, message: str) -> NoReturn:
        """Prints a wrong command line's mistake and ends the process."""
        name = self.prog.removeprefix("mirelight").strip()
        say.remark(f"{name}{': ' if name else ''}{message}; {self.prog} --help says more")
        sys.exit(BAD)

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """All arguments; what is left over is said by the command that it was given to."""
        found, rest = self.parse_known_args(args, namespace)
        if rest:
            of = self._children().get(found.command or "", self)
            known = [name for action in of._actions for name in action.option_strings]
            option = rest[0].partition("=")[0]
            what = "unknown option" if option.startswith("-") else "one argument too many:"
            of.error(f"{what} {option}{_meant(option, known) if option.startswith('-') else ''}")
        return found

    def format_help(self) -> str:
        """In groups for the program, with examples for a command."""
        self.formatter_class = _formatter()
        if self.command is None:
            return self._overview()
        examples = "\n".join(f"  mirelight {line}" for line in self.command.examples)
        return f"{super().format_help()}\nexamples:\n{examples}\n\nmore: {page(self.command.page)}\n"

    def _overview(self) -> str:
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        for group, title in GROUPS.items():
            formatter.start_section(title)
            formatter.add_arguments(argparse.Action([], x.name, help=x.help) for x in COMMANDS if x.group == group)
            formatter.end_section()
        formatter.start_section("options")
        formatter.add_arguments(x for x in self._actions if x.option_strings)
        formatter.end_section()
        formatter.add_text(EVERY)
        formatter.add_text(f"mirelight COMMAND --help has examples. More: {page('command line')}")
        return formatter.format_help()

    def _children(self) -> dict[str, Parser]:
        return next((x.choices for x in self._actions if isinstance(x, argparse._SubParsersAction)), {})

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        known = [str(x) for x in action.choices]
        if isinstance(action, argparse._SubParsersAction):
            raise argparse.ArgumentError(None, f"no command {value!r}{_meant(value, known)}")
        rest = _meant(value, known) or f"; give one of {', '.join(known)}"
        raise argparse.ArgumentError(action, f"{value!r}{rest}")


def make_parser() -> argparse.ArgumentParser:
    """Of every command, without importing what it runs."""
    parser = Parser(prog="mirelight", description="Offline, physically based relighting of Gaussian-splat captures.")
    parser.add_argument("--version", action="version", version=f"mirelight {__version__}")
    parser.set_defaults(parser=parser)  # for what is said of all commands: completion
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", prog="mirelight")
    for command in COMMANDS:
        child = commands.add_parser(command.name, help=command.help, description=command.description)
        child.command = command
        child.set_defaults(call=command.call)
        command.arguments(child)
    return parser


def _formatter() -> Any:
    """Coloured on a terminal; elsewhere plain, and nothing is loaded for it."""
    if not sys.stdout.isatty() or "NO_COLOR" in os.environ:
        return argparse.HelpFormatter
    from rich_argparse import RichHelpFormatter

    return RichHelpFormatter


def _meant(word: str, known: Sequence[str]) -> str:
    """What was probably meant by a word that is none of the known ones."""
    import difflib

    plain = {x.lstrip("-"): x for x in known}
    bare = word.lstrip("-")[:100]
    near = difflib.get_close_matches(bare, plain, n=1, cutoff=0.6)
    found = plain.get(_ELSEWHERE.get(bare, "")) or (plain[near[0]] if near else None)
    return f"; did you mean {found}?" if found else ""
