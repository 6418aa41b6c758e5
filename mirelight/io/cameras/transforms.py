"""transforms.json: nerfstudio's, instant-ngp's and Blender-NeRF's, one reader.

`transform_matrix` is world from camera in OpenGL's axes (-Z ahead, +Y up); a few data sets use the same file with
OpenCV's (+Z ahead, +Y down). nerfstudio turns the capture first and says so: what the file holds is `applied_transform`
times the capture's pose, its position times `applied_scale`. The lens stands at the top or in each frame: `fl_x fl_y cx
cy w h`, or `camera_angle_x` in radians; a frame's own comes first. Fields: docs.nerf.studio, "Data conventions";
instant-ngp, docs/nerf_dataset_tips.md.
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.base.errors import InputError
from mirelight.io.cameras import reading
from mirelight.io.cameras.placed import ALL_AROUND, Angle, Distortion, FileCamera, Intrinsics, Panorama, pinholes
from mirelight.io.gltf.fields import Fields
from mirelight.io.safety import contained, open_binary
from mirelight.model import F64, Camera

Axes = Literal["opengl", "opencv"]

_POINTS = "sparse_pc.ply"  # as ns-process-data names it
Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # a world with Y up to one with Z up

_FISHEYE = "OPENCV_FISHEYE"
_PINHOLES = ("PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
_RADIAL = ("k1", "k2", "k3", "k4")
_TANGENTIAL = ("p1", "p2")
_SEVERAL = 4  # poses that tell which axes they have
_FEW = 0.1  # share of them
_ANGLES = ("camera_angle_x", "camera_angle_y")
_FOCALS = ("fl_x", "fl_y")
_OTHERS = ("distortion_params", "camera_model", "is_fisheye", "cx", "cy", "w", "h")
_LENS = (*_FOCALS, *_ANGLES, *_RADIAL, *_TANGENTIAL, *_OTHERS)


def read(path: Path, data: dict[str, Any], axes: Axes | None) -> tuple[FileCamera, ...]:
    """The cameras in the order of the file, in the capture's axes; panoramas by their sides.

    Args:
        path: the file.
        data: what is in it.
        axes: of its cameras; None: OpenGL's, unless they look as if they were OpenCV's.

    Raises:
        InputError: what is wrong, with its field.
    """
    top = Fields(path, "", data)
    frames = _frames(top)
    names = reading.picture_names(_picture(frame, i) for i, frame in enumerate(frames))
    undo = capture_from_file(path, data)
    out = []
    poses = [reading.rows(frame, "transform_matrix") for frame in frames]
    if axes is None and _looks_like_opencv(poses):
        found = "cameras that stand on their heads and look away from their middle"
        remedy = 'say axes = "opencv" if they look along their +Z, or axes = "opengl" if they are right'
        raise InputError(path, found, remedy, field="frames")
    for frame, name, pose in zip(frames, names, poses, strict=True):
        fail = partial(frame.fail, "transform_matrix")
        pose = reading.rigid(undo @ (pose @ reading.FLIP if axes == "opencv" else pose), fail)
        lens, distortion = _lens(_own_or_shared(frame, top))
        picture, mask = (frame.text(key, "") for key in ("file_path", "mask_path"))
        out.append(
            FileCamera(name=name, world_from_camera=pose, lens=lens, distortion=distortion, picture=picture, mask=mask)
        )
    return pinholes(out)


def file_from_capture(path: Path, data: dict[str, Any]) -> Matrix:
    """The way back from :func:`capture_from_file`."""
    return np.asarray(np.linalg.inv(capture_from_file(path, data)), np.float64)


def points_beside(path: Path, data: dict[str, Any]) -> F64 | None:
    """(M, 3) the points that a training starts from, in the capture's axes; None where none lie there that are read."""
    from trimesh.exchange.ply import load_ply

    name = Fields(path, "", data).text("ply_file_path", _POINTS)
    try:
        with open_binary(contained(path.parent, name, path, "ply_file_path")) as stream:
            found = np.asarray(load_ply(stream)["vertices"], np.float64)
    except Exception:  # trimesh raises whatever its parsing runs into
        return None
    m = capture_from_file(path, data)
    return np.asarray(found @ m[:3, :3].T + m[:3, 3]) if np.isfinite(found).all() else None


def _frames(top: Fields) -> list[Fields]:
    value = top.values.get("frames")
    if isinstance(value, dict):  # OpenIllumination: frames by name
        named = [{"file_path": key, **x} if isinstance(x, dict) else x for key, x in value.items()]
        return reading.objects(top.file, "frames", named)
    return reading.objects(top.file, "frames", value)


def _looks_like_opencv(poses: list[Matrix]) -> bool:
    """True where OpenGL's axes make hardly any sense of several poses in a world with Z up."""
    m = np.stack(poses)
    inwards = m[:, :3, 3].mean(axis=0) - m[:, :3, 3]
    looks_in = np.einsum("ni,ni->n", inwards, -m[:, :3, 2]) > 0
    is_upright = m[:, 2, 1] > 0
    return len(m) >= _SEVERAL and bool(max(looks_in.mean(), is_upright.mean()) < _FEW)


