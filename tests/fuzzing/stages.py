"""Cases of OpenUSD stages: what a text or binary stage may do to who opens it."""

from __future__ import annotations

import io
import random
import zipfile

from tests.fuzzing import damage
from tests.fuzzing.case import Case, of_files
from tests.fuzzing.sound import TINY, base, job, scene

HEAD = '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Y"\n)\n'
SPLATS = """def ParticleField3DGaussianSplat "dots"
{
    uniform int radiance:sphericalHarmonicsDegree = 0
    point3f[] positions = [(0, 0, 0), (1, 0, 0), (0, 0, 1)]
    quatf[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0), (1, 0, 0, 0)]
    float3[] scales = [(1, 1, 1), (1, 1, 1), (1, 1, 1)]
    float[] opacities = [0.5, 1, 1]
    float3[] radiance:sphericalHarmonicsCoefficients = [(0.2, 0.5, 0.7), (1, 2, -1), (0, 0, 0)]
}
"""
MESH = """def Mesh "floor"
{
    point3f[] points = [(-3, -1, -3), (3, -1, -3), (3, -1, 3), (-3, -1, 3)]
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 3, 2, 1]
    uniform token subdivisionScheme = "none"
}
"""
LIGHTS = """def SphereLight "lamp"
{
    float inputs:intensity = 5
    float inputs:radius = 0.2
}
def DomeLight "sky"
{
    asset inputs:texture:file = @sky.png@
}
def Camera "view"
{
    float focalLength = 50
    float2 clippingRange = (0.1, 100)
}
"""
WHOLE = HEAD + SPLATS + MESH + LIGHTS
_NESTED = "".join(f'def "a{i}" {{\n' for i in range(5000)) + "}\n" * 5000
_DOUBLED = "".join(
    f'def "l{i}" (instanceable = true) {{\n'
    + "".join(f'def "x{k}" (references = </l{i + 1}>) {{ }}\n' for k in range(10))
    + "}\n"
    for i in range(12)
)


def written() -> list[Case]:
    """By hand, one for each kind of trouble."""
    texts = {
        "of itself": HEAD + 'def "a" ( references = @s.usda@ ) { }\n',
        "below itself": '#usda 1.0\n( subLayers = [@s.usda@] )\ndef "a" { }\n',
        "in a circle": HEAD + 'def "a" ( references = </b> ) { }\ndef "b" ( references = </a> ) { }\n',
        "deep": HEAD + _NESTED,
        "doubled": HEAD + _DOUBLED + f'def "l12" {{\n{MESH}}}\n',
        "out of the folder": HEAD + 'def "a" ( payload = @/etc/hostname@ ) { }\n',
        "above the folder": HEAD + 'def "a" ( references = @../../x.usda@ ) { }\n',
        "of other lengths": WHOLE.replace("[0.5, 1, 1]", "[0.5]").replace("[4]", "[4, 4]"),
        "not finite": WHOLE.replace("(1, 0, 0), (0", "(nan, inf, 0), (0"),
        "in no unit": WHOLE.replace("metersPerUnit = 1", "metersPerUnit = nan"),
        "of no degree": WHOLE.replace("Degree = 0", "Degree = -7"),
        "of other faces": WHOLE.replace("[0, 3, 2, 1]", "[0, 3, 2000000000, -1]"),
        "of lights": WHOLE.replace("radius = 0.2", "radius = nan"),
    }
    sky = {"sky.png": base()["sky.png"]}
    out = [
        of_files(f"stage {name}", ("inspect", "s.usda"), sky | {"s.usda": text.encode()})
        for name, text in texts.items()
    ]
    far = HEAD + MESH + LIGHTS.replace("sky.png", "/etc/hostname")
    out.append(of_files("stage with a picture from elsewhere", ("inspect", "s.usda"), {"s.usda": far.encode()}))
    crate = b"PXR-USDC" + bytes([0, 8, 0, 0, 0, 0, 0, 0]) + (2**60).to_bytes(8, "little") + b"\xff" * 200
    out.append(of_files("stage of terabytes", ("inspect", "s.usdc"), {"s.usdc": crate}))
    return out


def drawn(number: int, rng: random.Random) -> Case:
    """A stage with damage."""
    text = damage.text_of(WHOLE.encode(), rng)
    files = scene(**{"s.usda": text})
    if rng.random() < 0.3:
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w") as archive:
            archive.writestr("s.usda", text)
        return of_files(f"{number} usdz", ("inspect", "s.usdz"), {"s.usdz": damage.bytes_of(stream.getvalue(), rng)})
    if rng.random() < 0.7:
        return of_files(f"{number} stage", ("inspect", "s.usda"), files)
    text_of_job = job(splats="s.usda", proxy="s.usda")
    return of_files(f"{number} stage rendered", ("render", "job.toml", *TINY), {**files, "job.toml": text_of_job})
