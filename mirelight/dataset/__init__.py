"""Data sets: frames mixed from kept layers when they are read, and written in the layouts that loaders read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mirelight.dataset.view import DataSet

__all__ = ["open"]


def open(folder: str | Path) -> DataSet:
    """The frames of an output folder, mixed when they are read; see :class:`mirelight.dataset.view.DataSet`.

    Raises:
        InputError: no layers there.
    """
    from mirelight.dataset.view import DataSet

    return DataSet(folder)
