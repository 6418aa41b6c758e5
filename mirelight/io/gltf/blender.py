"""What Blender's glTF exporter makes of lights.

Blender gives lamps radiant power (W) and suns irradiance (W/m²); KHR_lights_punctual wants candela and lux. Its
exporter (Khronos glTF Blender I/O, "Lighting Mode") writes, for a lamp of P watts and a sun of strength E,

| mode      | point, spot        | sun     |
|---|---|---|
| Standard (the default) | 683 P / (4 pi) | 683 E |
| Unitless  | P / (4 pi)         | E       |

683 lm/W is the luminous efficacy of green light of 555 nm (SI), taken there for all light. In Blender's own pictures a
lamp of P watts shows what P / (4 pi) candela show here. The file does not say which mode wrote it.
"""

from __future__ import annotations

from dataclasses import replace

from mirelight.base.errors import printable
from mirelight.io.gltf.document import Document
from mirelight.model import Light

EFFICACY = 683.0  # lm/W
_NAME = "Blender I/O"  # "Khronos glTF Blender I/O v4.2.60", and forks that keep the name


def exporter(document: Document) -> str | None:
    """What the file says wrote it, where that is Blender's exporter."""
    generator = document.top.child("asset").values.get("generator")
    if not isinstance(generator, str) or _NAME not in generator:
        return None
    return generator[:60]


def as_in_blender(light: Light) -> Light:
    """A light of the exporter's Standard mode, as strong as in Blender's own pictures."""
    return replace(light, intensity=light.intensity / EFFICACY)


def note(file: str, generator: str, remedy: str) -> str:
    """The line about lights whose unit nobody has chosen."""
    return (
        f"{printable(file)}: lights written by {generator!r} are {EFFICACY:g} times as strong as Blender shows them "
        f'(unless it was told "Unitless"); {remedy}'
    )
