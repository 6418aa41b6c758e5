"""OpenUSD stages written: splats, a proxy, lights and cameras, in metres and Y up.

The suffix decides: .usda is text, .usd and .usdc are binary, .usdz is a package of one binary stage and its pictures.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import OutputError
from mirelight.base.extras import require
from mirelight.io.atomic import atomic_path
from mirelight.io.environment import write_environment
from mirelight.io.suffixes import USD
from mirelight.io.usd.names import PrimNames
from mirelight.model import F32, ProxyMesh, SplatCloud
from mirelight.model.scene import holds_light

SPLAT_SPACE = "srgb_rec709_scene"  # of the coefficients: display-encoded colours
LIGHT_SPACE = "lin_rec709_scene"  # the same of splats that hold linear light
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
        self._pictures: dict[str, F32] = {}

    def picture(self, name: str, pixels: F32) -> str:
        """Add a linear picture (h, w, 3), written beside the stage, or into its package; how the stage names it."""
        file = f"{self._path.stem}.{name}.exr"
        self._pictures[file] = pixels
        return f"./{file}"

    def path(self, name: str, below: str = "") -> str:
        """A free prim path for a thing of this name."""
        where = f"{_ROOT}/{below}" if below else _ROOT
        if below and not self.stage.GetPrimAtPath(where):
            from pxr import UsdGeom

            UsdGeom.Scope.Define(self.stage, where)
        return f"{where}/{self._names.take(where, name)}"

    def splats(self, cloud: SplatCloud, name: str = "splats", *, seen: bool = True) -> None:
        """A field of splats, every value a float; one that is not seen is there to be switched on."""
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
        harmonics.SetColorSpace(LIGHT_SPACE if holds_light(cloud.color_space) else SPLAT_SPACE)
        if cloud.antialiased:
            prim.SetCustomDataByKey("mirelight:antialiased", True)
        reach = 3 * cloud.scales.max(axis=1, keepdims=True)
        low, high = (cloud.means - reach).min(axis=0), (cloud.means + reach).max(axis=0)
        field.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([low, high]).astype(np.float32)))
        prim.GetAttribute("sortingModeHint").Set("zDepth")
        if not seen:
            prim.GetAttribute("visibility").Set("invisible")

    def proxy(self, mesh: ProxyMesh, name: str = "proxy") -> None:
        """A mesh of purpose proxy: light falls on it, viewers do not draw it."""
        from pxr import UsdGeom, Vt

        prim = UsdGeom.Mesh.Define(self.stage, self.path(name))
        prim.CreateSubdivisionSchemeAttr("none")
        prim.CreatePurposeAttr(UsdGeom.Tokens.proxy)
        prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.vertices)))
        prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.faces), 3, np.int32)))
        prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(mesh.faces.reshape(-1))))
        prim.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack(mesh.bounds).astype(np.float32)))
        prim.CreateDoubleSidedAttr(True)
        if mesh.normals is not None:
            prim.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.normals)))
            prim.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        if mesh.vertex_colors is not None:
            colours = prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
            colours.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.vertex_colors)))

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
                write_environment((folder if packed else path.parent) / file, pixels)
            made = self._made(folder)
            with atomic_path(path) as temporary:
                temporary.write_bytes(made.read_bytes())

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
