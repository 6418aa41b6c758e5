"""OpenUSD stages written, in metres and Y up: splats here; the rest by `write_mesh` and `write_lights`.

The suffix decides: .usda is text, .usd and .usdc are binary, .usdz is a package of one binary stage and its pictures.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour
from mirelight.base.errors import OutputError
from mirelight.base.extras import require
from mirelight.base.png import png_bytes
from mirelight.io.atomic import write_file
from mirelight.io.environment import write_environment
from mirelight.io.suffixes import USD
from mirelight.io.usd.names import PrimNames
from mirelight.io.usd.take_splats import CAPTURED
from mirelight.model import F32, SplatCloud, SplatColorSpace

# Of the coefficients, in the words of OpenUSD; it has none for the last.
_SPACES: Mapping[SplatColorSpace, str] = MappingProxyType(
    {
        "srgb_rec709_display": "srgb_rec709_scene",
        "lin_rec709_display": "lin_rec709_scene",
        "ACEScct": "acescct_ap1_scene",
    }
)
_ROOT = "/World"


class StageWriter:
    """Collects a stage; :meth:`save` writes it. Each thing gets a prim below /World, with its own name as label."""

    def __init__(self, path: str | Path) -> None:
        """Starts an empty stage.

        Args:
            path: the file that it will be; its suffix decides how.

        Raises:
            BackendError: the library is not installed.
            OutputError: another suffix.
        """
        self._path = Path(path)
        if self._path.suffix.lower() not in USD:
            raise OutputError(f"{path}: a stage is written as one of {', '.join(USD)}")
        require("usd")
        from pxr import Usd, UsdGeom

        self.stage: Any = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageMetersPerUnit(self.stage, 1.0)
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.y)
        self.stage.SetDefaultPrim(UsdGeom.Xform.Define(self.stage, _ROOT).GetPrim())
        self._names = PrimNames()
        self._pictures: dict[str, F32 | NDArray[np.uint8]] = {}

    def picture(self, name: str, pixels: F32) -> tuple[str, str]:
        """Add a linear picture (h, w, 3), written beside the stage, or into its package.

        Returns:
            how the stage names it, and its `sourceColorSpace`: PNG where that holds every value, else OpenEXR.
        """
        bytes_ = np.rint(colour.srgb_encode(np.clip(pixels, 0, 1)) * 255).astype(np.uint8)
        fits = np.array_equal(colour.srgb_decode(bytes_.astype(np.float32) / np.float32(255)), pixels)
        file = f"{self._path.stem}.{name}.{'png' if fits else 'exr'}"
        self._pictures[file] = bytes_ if fits else pixels
        return f"./{file}", "sRGB" if fits else "raw"

    def path(self, name: str, below: str = "") -> str:
        """A free prim path for a thing of this name; what it stands below, "lights" or "proxy/part1", is made."""
        from pxr import UsdGeom

        where = _ROOT
        for part in filter(None, below.split("/")):
            where = f"{where}/{part}"
            if not self.stage.GetPrimAtPath(where):
                UsdGeom.Scope.Define(self.stage, where)
        return f"{where}/{self._names.take(where, name)}"

    def splats(self, cloud: SplatCloud, name: str = "splats", *, captured: SplatCloud | None = None) -> None:
        """A field of splats, every value a float; with those that they were relit from, which are not seen."""
        prim = self._field(cloud, name)
        if captured is None:
            return
        other = self._field(captured, "captured")
        other.GetAttribute("visibility").Set("invisible")
        prim.CreateRelationship(CAPTURED).SetTargets([other.GetPath()])

    def _field(self, cloud: SplatCloud, name: str) -> Any:
        from pxr import UsdVol, Vt

        path = self.path(name)
        prim = self.stage.DefinePrim(path, "ParticleField3DGaussianSplat")
        field = UsdVol.ParticleField3DGaussianSplat(prim)
        xyzw = np.ascontiguousarray(np.roll(cloud.quats, -1, axis=1))
        prim.GetAttribute("positions").Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(cloud.means)))
        prim.GetAttribute("orientations").Set(Vt.QuatfArray.FromNumpy(xyzw))
        prim.GetAttribute("scales").Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(cloud.scales)))
        prim.GetAttribute("opacities").Set(Vt.FloatArray.FromNumpy(np.ascontiguousarray(cloud.opacities)))
        prim.GetAttribute("radiance:sphericalHarmonicsDegree").Set(cloud.sh_degree)
        harmonics = prim.GetAttribute("radiance:sphericalHarmonicsCoefficients")
        harmonics.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(cloud.sh.reshape(-1, 3))))
        harmonics.SetColorSpace(_SPACES[cloud.color_space])
        if cloud.antialiased:
            prim.SetCustomDataByKey("mirelight:antialiased", True)
        reach = 3 * cloud.scales.max(axis=1, keepdims=True)
        low, high = (cloud.means - reach).min(axis=0), (cloud.means + reach).max(axis=0)
        field.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([low, high]).astype(np.float32)))
        prim.GetAttribute("sortingModeHint").Set("zDepth")
        return prim

    def place(self, prim: Any, matrix: NDArray[np.float64], times: Sequence[float] = ()) -> None:
        """Give a prim its place, (4, 4), or one at each of several moments (n, 4, 4) in time codes."""
        from pxr import Gf, UsdGeom

        op = UsdGeom.Xformable(prim).MakeMatrixXform()
        if not len(times):
            op.Set(Gf.Matrix4d(*np.asarray(matrix, np.float64).T.reshape(-1).tolist()))
        for code, one in zip(times, matrix, strict=False):
            op.Set(Gf.Matrix4d(*np.asarray(one, np.float64).T.reshape(-1).tolist()), code)

    def save(self) -> None:
        """Write it; appears whole or not at all. Raises OutputError: it cannot be written."""
        path = self._path
        with tempfile.TemporaryDirectory(prefix="mirelight-usd-") as name:
            folder = Path(name)
            packed = path.suffix.lower() == ".usdz"
            for file, pixels in self._pictures.items():
                place = (folder if packed else path.parent) / file
                if pixels.dtype == np.uint8:
                    write_file(place, png_bytes(pixels.astype(np.uint8, copy=False), {}))
                else:
                    write_environment(place, pixels.astype(np.float32, copy=False))
            made = self._made(folder)
            write_file(path, made.read_bytes())

    def _made(self, folder: Path) -> Path:
        from pxr import Sdf, Tf, UsdUtils

        suffix = self._path.suffix.lower()
        root = folder / ("stage" + (".usdc" if suffix in (".usd", ".usdz") else suffix))
        try:
            sound = self.stage.GetRootLayer().Export(str(root))
            if sound and suffix == ".usdz":
                sound = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(root)), str(folder / "stage.usdz"))
                root = folder / "stage.usdz"
        except Tf.ErrorException as e:
            raise OutputError(f"the USD library could not write the stage: {str(e).splitlines()[-1][:200]}") from None
        if not sound:
            raise OutputError("the USD library could not write the stage; nothing was written")
        return root


def write_splats(cloud: SplatCloud, path: Path) -> None:
    """A stage with one field of splats, which has to stand in its world: metres, Y up. Raises OutputError."""
    writer = StageWriter(path)
    writer.splats(cloud)
    writer.save()
