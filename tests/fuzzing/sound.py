"""Sound files of every format, and the jobs that name them: what cases spoil."""

from __future__ import annotations

import tempfile
import zipfile
from functools import cache
from pathlib import Path

import numpy as np

DATA = Path(__file__).parents[2] / "tests" / "data" / "splats"
TINY = ("--set", "resolution=[16, 12]", "--set", "render.spp=1", "--set", "resolution_scale=1", "-o", "out", "-q")

JOB = """\
splats = "{splats}"
proxy = {{ path = "{proxy}", albedo = "file" }}
{more}
[[cameras]]
name = "front"
position = [0, 1, 6]
target = [0, 0, 0]

[[lightings]]
name = "day"
environment = {{ path = "{sky}", intensity = 1.5, rotation = 10 }}
lights = [{{ type = "spot", position = [0, 4, 0], direction = [0, -1, 0], intensity = 30, radius = 0.1 }}]
"""
WHOLE = """\
splats = [{ path = "splats.ply", transform = { translation = [0, 0, 0], rotation_euler = [0, 0, 180], scale = 1.0 } }]
proxy = { path = "proxy.glb", albedo = [0.5, 0.4, 0.3] }
resolution = [64, 48]
captured = "day"

[[cameras]]
name = "front"
position = [0, 1, 6]
target = [0, 0, 0]
yfov = 40

[[cameras]]
type = "turntable"
name = "orbit"
radius = 6
frames = 2

[[lightings]]
name = "day"
environment = { sky = { latitude = 48.0, longitude = 11.0, time = 2026-06-21T15:30:00+02:00 } }

[[lightings]]
name = "night"
lights_from = "proxy"

[[lightings.lights]]
type = "area"
shape = "rectangle"
position = [0, 3, 0]
direction = [0, -1, 0]
size = [1, 2]
intensity = 5
name = "panel"

[relight]
mode = "ratio"
delta = 0.01

[render]
spp = 1
max_depth = 3
seed = 7

[output]
directory = "out"
png = true
"""


@cache
def base() -> dict[str, bytes]:
    """Sound files of every format, by name."""
    from PIL import Image

    from mirelight.io import splats
    from mirelight.io.environment import write_environment
    from mirelight.io.gltf.write import write_glb
    from mirelight.model import Camera, Material, PointLight, ProxyMesh

    rng = np.random.default_rng(0)
    out: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        splats.write(splats.read(DATA / "small.splat"), folder / "splats.ply")
        picture = rng.integers(0, 256, (4, 8, 3)).astype(np.uint8)
        for suffix in ("png", "jpg", "webp"):
            Image.fromarray(picture).save(folder / f"sky.{suffix}")
        for suffix in ("hdr", "exr"):
            write_environment(folder / f"sky.{suffix}", rng.random((8, 16, 3)).astype(np.float32))
        corners = np.array([[-3, -1, -3], [3, -1, -3], [3, -1, 3], [-3, -1, 3]], dtype=np.float32)
        mesh = ProxyMesh(
            vertices=corners,
            faces=np.array([[0, 2, 1], [0, 3, 2]], dtype=np.int32),
            normals=np.tile(np.array([0, 1, 0], dtype=np.float32), (4, 1)),
            uvs=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32),
            vertex_colors=np.ones((4, 3), dtype=np.float32),
            materials=(
                Material(
                    name="floor", base_color_texture=np.full((2, 2, 3), 0.5, dtype=np.float32), emissive=np.ones(3)
                ),
            ),
        )
        lamp = PointLight(name="lamp", position=np.array([1.0, 3.0, 1.0]), intensity=20.0)
        write_glb(
            folder / "proxy.glb", mesh, [lamp], [Camera.look_at((0, 1, 5), (0, 0, 0), 64, 48, yfov=40, name="cam")]
        )
        out |= {path.name: path.read_bytes() for path in folder.iterdir()}
    out["skin.png"] = out["sky.png"]
    lines = ["mtllib proxy.mtl", "usemtl floor", *(f"v {x} {y} {z} 0.5 0.5 0.5" for x, y, z in corners.tolist())]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vn 0 1 0", "f 1/1/1 3/3/1 2/2/1", "f -4/1/1 -1/3/1 -2/2/1"]
    out["proxy.obj"] = "\n".join(lines).encode() + b"\n"
    out["proxy.mtl"] = b"newmtl floor\nKd 0.5 0.4 0.3\nKe 1 1 1\nmap_Kd skin.png\nmap_Ke skin.png\n"
    head = "ply\nformat ascii 1.0\ncomment TextureFile skin.png\nelement vertex 4\n"
    head += "".join(f"property float {x}\n" for x in ("x", "y", "z", "s", "t"))
    head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    out["mesh.ply"] = head.encode() + b"-3 -1 -3 0 0\n3 -1 -3 1 0\n3 -1 3 1 1\n-3 -1 3 0 1\n3 0 2 1\n3 0 3 2\n"
    triangle = np.zeros(2, dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    triangle["v"] = corners[[[0, 2, 1], [0, 3, 2]]]
    out["proxy.stl"] = b"\0" * 80 + np.uint32(2).tobytes() + triangle.tobytes()
    read = (".ply", ".spz", ".sog", ".splat", ".ksplat")
    out |= {path.name: path.read_bytes() for path in DATA.iterdir() if path.suffix in read}
    out["small.glb"] = (DATA / "small.glb").read_bytes()
    out |= {
        f"streamed/{x.relative_to(DATA / 'streamed').as_posix()}": x.read_bytes()
        for x in (DATA / "streamed").rglob("*.*")
    }
    with zipfile.ZipFile(DATA / "small.sog") as archive:
        out |= {f"sog/{name}": archive.read(name) for name in archive.namelist()}
    return out


COMPANIONS = ("splats.ply", "proxy.glb", "sky.png", "skin.png", "proxy.mtl")


def job(splats: str = "splats.ply", proxy: str = "proxy.glb", sky: str = "sky.png", more: str = "") -> bytes:
    """A job of these files."""
    return JOB.format(splats=splats, proxy=proxy, sky=sky, more=more).encode()


def scene(**files: bytes) -> dict[str, bytes]:
    """The files of a sound scene, with others laid over them."""
    return {name: base()[name] for name in COMPANIONS} | files


CAMERA_FILES = {
    "transforms.json": b'{"camera_angle_x": 0.7, "w": 16, "h": 12, "frames": [{"file_path": "a.png", '
    b'"transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 1], [0, 0, 1, 6], [0, 0, 0, 1]]}]}',
    "cameras.json": b'[{"id": 0, "img_name": "a", "width": 16, "height": 12, "position": [0, 1, 6], "rotation": '
    b'[[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 20, "fy": 20}]',
    "sparse/cameras.txt": b"1 PINHOLE 16 12 20 20 8 6\n",
    "sparse/images.txt": b"1 1 0 0 0 0 1 6 1 a.png\n\n2 1 0 0 0 0 1 7 1 b.png\n\n",
    "sparse/points3D.txt": b"",
    "eyes.csv": b"x,y,z,target_x,target_y,target_z,width,height\n0,1,6,0,0,0,16,12\n0,1,7,0,0,0,16,12\n",
    "camera_path.json": b'{"render_width": 16, "render_height": 12, "camera_path": [{"fov": 50, "aspect": 1.3, '
    b'"camera_to_world": [1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1, 6, 0, 0, 0, 1]}]}',
}
