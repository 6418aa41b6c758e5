"""A small capture that comes with the package: the shipped stage, with its proxy and three lightings."""

from __future__ import annotations

import shutil
from pathlib import Path

from mirelight.io.atomic import atomic_path
from mirelight.io.folders import NewFolders

_SCENE = Path(__file__).parent / "scene"
JOB = "job.toml"


def write(folder: Path) -> Path:
    """Put the capture and its job into a folder; what is there already stays.

    Returns:
        The job file.

    Raises:
        OutputError: it cannot be written.
    """
    NewFolders(folder).make()
    for file in sorted(_SCENE.iterdir()):
        out = folder / file.name
        if not out.exists():
            with atomic_path(out) as temporary:
                shutil.copyfile(file, temporary)
    return folder / JOB
