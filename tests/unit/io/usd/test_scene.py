"""Meshes, instances, materials and cameras of OpenUSD stages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirelight.io import job
from mirelight.io.environment import write_environment
from mirelight.io.mesh import read_mesh
from mirelight.io.usd.cameras import read_cameras, sample_cameras
from mirelight.io.usd.lights import read_lights
from mirelight.model import AreaLight

pytest.importorskip("pxr")

_QUAD = """
    point3f[] points = [(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)]
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 3, 2, 1]
    uniform token subdivisionScheme = "none"
"""
_STAGE = f"""#usda 1.0
(
    metersPerUnit = 1
    upAxis = "Y"
    timeCodesPerSecond = 24
    startTimeCode = 0
    endTimeCode = 48
)
def Mesh "seen"
{{
    {_QUAD}
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "faceVarying" )
    rel material:binding = </mat>
    prepend apiSchemas = ["MaterialBindingAPI"]
}}
def Mesh "hidden" {{
    {_QUAD}
    token visibility = "invisible"
}}
def PointInstancer "many"
{{
    point3f[] positions = [(10, 0, 0), (20, 0, 0), (30, 0, 0)]
    int[] protoIndices = [0, 0, 0]
    int64[] ids = [0, 1, 2]
    int64[] invisibleIds = [1]
    rel prototypes = </many/quad>
    def Mesh "quad"
    {{
        {_QUAD}
        double3 xformOp:translate = (0, 5, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
}}
def Material "mat"
{{
    token outputs:surface.connect = </mat/s.outputs:surface>
    def Shader "s"
    {{
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </mat/t.outputs:rgb>
        color3f inputs:emissiveColor = (0.5, 0, 0)
        token outputs:surface
    }}
    def Shader "t"
    {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @tex.png@
        token inputs:wrapS = "clamp"
        float3 outputs:rgb
    }}
}}
def Camera "shot"
{{
    float focalLength.timeSamples = {{ 0: 50, 48: 100 }}
    float horizontalAperture = 36
    float verticalAperture = 24
    float horizontalApertureOffset = 3.6
    float fStop = 2.5
    double shutter:open = -0.25
    double shutter:close = 0.5
    float focusDistance.timeSamples = {{ 0: 5, 48: 9 }}
    float2 clippingRange = (0.1, 100)
    double3 xformOp:translate.timeSamples = {{ 0: (0, 0, 5), 48: (0, 0, 9) }}
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def DomeLight "sky"
{{
    asset inputs:texture:file = @sky.exr@
    token inputs:texture:format = "latlong"
}}
def RectLight "screen"
{{
    asset inputs:texture:file = @tex.png@
    float inputs:width = 2
    float inputs:height = 2
}}
"""


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stage")
    path = folder / "stage.usda"
    text = _STAGE.replace('    prepend apiSchemas = ["MaterialBindingAPI"]\n', "")
    path.write_text(text.replace('def Mesh "seen"', 'def Mesh "seen" (prepend apiSchemas = ["MaterialBindingAPI"])'))
    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[0, 0], pixels[1, 1] = (255, 0, 0), (0, 0, 255)
    Image.fromarray(pixels).save(folder / "tex.png")
    sky = np.zeros((4, 8, 3), np.float32)
    sky[1, 4] = 7  # just right of the middle: towards +Z, a little to -X
    write_environment(folder / "sky.exr", sky)
    return path


def test_meshes_with_instances_and_textures(stage: Path) -> None:
    mesh = read_mesh(stage)
    assert mesh.nodes == ("seen", "quad")
    assert len(mesh.faces) == 2 + 2 * 2  # one of three instances and one mesh are not seen
    placed = mesh.vertices[mesh.faces[2:]].reshape(2, -1, 3)
    np.testing.assert_allclose(placed.mean(axis=1)[:, :2].round(1), [[10, 5], [30, 5]])
    seen = next(x for x in mesh.materials if x.name == "mat")
    assert seen.base_color_texture is not None
    np.testing.assert_array_equal(seen.base_color_texture[0, 0], [1, 0, 0])
    assert seen.base_color_wrap == ("clamp", "repeat")
    np.testing.assert_array_equal(seen.emissive, [0.5, 0, 0])
    assert mesh.uvs is not None
    np.testing.assert_array_equal(mesh.uvs[0], [0, 1])  # a stage's (0, 0) is the picture's lower left


def test_a_camera_moves_and_zooms_with_its_apertures(stage: Path) -> None:
    still = read_cameras(stage)[0].to_camera(360, 240)
    assert (still.fx, still.fy, still.cx, still.cy) == pytest.approx((500, 500, 144, 120))
    assert still.near == pytest.approx(0.1)
    moments = sample_cameras(stage, "shot", count=3)
    assert [time for time, _ in moments] == [0, 1, 2]
    assert [one.world[2, 3] for _, one in moments] == pytest.approx([5, 7, 9])
    assert [one.to_camera(360, 240).fx for _, one in moments] == pytest.approx([500, 750, 1000])
    lenses = [one.to_camera(360, 240).exposure for _, one in moments]
    assert [x.focus_distance for x in lenses if x] == pytest.approx([5, 7, 9])
    assert [x.aperture_radius for x in lenses if x] == pytest.approx([1, 1.5, 2])  # 50 tenths of a metre over 2 x 2.5
    twice = moments[0][1].to_camera(360, 240, np.diag([2.0, 2, 2, 1]) @ moments[0][1].world).exposure
    assert twice is not None and (twice.aperture_radius, twice.focus_distance) == pytest.approx((2, 10))
    assert still.exposure is not None and still.exposure.poses is None
    assert len(sample_cameras(stage, "shot", fps=12)) == 25


def test_the_shutter_of_a_moving_camera_is_followed(stage: Path, tmp_path: Path) -> None:
    path = tmp_path / "job.toml"
    (tmp_path / "proxy.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    light = 'lights = [{ type = "point", name = "lamp", position = [0, 2, 0] }]'
    path.write_text(f'proxy = "proxy.obj"\n{light}\ncameras_from = {{ path = "{stage}", fps = 12 }}\n')
    lens = job.load(path).cameras[3].exposure
    path.write_text(path.read_text().replace("fps = 12", "time = 0.25"))
    (then,) = job.load(path).cameras
    assert (then.name, then.time) == ("shot", 0.25) and then.position[2] == pytest.approx(5.5)
    assert lens is not None and lens.poses is not None and lens.shutter == pytest.approx((-0.25 / 24, 0.5 / 24))
    np.testing.assert_allclose(lens.poses[:, 2, 3], 5 + (6 + np.linspace(-0.25, 0.5, 5)) / 12, atol=1e-9)


def test_a_dome_is_turned_to_our_axes_and_a_screen_shows_its_picture(stage: Path) -> None:
    lights = read_lights(stage)
    assert lights.environment is not None
    assert np.argwhere(lights.environment[..., 0] == 7).tolist() == [[1, 6]]  # u = 0.75 looks along +Z
    screen = [x for x in lights.lights if isinstance(x, AreaLight)]
    assert len(screen) == len(lights.lights) == 2  # black cells are left out
    red = next(x for x in screen if x.color[0] == 1)
    assert red.world_from_light[:2, 3].tolist() == pytest.approx([0.5, 0.5])  # the first pixel is at +X, +Y


def test_files_from_elsewhere_are_read_with_a_word_and_count_for_the_digest(tmp_path: Path) -> None:
    from mirelight.io.job.hashing import digest
    from mirelight.io.usd.files import notes_of

    shot = tmp_path / "shot"
    shot.mkdir()
    quad = f'#usda 1.0\n(\n    defaultPrim = "quad"\n)\ndef Mesh "quad"\n{{{_QUAD}}}\n'
    (tmp_path / "quad.usda").write_text(quad.replace('"none"', '"catmullClark"'))
    (shot / "shot.usda").write_text('#usda 1.0\ndef "set" ( references = @../quad.usda@ ) { }\ndef Sphere "ball" { }\n')
    mesh = read_mesh(shot / "shot.usda")
    assert len(mesh.faces) == 2
    said = notes_of(shot / "shot.usda")
    assert said[0] == f"it is read from outside of its folder, too: {tmp_path / 'quad.usda'}"
    assert "/set: a subdivision surface, of which the cage is taken" in said
    assert "/ball: a Sphere, which is not read; save it as a mesh" in said
    before = digest(shot / "shot.usda")
    (tmp_path / "quad.usda").write_text(quad.replace("(-1, 0, -1)", "(-2, 0, -1)"))
    assert digest(shot / "shot.usda") != before
