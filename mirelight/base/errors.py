"""The one exception tree. Raised with the remedy, caught once, in the command line."""

from __future__ import annotations

from pathlib import Path


def printable(text: str) -> str:
    """The text with everything that could act on a terminal, and bytes that are not UTF-8, written as an escape.

    File names and names inside files are chosen by others: ``ESC [ 2 J`` in one must not clear a screen.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def one_line(text: str) -> str:
    """The text as one printable line."""
    return printable(" ".join(text.split()))


class MirelightError(Exception):
    """Base of every error that mirelight raises on purpose; its text is one line for a person."""


class InputError(MirelightError):
    """Input that cannot be used: says the file, the field, what was found, and what to do.

    Args:
        file: the file (or other source) that holds the bad input.
        found: what was found there, e.g. ``"range is 0"``.
        remedy: what to do about it, e.g. ``"give a positive range or leave it out"``.
        field: where in the file, e.g. ``"lights[2].range"`` or ``"line 12, column 5"``.
    """

    def __init__(self, file: str | Path, found: str, remedy: str = "", *, field: str = "") -> None:
        self.file = str(file)
        self.field = field
        self.found = found
        self.remedy = remedy
        where = f"{self.file}: {field}" if field else self.file
        text = f"{where}: {found}" + (f"; {remedy}" if remedy else "")
        super().__init__(one_line(text))


class ManyInputsError(MirelightError):
    """Several input errors found in one pass (a job file with three mistakes reports all three)."""

    def __init__(self, errors: list[InputError]) -> None:
        self.errors = tuple(errors)
        super().__init__("\n".join(str(e) for e in errors))


class BackendError(MirelightError):
    """No usable compute backend (libLLVM, CUDA, variant): says what was looked for and how to install it."""


class RenderError(MirelightError):
    """A render that could not be finished (memory, disk, interrupted): says what is safe on disk."""


class OutputError(MirelightError):
    """A file that could not be written: says which, why, and that nothing half-written was left."""
