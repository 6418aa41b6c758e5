"""Folders that are taken away again where nothing comes of the run that made them."""

from __future__ import annotations

from pathlib import Path

from mirelight.io.atomic import output_error


class NewFolders:
    """A folder to write into and some in it, as far as this run has made them; what was there before stays as it is.

    Args:
        folder: the one that a person named; those around it count, too.
        inner: folders below it.
    """

    def __init__(self, folder: Path, *inner: Path) -> None:
        self._wanted = (folder, *inner)
        self._made: list[Path] = []  # outer ones first

    def make(self) -> None:
        """Make what is missing of them.

        Raises:
            OutputError: one of them cannot be made.
        """
        try:
            for folder in self._wanted:
                self._made += [x for x in (*reversed(folder.parents), folder) if not x.exists()]
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise output_error(self._wanted[0], error) from None

    def __contains__(self, folder: Path) -> bool:
        return folder in self._made

    def remove(self) -> None:
        """Take away those that were made and hold nothing, the inner ones first."""
        while self._made:
            try:
                self._made.pop().rmdir()
            except OSError:  # it holds something, is gone already, or could not be made
                continue
