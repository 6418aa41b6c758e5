"""Values that a stage holds in single precision, kept beside them in full, and in words that UsdLux does not have.

They are JSON in a prim's customData, with a seal over what the prim says in USD's own words: where another program has
changed that, the seal does not fit, and USD's words count.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

from mirelight.io.safety import json_object

_KEY, _SEAL = "mirelight:exact", "mirelight:seal"


def keep(prim: Any, values: dict[str, object]) -> None:
    """Put values beside a prim that is finished."""
    prim.SetCustomDataByKey(_KEY, json.dumps(values))
    prim.SetCustomDataByKey(_SEAL, _seal(prim))


def kept(prim: Any) -> dict[str, Any] | None:
    """The values beside a prim; None where there are none, or it has changed since."""
    text = prim.GetCustomDataByKey(_KEY)
    if not isinstance(text, str) or prim.GetCustomDataByKey(_SEAL) != _seal(prim):
        return None
    return json_object(text)


def _seal(prim: Any) -> str:
    """Of the values that were authored on a prim and of its place in the world."""
    from pxr import Usd, UsdGeom

    said = [str(prim.GetTypeName())]
    for attribute in sorted(prim.GetAuthoredAttributes(), key=lambda x: str(x.GetName())):
        value = attribute.Get()
        shown = str(value.path) if hasattr(value, "resolvedPath") else str(value)
        moments = [f"{at} {attribute.Get(at)}" for at in attribute.GetTimeSamples()]
        said.append(f"{attribute.GetName()} {shown} {len(moments)}" + "".join(f" {x}" for x in moments))
    stage = prim.GetStage()
    said.append(f"{UsdGeom.GetStageMetersPerUnit(stage)} {UsdGeom.GetStageUpAxis(stage)}")
    said.append(str(UsdGeom.XformCache(Usd.TimeCode.Default()).GetLocalToWorldTransform(prim)))
    return hashlib.sha256("\n".join(said).encode()).hexdigest()
