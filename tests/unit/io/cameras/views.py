"""Views to write into files by each format's own convention, and where they must show points."""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mirelight.model import F64, Camera

POINTS = np.random.default_rng(7).uniform(-1, 1, (40, 3))  # in the capture's axes
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class View:
    """An OpenCV camera: a point X lands on (fx x / z + cx, fy y / z + cy) with (x, y, z) = R X + t."""

    name: str
    r: F64  # (3, 3) camera from world
    t: F64  # (3,)
    width: int = 640
    height: int = 480
    fx: float = 510.25
    fy: float = 498.5
    cx: float = 300.125
    cy: float = 251.75

    @property
    def world_from_camera(self) -> F64:
        """(4, 4) in OpenCV's axes."""
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = self.r.T, -self.r.T @ self.t
        return out

    @property
    def opengl(self) -> F64:
        """(4, 4) in OpenGL's axes."""
        return self.world_from_camera @ FLIP

    def pixels(self, points: F64 = POINTS) -> F64:
        """(N, 2)."""
        x, y, z = (points @ self.r.T + self.t).T
        assert z.min() > 0.5
        return np.stack([self.fx * x / z + self.cx, self.fy * y / z + self.cy], axis=1)


def views(count: int = 5, **lens: Any) -> list[View]:
    """Views from all around at distances of 4 to 6, with roll, looking about the middle."""
    rng = np.random.default_rng(3)
    out = []
    for i in range(count):
        r = Rotation.random(rng=rng).as_matrix()
        t = np.array([*rng.uniform(-0.3, 0.3, 2), rng.uniform(4, 6)])
        out.append(View(name=f"view_{i:03d}", r=r, t=t, **lens))
    return out


def pixels_of(camera: Camera, points: F64 = POINTS) -> F64:
    """(N, 2) by the formula of mirelight's Camera."""
    x, y, z = (points @ camera.camera_from_world[:3, :3].T + camera.camera_from_world[:3, 3]).T
    return np.stack([camera.cx + camera.fx * x / -z, camera.cy - camera.fy * y / -z], axis=1)


def write_json(path: Path, value: Any) -> Path:
    path.write_text(json.dumps(value), encoding="utf-8")
    return path


def write_ssproj(path: Path, document: Any) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("document.json", json.dumps(document))
    return path


def colmap_text(folder: Path, seen: list[View]) -> Path:
    """A text model with a PINHOLE for each view, comments, and points behind each image."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras = ["# comment"]
    images = ["# comment", "#"]
    for i, view in enumerate(seen, start=1):
        values = f"{view.fx!r} {view.fy!r} {view.cx!r} {view.cy!r}"
        cameras.append(f"{i} PINHOLE {view.width} {view.height} {values}")
        x, y, z, w = (float(v) for v in Rotation.from_matrix(view.r).as_quat())
        t = " ".join(repr(float(v)) for v in view.t)
        images.append(f"{i + 10} {w!r} {x!r} {y!r} {z!r} {t} {i} {view.name}.png")
        images.append("12.5 13.5 -1 20 30 4" if i % 2 else "")
    (folder / "cameras.txt").write_text("\n".join(cameras) + "\n", encoding="utf-8")
    (folder / "images.txt").write_text("\n".join(images) + "\n", encoding="utf-8")
    (folder / "points3D.txt").write_text("", encoding="utf-8")
    return folder
