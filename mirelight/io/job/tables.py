"""The whole job file as one table, and its JSON Schema."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from mirelight.io.job.camera_file_tables import CamerasFrom
from mirelight.io.job.camera_tables import AnyCamera
from mirelight.io.job.fields import Positive, Resolution
from mirelight.io.job.light_tables import Captured, Lightings, Lit
from mirelight.io.job.material_tables import MaterialTable
from mirelight.io.job.mixing import MixTable
from mirelight.io.job.moving import MovedTable
from mirelight.io.job.scene_tables import ObjectTable, Proxy, Splats
from mirelight.io.job.settings_tables import (
    CompositorTable,
    DatasetTable,
    DisplayTable,
    EngineTable,
    OutputTable,
    RelightTable,
    RenderTable,
)
from mirelight.io.job.sweep_tables import SweepTable
from mirelight.model import Profile


class JobTable(Lit):
    """A mirelight job. Paths are relative to the job file; angles are in degrees; colours are linear Rec.709."""

    profile: Profile = Field(
        default="physical",
        description="physical: INRIA splats and physical light units; playcanvas: all as the real-time engine does it.",
    )
    splats: Splats | None = Field(
        default=None,
        description="One or several splat files: a path, a table or a list. Default: the lighting is rendered alone.",
    )
    proxy: Proxy | None = Field(default=None, description="The mesh that stands for the scene: a path or a table.")
    materials: list[MaterialTable] = Field(
        default=[],
        max_length=1000,
        description="What parts of the proxy are made of: how they mirror (with relight.gloss), and what glows.",
    )
    objects: list[ObjectTable] = Field(
        default=[], max_length=1000, description="Objects that are put into the capture, one table each."
    )
    resolution: Resolution = Field(
        default=[1280, 720], description="[width, height] in pixels of cameras that give none."
    )
    resolution_scale: Annotated[Positive, Field(le=16)] = Field(
        default=1.0, description="Scales the image of every camera; 0.25 for a quick look."
    )
    lightings: Lightings = Field(
        default=[],
        description='Several named lightings, instead of lights and environment at the top; or "captured", so that '
        "nothing but objects changes the picture: alone, in a list, or as a table with that name and no light.",
    )
    captured: Captured | None = Field(
        default=None,
        description="The lighting under which the splats were captured: a table like a lighting, the name of one, or "
        '"estimate".',
    )
    sweep: SweepTable | None = Field(default=None, description="Many lightings out of those of the job.")
    mix: MixTable = Field(
        default={},
        description="Factors of lights, groups and environments by name, a number or [r, g, b] each, in every "
        "lighting; in one lighting as a table under its name.",
    )
    moved: MovedTable = Field(
        default={},
        description="Other places of lights by name, [x, y, z] each, in every lighting that has the light; in one "
        "lighting as a table under its name.",
    )
    cameras: list[AnyCamera] = Field(
        default=[],
        max_length=100_000,
        description="Cameras, one table each. Default: the proxy's own, else one that sees all.",
    )
    cameras_from: CamerasFrom = Field(default=[], description="Files whose cameras are added: of glTF or of a capture.")
    render: RenderTable = Field(default=RenderTable(), description="How the lighting is traced.")
    compositor: CompositorTable = Field(default=CompositorTable(), description="How splats become pixels.")
    relight: RelightTable = Field(default=RelightTable(), description="How the lighting meets the splats.")
    display: DisplayTable = Field(default=DisplayTable(), description="How linear light becomes a PNG.")
    output: OutputTable = Field(default=OutputTable(), description="Where frames go, and what is in them.")
    dataset: DatasetTable = Field(default=DatasetTable(), description="Data sets that are written from the frames.")
    engine: EngineTable = Field(default=EngineTable(), description="The real-time engine's own settings.")


def json_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of a job file read as TOML; descriptions hold the units."""
    schema = JobTable.model_json_schema(mode="validation")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **_tidied(schema)}


def _tidied(node: Any) -> Any:
    """Without nulls, which TOML does not have, titles, which repeat the keys, and whole tables as defaults."""
    if isinstance(node, list):
        return [_tidied(item) for item in node]
    if not isinstance(node, dict):
        return node
    out = {
        key: {name: _tidied(value) for name, value in entry.items()}
        if key in ("properties", "$defs")
        else _tidied(entry)
        for key, entry in node.items()
        if key != "title" and not (key == "default" and (entry is None or isinstance(entry, dict)))
    }
    some = [option for option in out.get("anyOf", []) if option != {"type": "null"}]
    if len(some) == 1:
        del out["anyOf"]
        return {**some[0], **out}
    return {**out, "anyOf": some} if some else out
