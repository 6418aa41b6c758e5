"""A proxy written as meshes of purpose proxy, one for each of its objects, with UsdPreviewSurface materials."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.usd.write import StageWriter
from mirelight.model import F32, I32, Material, ProxyMesh
from mirelight.model.scene import Wraps

_PLACE = "proxy"  # below /World


def add_proxy(writer: StageWriter, mesh: ProxyMesh) -> None:
    """The meshes below /World/proxy: light falls on them, viewers do not draw them. Their materials have the colours of
    the file, or the one albedo that takes their place, and what glows."""
    colours = mesh.vertex_colors if mesh.albedo is None else None
    materials = [_material(writer, x, mesh, colours) for x in mesh.materials]
    for number, (name, faces) in enumerate(_runs(mesh)):
        prim = _mesh(writer, f"{_PLACE}/part{number + 1}", name, mesh, faces, colours)
        _bind(prim, materials, mesh.owners[faces])


def _runs(mesh: ProxyMesh) -> Iterator[tuple[str, NDArray[np.int64]]]:
    """Faces that follow each other in one object, with its name."""
    every = np.arange(len(mesh.faces))
    if mesh.face_nodes is None:
        yield mesh.nodes[0], every
        return
    ends = np.flatnonzero(np.diff(mesh.face_nodes)) + 1
    for some in np.split(every, ends):
        yield mesh.nodes[mesh.face_nodes[some[0]]], some


def _mesh(
    writer: StageWriter, below: str, name: str, mesh: ProxyMesh, faces: NDArray[np.int64], colours: F32 | None
) -> Any:
    from pxr import Sdf, UsdGeom, Vt

    used, corners = np.unique(mesh.faces[faces], return_inverse=True)
    points = np.ascontiguousarray(mesh.vertices[used])
    out = UsdGeom.Mesh.Define(writer.stage, writer.path(name, below))
    out.CreateSubdivisionSchemeAttr("none")
    out.CreatePurposeAttr(UsdGeom.Tokens.proxy)
    out.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    out.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    out.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(corners.reshape(-1), np.int32)))
    out.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)])))
    out.CreateDoubleSidedAttr(True)
    if mesh.normals is not None:
        out.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.normals[used])))
        out.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    if colours is not None:
        shown = out.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
        shown.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(colours[used])))
    if mesh.uvs is not None:
        st = UsdGeom.PrimvarsAPI(out).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
        flipped = mesh.uvs[used].copy()
        flipped[:, 1] = 1 - flipped[:, 1]  # a stage counts v from the bottom
        st.Set(Vt.Vec2fArray.FromNumpy(flipped))
    return out


def _bind(mesh: Any, materials: Sequence[Any], which: I32) -> None:
    """The material of all faces, or each one's of those that have it."""
    from pxr import UsdGeom, UsdShade, Vt

    used = np.unique(which)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(materials[used[0]])
    if len(used) == 1:
        return
    api = UsdShade.MaterialBindingAPI(mesh)
    for i in used:
        faces = Vt.IntArray.FromNumpy(np.flatnonzero(which == i).astype(np.int32))
        subset = api.CreateMaterialBindSubset(f"faces{i + 1}", faces, UsdGeom.Tokens.face)
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(materials[i])
    api.SetMaterialBindSubsetsFamilyType(UsdGeom.Tokens.partition)


def _material(writer: StageWriter, material: Material, mesh: ProxyMesh, colours: F32 | None) -> Any:
    from pxr import Sdf, UsdShade

    path = writer.path(material.name, "materials")
    out = UsdShade.Material.Define(writer.stage, path)
    surface = UsdShade.Shader.Define(writer.stage, f"{path}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(material.roughness)
    surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(material.metallic)
    out.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    base = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    glow = surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f)
    if mesh.albedo is not None:
        base.Set(_triple(mesh.albedo))
    elif material.base_color_texture is not None:
        shown = material.base_color_texture, material.base_color, material.base_color_wrap
        _texture(writer, path, "base", base, shown)
    elif colours is not None:
        reader = UsdShade.Shader.Define(writer.stage, f"{path}/colours")
        reader.CreateIdAttr("UsdPrimvarReader_float3")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
        base.ConnectToSource(reader.CreateOutput("result", Sdf.ValueTypeNames.Float3))
    else:
        base.Set(_triple(material.base_color))
    if material.emissive_texture is not None:
        _texture(writer, path, "glow", glow, (material.emissive_texture, material.emissive, material.emissive_wrap))
    else:
        glow.Set(_triple(material.emissive))
    return out


def _texture(writer: StageWriter, path: str, name: str, slot: Any, shown: tuple[F32, Any, Wraps]) -> None:
    """A picture, its factor and how it repeats, in the place of a colour."""
    from pxr import Sdf, UsdShade

    pixels, factor, wraps = shown
    kinds = Sdf.ValueTypeNames
    reader = UsdShade.Shader.Define(writer.stage, f"{path}/st")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", kinds.String).Set("st")
    texture = UsdShade.Shader.Define(writer.stage, f"{path}/{name}")
    texture.CreateIdAttr("UsdUVTexture")
    file, space = writer.picture(f"{path.rpartition('/')[2]}.{name}", pixels)
    texture.CreateInput("file", kinds.Asset).Set(Sdf.AssetPath(file))
    texture.CreateInput("sourceColorSpace", kinds.Token).Set(space)
    texture.CreateInput("scale", kinds.Float4).Set((*_triple(factor), 1.0))
    for side, wrap in zip(("wrapS", "wrapT"), wraps, strict=True):
        texture.CreateInput(side, kinds.Token).Set(wrap)
    texture.CreateInput("st", kinds.Float2).ConnectToSource(reader.CreateOutput("result", kinds.Float2))
    slot.ConnectToSource(texture.CreateOutput("rgb", kinds.Float3))


def _triple(values: Any) -> tuple[float, float, float]:
    red, green, blue = (float(x) for x in values)
    return red, green, blue