def _picture(frame: Fields, number: int) -> str:
    return frame.text("file_path", f"frame_{number + 1:05d}")


def capture_from_file(path: Path, data: dict[str, Any]) -> Matrix:
    """The matrix (4, 4) from the file's world back to the capture's. Raises InputError."""
    top, out = Fields(path, "", data), np.eye(4)
    if "applied_transform" in top:
        matrix = reading.rows(top, "applied_transform")
        reading.rigid(matrix, partial(top.fail, "applied_transform"))
        out = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    if "applied_scale" in top:
        scale = top.number("applied_scale")
        if not 1e-9 < scale < 1e9:
            raise top.fail("applied_scale", f"{scale:g}", "it must be positive")
        out = out @ np.diag([1 / scale, 1 / scale, 1 / scale, 1.0])
    return out


def _own_or_shared(frame: Fields, top: Fields) -> Fields:
    """The keys of a frame's lens: its own, else those at the top."""
    own = {name: frame.values[name] for name in _LENS if name in frame}
    shared = {name: top.values[name] for name in _LENS if name in top}
    if own.keys() & {_FOCALS[0], _ANGLES[0]}:
        shared = {name: value for name, value in shared.items() if name not in (*_FOCALS, *_ANGLES)}
    return Fields(top.file, frame.where if own else "", {**shared, **own})


def _lens(source: Fields) -> tuple[Intrinsics | Angle, Distortion | Panorama | None]:
    model = _FISHEYE if source.flag("is_fisheye") else source.text("camera_model", "OPENCV")
    if model == ALL_AROUND:
        return _all_around(source)
    if model not in (*_PINHOLES, _FISHEYE):
        raise source.fail("camera_model", f"{model[:40]!r}, which no pinhole stands for", "undistort the capture")
    size = (reading.side(source, "w"), reading.side(source, "h")) if "w" in source and "h" in source else None
    if "fl_x" in source:
        fx = source.number("fl_x")
        if size is None:
            raise source.fail("w", "missing", "a focal length in pixels needs w and h")
        values = (fx, source.number("fl_y", fx), source.number("cx", size[0] / 2), source.number("cy", size[1] / 2))
        lens = reading.intrinsics(values, size, partial(source.fail, "fl_x"))
        return lens, _distortion(source, model)
    if "camera_angle_x" not in source:
        raise source.fail("", "no lens", "fl_x, or camera_angle_x, is expected in the frame or at the top")
    degrees = math.degrees(source.number("camera_angle_x"))
    degrees = reading.field_of_view(degrees, partial(source.fail, "camera_angle_x"))
    angle = Angle(degrees=degrees, side="horizontal", size=size)
    if size is None:
        return angle, None
    centered = angle.fitted(size)
    fy = centered.fy
    if "camera_angle_y" in source:
        vertical = math.degrees(source.number("camera_angle_y"))
        vertical = reading.field_of_view(vertical, partial(source.fail, "camera_angle_y"))
        fy = Angle(degrees=vertical, side="vertical").fitted(size).fy
    values = (centered.fx, fy, source.number("cx", size[0] / 2), source.number("cy", size[1] / 2))
    lens = reading.intrinsics(values, size, partial(source.fail, "camera_angle_x"))
    return lens, _distortion(source, model)


def _all_around(source: Fields) -> tuple[Intrinsics, Panorama]:
    width, height = reading.side(source, "w"), reading.side(source, "h")
    if width != 2 * height:
        raise source.fail("w", f"{width} by {height} pixels", "a panorama of all directions is twice as wide as high")
    bend = Panorama(side="front", width=width)
    return bend.lens(), bend


def _distortion(source: Fields, model: str) -> Distortion | None:
    if "distortion_params" in source:
        radial = source.vector("distortion_params", 6)
        k, p = tuple(radial[:4].tolist()), radial[4:].tolist()
    else:
        k = tuple(source.number(name, 0.0) for name in _RADIAL)
        p = [source.number(name, 0.0) for name in _TANGENTIAL]
    if model != _FISHEYE and not any(k) and not any(p):
        return None
    return Distortion(model=model, radial=k, tangential=(p[0], p[1]), fisheye=model == _FISHEYE)


# --- writing ---------------------------------------------------------------------------------------------------------


def lens_entry(camera: Camera) -> dict[str, Any]:
    """The keys of a lens, for a frame or the top; pinholes of any shape and centre."""
    return {
        "camera_model": "PINHOLE",
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "w": camera.width,
        "h": camera.height,
    }


def matrix_entry(camera: Camera, world: Matrix = Z_UP, axes: Axes = "opengl") -> list[list[float]]:
    """`transform_matrix` of a camera, 4 rows of 4 numbers.

    Args:
        camera: in mirelight's world.
        world: from mirelight's world (Y up) to the file's (Z up, as these files have it); it may scale.
        axes: of the file's cameras.
    """
    pose = conventions.rigid_part(np.asarray(world) @ camera.world_from_camera)
    rows: list[list[float]] = (pose @ reading.FLIP if axes == "opencv" else pose).tolist()
    return rows
