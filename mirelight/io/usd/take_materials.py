"""Materials of an open stage: base colour and emission of UsdPreviewSurface, with their textures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.usd.rows import MaterialRow
from mirelight.io.usd.stage import Stage

_WRAPS = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp", "black": "clamp"}


class Materials:
    """The materials in use, in the order in which they are met; index -1 is none."""

    def __init__(self, stage: Stage, textures: bool) -> None:
        self._stage = stage
        self._textures = textures
        self._index: dict[str, int] = {}
        self._uv: dict[int, str] = {}
        self._colours = {-1: "displayColor"}
        self.rows: list[MaterialRow] = []

    def of(self, prim: Any) -> int:
        """The material bound to a prim."""
        from pxr import UsdShade

        found = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
        return self._of(found) if found else -1

    def of_faces(self, prim: Any, bound: int) -> NDArray[np.int64]:
        """(faces of the mesh,) the material of each: subsets have their own."""
        from pxr import UsdGeom

        mesh = UsdGeom.Mesh(prim)
        count = len(mesh.GetFaceVertexCountsAttr().Get(self._stage.code) or [])
        out = np.full(count, bound, np.int64)
        for subset in UsdGeom.Subset.GetGeomSubsets(mesh, UsdGeom.Tokens.face, "materialBind"):
            own = self.of(subset.GetPrim())
            faces = np.array(subset.GetIndicesAttr().Get(self._stage.code) or [], dtype=np.int64)
            out[faces[(faces >= 0) & (faces < count)]] = own
        return out

    def uv_name(self, material: int) -> str:
        """The primvar that its textures are read by."""
        return self._uv.get(material, "st")

    def colour_name(self, material: int) -> str | None:
        """The primvar that it takes its base colour from; None: from none."""
        return self._colours.get(material)

    def _of(self, material: Any) -> int:
        path = str(material.GetPath())
        if path not in self._index:
            self._index[path] = len(self.rows)
            self.rows.append(self._row(material, path))
        return self._index[path]

    def _row(self, material: Any, path: str) -> MaterialRow:
        surface = material.ComputeSurfaceSource()[0]
        name = material.GetPrim().GetName()
        if not surface or surface.GetIdAttr().Get() != "UsdPreviewSurface":
            self._stage.note(f"{path}: a material without UsdPreviewSurface, taken as gray")
            return MaterialRow(name=name, prim=path, base_color=[0.18, 0.18, 0.18])
        base, base_file, base_raw, base_wrap = self._input(surface, "diffuseColor", [0.18, 0.18, 0.18])
        glow, glow_file, glow_raw, glow_wrap = self._input(surface, "emissiveColor", [0.0, 0.0, 0.0])
        return MaterialRow(
            name=name,
            prim=path,
            base_color=base,
            base_color_file=base_file,
            base_color_raw=base_raw,
            base_color_wrap=base_wrap,
            emissive=glow,
            emissive_file=glow_file,
            emissive_raw=glow_raw,
            emissive_wrap=glow_wrap,
        )

    def _input(self, surface: Any, name: str, fallback: list[float]) -> tuple[list[float], str, bool, list[str]]:
        """An input's colour or factor, its picture, whether that is linear, and how it repeats."""
        from pxr import UsdShade

        wraps = ["repeat", "repeat"]
        found = surface.GetInput(name)
        if not found:
            return fallback, "", False, wraps
        if not found.HasConnectedSource():
            return _colour(found.Get(self._stage.code), fallback), "", False, wraps
        for attribute in UsdShade.Utils.GetValueProducingAttributes(found):
            shader = UsdShade.Shader(attribute.GetPrim())
            if attribute.GetPrim() and shader and shader.GetIdAttr().Get() == "UsdUVTexture":
                return self._texture(shader)
            if attribute.GetPrim() and shader and shader.GetIdAttr().Get() == "UsdPrimvarReader_float3":
                varname = shader.GetInput("varname")
                if name == "diffuseColor" and varname:
                    self._colours[len(self.rows)] = str(varname.Get() or "displayColor")
                    return [1.0, 1.0, 1.0], "", False, wraps
            return _colour(attribute.Get(self._stage.code), fallback), "", False, wraps
        return fallback, "", False, wraps

    def _texture(self, shader: Any) -> tuple[list[float], str, bool, list[str]]:
        from pxr import UsdShade

        def value(name: str) -> Any:
            found = shader.GetInput(name)
            return found.Get(self._stage.code) if found else None

        wraps = [_WRAPS.get(str(value(x)), "repeat") for x in ("wrapS", "wrapT")]
        factor = _colour(value("scale"), [1.0, 1.0, 1.0])
        if value("bias") is not None and any(_colour(value("bias"), [0.0] * 3)):
            self._stage.note(f"{shader.GetPath()}: the bias of a texture, which is not followed")
        st = shader.GetInput("st")
        for attribute in UsdShade.Utils.GetValueProducingAttributes(st) if st else []:
            reader = UsdShade.Shader(attribute.GetPrim())
            if reader and reader.GetInput("varname"):
                self._uv[len(self.rows)] = str(reader.GetInput("varname").Get() or "st")
            elif reader and reader.GetIdAttr().Get() == "UsdTransform2d":
                self._stage.note(f"{reader.GetPath()}: a transform of textures, which is not followed")
        if not self._textures:
            return factor, "", False, wraps
        name = self._stage.asset(value("file"), shader.GetPrim())
        raw = str(value("sourceColorSpace") or "auto") == "raw"
        return factor, name, raw, wraps


def _colour(value: Any, fallback: list[float]) -> list[float]:
    try:
        found = [float(x) for x in list(value)[:3]]
    except (TypeError, ValueError):
        return fallback
    sound = len(found) == 3 and all(np.isfinite(found))
    return [max(x, 0.0) for x in found] if sound else fallback
