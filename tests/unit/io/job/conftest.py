"""A small scene on disk, and a way to write job files beside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mirelight.base.errors import InputError, ManyInputsError
from mirelight.io import job, splats
from mirelight.io.gltf.write import write_glb
from mirelight.model import Camera, DirectionalLight, PointLight, ProxyMesh, SplatCloud

WriteJob = Callable[[str], Path]
Complaints = Callable[..., list[str]]


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with splats.ply (8 splats, the corners of a cube) and proxy.glb (a floor, two lights, two cameras)."""
    folder = tmp_path_factory.mktemp("scene")
    corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3)
    cloud = SplatCloud(
        means=corners.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (8, 1)),
        scales=np.full((8, 3), 0.1, dtype=np.float32),
        opacities=np.full(8, 0.9, dtype=np.float32),
        sh=np.zeros((8, 1, 3), dtype=np.float32),
    )
    splats.write(cloud, folder / "splats.ply")
    floor = ProxyMesh(
        vertices=np.array([[-2, -1, -2], [2, -1, -2], [2, -1, 2], [-2, -1, 2]], dtype=np.float32),
        faces=np.array([[0, 2, 1], [0, 3, 2]], dtype=np.int32),
    )
    lights = (
        PointLight(name="lamp", position=np.array([1.0, 2.0, 3.0]), intensity=5.0, range=7.0),
        DirectionalLight(name="moon", direction=np.array([0.0, -1.0, 0.0]), intensity=0.5),
    )
    cameras = tuple(
        Camera.look_at((x, 0, 5), (0, 0, 0), 640, 480, yfov=40, name=name) for name, x in (("left", -2), ("right", 2))
    )
    write_glb(folder / "proxy.glb", floor, lights, cameras)
    return folder


@pytest.fixture
def write_job(scene: Path, tmp_path: Path) -> WriteJob:
    """Writes a job file into a folder of its own that holds the scene's files too."""
    for file in scene.iterdir():
        (tmp_path / file.name).symlink_to(file)

    def write(text: str) -> Path:
        path = tmp_path / "job.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture
def complaints(write_job: WriteJob) -> Complaints:
    """The lines that reading a job raises, with the folder taken out; none where it is right."""

    def collect(text: str, *overrides: str) -> list[str]:
        path = write_job(text)
        try:
            job.parse(path, overrides)
        except ManyInputsError as e:
            found = [str(error) for error in e.errors]
            assert str(e).splitlines() == found
        except InputError as e:
            found = [str(e)]
        else:
            found = []
        return [line.replace(f"{path.parent}/", "") for line in found]

    return collect
