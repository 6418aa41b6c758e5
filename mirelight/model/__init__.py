"""The types that cross module borders: frozen, NumPy only, every array checked and read-only.

Shapes and units stand in each field's comment. H, W: image rows and columns. Light is linear Rec.709; see
`mirelight.base.conventions` for axes.
"""

from __future__ import annotations

from mirelight.base.backend import Variant
from mirelight.base.colour import ToneCurve
from mirelight.base.layouts import Layout
from mirelight.model.arrays import F32, F64, I32, frozen_array
from mirelight.model.cameras import Camera
from mirelight.model.deferred import Deferred
from mirelight.model.digests import digest
from mirelight.model.exposure import Exposure
from mirelight.model.ies import IesProfile
from mirelight.model.inserted import Inserted, Scatter
from mirelight.model.light_classes import (
    LIGHT_CLASSES,
    DirectionalLight,
    Falloff,
    Light,
    ParallelLight,
    PointLight,
    PunctualLight,
    SpotLight,
    SunLight,
)
from mirelight.model.light_kinds import LightBase, LightKind, PosedLight
from mirelight.model.lights import Environment, EstimatedSky, LayerFactor, Lighting, SkyModel
from mirelight.model.profiles import PROFILES, Profile, ProfileRules, RelightMode, Space, SplatRules, rules_of
from mirelight.model.recipe import OwnSplats, ProxyRecipe
from mirelight.model.relight_settings import RelightSettings
from mirelight.model.results import Frame, LightingBuffer, LightLayer, Matte, Provenance, SplatLayer
from mirelight.model.scene import Material, ProxyMesh, SplatCloud, SplatColorSpace, SplatFile, SplatWorld, Wrap, Wraps
from mirelight.model.settings import (
    Backdrop,
    CompositorSettings,
    Compression,
    DatasetSettings,
    DisplaySettings,
    DisplayView,
    EngineSettings,
    Ground,
    HdrFormat,
    HeldOut,
    Indirect,
    Job,
    OutputSettings,
    RenderSettings,
    Sort,
)
from mirelight.model.surface_cache import CellLight, PointLayers, SurfaceCache, SurfaceCells, SurfaceTransport
from mirelight.model.surface_lights import AreaLight, TubeLight

__all__ = [
    "F32",
    "F64",
    "I32",
    "LIGHT_CLASSES",
    "PROFILES",
    "AreaLight",
    "Backdrop",
    "Camera",
    "CellLight",
    "CompositorSettings",
    "Compression",
    "DatasetSettings",
    "Deferred",
    "DirectionalLight",
    "DisplaySettings",
    "DisplayView",
    "EngineSettings",
    "Environment",
    "EstimatedSky",
    "Exposure",
    "Falloff",
    "Frame",
    "Ground",
    "HdrFormat",
    "HeldOut",
    "IesProfile",
    "Indirect",
    "Inserted",
    "Job",
    "LayerFactor",
    "Layout",
    "Light",
    "LightBase",
    "LightKind",
    "LightLayer",
    "Lighting",
    "LightingBuffer",
    "Material",
    "Matte",
    "OutputSettings",
    "OwnSplats",
    "ParallelLight",
    "PointLayers",
    "PointLight",
    "PosedLight",
    "Profile",
    "ProfileRules",
    "Provenance",
    "ProxyMesh",
    "ProxyRecipe",
    "PunctualLight",
    "RelightMode",
    "RelightSettings",
    "RenderSettings",
    "Scatter",
    "SkyModel",
    "Sort",
    "Space",
    "SplatCloud",
    "SplatColorSpace",
    "SplatFile",
    "SplatLayer",
    "SplatRules",
    "SplatWorld",
    "SpotLight",
    "SunLight",
    "SurfaceCache",
    "SurfaceCells",
    "SurfaceTransport",
    "ToneCurve",
    "TubeLight",
    "Variant",
    "Wrap",
    "Wraps",
    "digest",
    "frozen_array",
    "rules_of",
]
