"""A capture of photographs: the project's own trainer on pictures and the COLMAP model of them.

    python scripts/photographs.py FOLDER -o out/tree

FOLDER is what COLMAP's image_undistorter leaves: sparse/ (or sparse/0/) and images/, all of one camera. The result lies
as INRIA's trainer leaves it, so that `mirelight new out/tree` finds its cameras and pictures. Takes ten CPU minutes for
80 pictures.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from PIL import Image
from scenegen import training

from mirelight.io import cameras as camera_files
from mirelight.io import splats
from mirelight.io.atomic import write_file
from mirelight.io.cameras import colmap, inria
from mirelight.model import F32, Camera

PIXELS = 130_000  # of a picture, at most: training takes as much longer as there are more
ERROR, TRACK = 2.0, 3  # px, pictures: worse points, and such as fewer show, are not started from


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--iterations", type=int, default=3000)
    parser.add_argument("--most", type=int, default=90_000, help="splats")
    args = parser.parse_args()
    model = camera_files.open_file(args.folder)
    taken = model.read()
    cameras = [x.to_camera(x.size((0, 0))) for x in taken]
    scale = min((PIXELS / (cameras[0].width * cameras[0].height)) ** 0.5, 1.0)
    small = [_smaller(x, scale) for x in cameras]
    pictures = [_shown(args.folder / "images" / one.picture, camera) for one, camera in zip(taken, small, strict=True)]
    seen = colmap.read_points(model.files[0].with_name("points3D.bin"))
    points = seen.positions[(seen.errors < ERROR) & (seen.pictures >= TRACK)]
    how = training.Shooting(size=(small[0].width, small[0].height), iterations=args.iterations, most=args.most)
    rows = training.train(small, pictures, points, training.sizes_of(points), how)
    path = args.out / f"point_cloud/iteration_{args.iterations}/point_cloud.ply"
    path.parent.mkdir(parents=True, exist_ok=True)
    splats.write(training.cloud_of(rows), path)
    entries = [
        inria.entry(camera, k) | {"img_name": Path(one.picture).stem}
        for k, (one, camera) in enumerate(zip(taken, cameras, strict=True))
    ]
    write_file(args.out / "cameras.json", json.dumps(entries))
    source = str(args.folder.absolute())
    write_file(args.out / "cfg_args", f"Namespace(images='images', sh_degree=3, source_path={source!r})")


def _smaller(camera: Camera, scale: float) -> Camera:
    return camera.resized(round(camera.width * scale), round(camera.height * scale))


def _shown(path: Path, camera: Camera) -> F32:
    """(H, W, 3) display values."""
    with Image.open(path) as image:
        small = image.convert("RGB").resize((camera.width, camera.height), Image.Resampling.LANCZOS)
    return (np.asarray(small) / 255).astype(np.float32)


if __name__ == "__main__":
    main()
