"""Layouts of data sets, written from arrays: one module each, with the traps of its loaders.

Pictures are PNG with 8-bit sRGB and straight alpha, since the loaders lay them over a background of their own. File
names have no dot but the suffix's, and no space: loaders cut them there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from mirelight.base.errors import InputError
from mirelight.base.layouts import LAYOUTS, Layout
from mirelight.dataset.layouts.coco import check_coco, write_coco
from mirelight.dataset.layouts.colmap import write_colmap
from mirelight.dataset.layouts.files import Files
from mirelight.dataset.layouts.hub import configs, write_hub
from mirelight.dataset.layouts.nerf import write_nerf
from mirelight.dataset.layouts.olat import write_olat
from mirelight.dataset.layouts.pictures import Geometry, Labelled, Part, Picture, Pixels, Shared, check_lenses
from mirelight.dataset.layouts.points import points_of
from mirelight.dataset.layouts.tensoir import write_tensoir
from mirelight.dataset.layouts.tum import check_tum, write_tum
from mirelight.dataset.layouts.world import world_of
from mirelight.model import Camera

__all__ = [
    "LAYOUTS",
    "WRITERS",
    "Files",
    "Geometry",
    "Labelled",
    "Picture",
    "Pixels",
    "Shared",
    "points_of",
    "world_of",
    "write_coco",
    "write_colmap",
    "write_hub",
    "write_nerf",
    "write_olat",
    "write_tensoir",
    "write_tum",
]


@dataclass(frozen=True, slots=True)
class Writer:
    """Writes a data set in one layout."""

    write: Callable[[Files, Iterable[Picture], Shared], None]
    loading: str  # Python that loads a set, run in its folder; {lighting} and {set} are filled in
    refuse: Callable[[Sequence[Camera], Shared], None] = lambda cameras, shared: None  # what this layout cannot hold
    configs: Callable[[Mapping[Part, int]], list[str]] = lambda parts: []  # lines for the head of the set's page
    notes: str = ""  # for the page; {lighting}, to train on, {near} and {far} are filled in

    def check(self, cameras: Sequence[Camera], shared: Shared) -> None:
        """Refuse what a data set cannot hold before anything is written. Raises InputError."""
        for camera in cameras:
            if camera.projection != "perspective":
                found = f"camera {camera.name!r} is orthographic"
                raise InputError(shared.source, found, "data sets hold pinholes alone")
        self.refuse(cameras, shared)


WRITERS: Mapping[Layout, Writer] = {
    "nerf": Writer(
        write_nerf,
        'import json\n\nframes = json.load(open("{lighting}/transforms.json"))["frames"]\nprint(len(frames))',
        check_lenses,
        notes="- For nerfstudio, which would move the world otherwise: `ns-train nerfacto nerfstudio-data --data "
        "{lighting} --orientation-method none --center-method none --auto-scale-poses False`.\n",
    ),
    "colmap": Writer(
        write_colmap,
        'import pycolmap\n\nmodel = pycolmap.Reconstruction("{lighting}/sparse/0")\nprint(model.num_images())',
    ),
    "tensoir": Writer(
        write_tensoir,
        "import json\nfrom pathlib import Path\n\nimport numpy as np\nfrom PIL import Image\n\n"
        'folder = sorted(Path().glob("*_[0-9][0-9][0-9]"))[0]\n'
        'meta = json.load(open(folder / "metadata.json"))\n'
        'pose = np.array([float(x) for x in meta["cam_transform_mat"].split(",")]).reshape(4, 4)\n'
        'print(pose.shape, Image.open(folder / "rgba_{lighting}.png").mode)',
        partial(check_lenses, square=True),
        notes="- The loaders of TensoIR have near 2, far 6 and a box of ±1.5 built in; this set needs near {near:.3g}, "
        "far {far:.3g}. The folder of maps is `environments`.\n",
    ),
    "olat": Writer(
        write_olat,
        'import json\n\nframes = json.load(open("transforms_train.json"))["frames"]\nprint(frames[0]["pl_pos"])',
        check_lenses,
    ),
    "coco": Writer(
        write_coco,
        'from pycocotools.coco import COCO\n\nset_ = COCO("annotations/instances_train.json")\nprint(len(set_.anns))',
        check_coco,
    ),
    "hub": Writer(
        write_hub,
        "from pathlib import Path\n\nfrom datasets import load_dataset\n\n"
        "place = str(Path().resolve())  # or the name of the set on the hub\n"
        'data = load_dataset(place, split="train", streaming=True)\n'
        'sample = next(iter(data))\nprint(sample["png"].mode, sample["json"]["camera"])',
        configs=configs,
        notes='- `webdataset.WebDataset("shards/train-000000.tar").decode("pilrgba")` reads the same shards.\n',
    ),
    "tum": Writer(
        write_tum,
        "import numpy as np\nfrom PIL import Image\n\n"
        'poses = np.loadtxt("{lighting}/groundtruth.txt", ndmin=2)  # time, tx ty tz, qx qy qz qw\n'
        'time, name = open("{lighting}/depth.txt").readlines()[-1].split()\n'
        'depth = np.asarray(Image.open("{lighting}/" + name)) / 5000\n'
        "print(poses.shape, depth.shape)",
        check_tum,
        notes="- A folder a lighting is a sequence of 30 frames a second; depth is 5000 to the unit, and 0 "
        "beyond 13.1.\n"
        "- `calibration.txt` has fx fy cx cy for pixel centres at whole numbers; there is no distortion.\n",
    ),
}
