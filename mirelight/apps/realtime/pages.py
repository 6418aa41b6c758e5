"""What the live pages of one run know of each other, and of the frames that mirelight itself has rendered."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

from mirelight.base.errors import InputError
from mirelight.io.atomic import atomic_path, write_file

NAME = "page.json"  # beside scene.json
PHYSICAL = "physical.png"


def write(folder: Path, frames: Sequence[str] = (), physical: Path | None = None) -> None:
    """Write what a frame's page links to.

    Args:
        folder: of the frame.
        frames: names of all frames of the run, whose folders lie side by side.
        physical: the same frame as `mirelight render` wrote it; copied, and shown over the live one.

    Raises:
        OutputError: the folder cannot be written.
    """
    if physical is not None:
        with atomic_path(folder / PHYSICAL) as temporary:
            shutil.copyfile(physical, temporary)
    else:
        (folder / PHYSICAL).unlink(missing_ok=True)
    known = {"frames": list(frames), "physical": None if physical is None else PHYSICAL}
    write_file(folder / NAME, json.dumps(known) + "\n")


def rendered(folder: Path, frames: Sequence[str]) -> dict[str, Path]:
    """The PNG files that `mirelight render` has left of frames.

    Raises:
        InputError: there is no such folder, or none of the frames in it.
    """
    if not folder.is_dir():
        raise InputError(folder, "no such folder", "name the output folder of mirelight render")
    found = {name: path for name in frames if (path := folder / f"{name}.png").is_file()}
    if not found:
        raise InputError(folder, f"holds no {frames[0]}.png", "render the job there first: mirelight render JOB -o DIR")
    return found
