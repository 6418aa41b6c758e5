"""Completion of a shell's words: commands and options by shtab, files where an argument names one."""

from __future__ import annotations

import argparse

import shtab

_FILES = {"JOB", "FILE", "CAPTURE", "SPLATS", "PATH", "MESH", "PICTURE", "LIGHT"}
_FOLDERS = {"DIR"}


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The completion script of a shell."""
    _mark(parser)
    return shtab.complete(parser, shell)


def _mark(parser: argparse.ArgumentParser) -> None:
    """Say which arguments are files, by what help calls them."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                _mark(child)
        elif _FILES & (words := set(str(action.metavar).split("|"))):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        elif _FOLDERS & words:
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
