"""Whether what a glTF file is packed with can be unpacked here, told before anything of it is read."""

from __future__ import annotations

from pathlib import Path

from mirelight.base import extras
from mirelight.io.gltf.document import read_document

_MESHOPT = "EXT_meshopt_compression"


def refuse_without_decoder(path: Path) -> None:
    """Raises InputError where a file cannot be read for want of the decoder; opens it only where that is missing."""
    if not extras.missing("formats"):
        return
    top = read_document(path).top
    if _MESHOPT in top.texts("extensionsRequired"):
        raise top.fail("extensionsRequired", "meshopt compression", extras.remedy("formats"))
