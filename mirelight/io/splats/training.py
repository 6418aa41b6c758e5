"""The folder that a training of splats leaves: which of its files is the capture.

INRIA's 3D Gaussian Splatting, and what is made of it, write `point_cloud/iteration_N/point_cloud.ply` and
`cameras.json` into one folder, which their other programs are given with `-m`. gsplat's examples write
`ckpts/ckpt_N_rank0.pt`, where asked `ply/point_cloud_N.ply`, and `cfg.yml`, which names the COLMAP project; nerfstudio
`nerfstudio_models/step-N.ckpt` and `config.yml`, which names the folder of its transforms.json.
"""

from __future__ import annotations

import re
from pathlib import Path

from mirelight.base.errors import InputError
from mirelight.io.safety import read_bytes

NERFSTUDIO = "nerfstudio_models"  # the folder of its checkpoints
_INSIDE = ("ply", "ckpts", NERFSTUDIO)  # folders of a training of gsplat or nerfstudio that hold captures
_SETTINGS = ("cfg.yml", "config.yml")  # gsplat's, nerfstudio's
_MOST_BYTES = 1 << 20
_LAYOUTS = (
    "point_cloud/iteration_*/point_cloud.ply",
    "ply/point_cloud_*.ply",
    "ckpts/ckpt_*_rank0.pt",
    f"{NERFSTUDIO}/step-*.ckpt",
)


def resolved(path: Path) -> Path:
    """The splats of the last iteration, where `path` is the folder of a training; else `path` itself."""
    if not path.is_dir():
        return path
    for layout in _LAYOUTS:
        found = [x for x in path.glob(layout) if x.is_file()]
        if found:
            return max(found, key=lambda x: (_iteration(x), x))
    return path


def folder_of(capture: Path) -> Path | None:
    """The folder of INRIA's training that a capture lies in, which holds its cameras; None: it lies in none."""
    iteration = capture.absolute().parent
    inside = iteration.parent.name == "point_cloud" and iteration.name.startswith("iteration_")
    return iteration.parents[1] if inside else None


def settings_beside(capture: Path) -> Path | None:
    """The file of the settings that gsplat or nerfstudio trained a capture with; None: there is none."""
    folder = capture.absolute().parent.parent
    return next((folder / name for name in _SETTINGS if (folder / name).is_file()), None)


def settings_of(capture: Path) -> str:
    """What is in that file; nothing where it cannot be read."""
    path = settings_beside(capture)
    try:
        return "" if path is None else read_bytes(path, _MOST_BYTES).decode(errors="replace")
    except InputError:
        return ""


def data_of(capture: Path) -> Path | None:
    """The project that gsplat or nerfstudio trained a capture on, as its settings name it; None: it lies in no such
    training, or the project is gone."""
    inside = capture.absolute().parent
    named = _named(settings_of(capture)) if inside.name in _INSIDE else None
    if named is None or named.replace("\\", "/").startswith("//"):
        return None  # another machine's: to look there would sign in to it
    found = (above / named for above in inside.parents)  # both are named from where it was started
    try:
        return next((x for x in found if x.exists()), None)
    except OSError:  # no name of a file
        return None


def _named(text: str) -> str | None:
    """The project in settings of gsplat, or of nerfstudio, which lists the parts of a path."""
    if one := re.search(r"^data_dir: *['\"]?([^'\"\n]+?)['\"]? *$", text, re.MULTILINE):
        return one[1]
    if several := re.search(r"^data: .*Path\n((?:- .+\n)+)", text, re.MULTILINE):
        return "/".join(x[2:].strip("'\" ") for x in several[1].splitlines()).replace("//", "/")
    return None


def _iteration(path: Path) -> int:
    return int(max(re.findall(r"\d+", "/".join(path.parts[-2:])), key=int, default="0"))
