"""KHR_draco_mesh_compression, by the package DracoPy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.gltf.accessors import accessor_count, accessor_width, denormalised
from mirelight.io.gltf.document import Document
from mirelight.io.gltf.fields import Fields
from mirelight.model import I32


@dataclass(frozen=True, slots=True, eq=False)
class DracoData:
    """A primitive's arrays after Draco's decoding."""

    faces: I32  # (F, 3)
    attributes: dict[str, NDArray[Any]]  # (V, n) each, by glTF name


def decode_draco(document: Document, primitive: Fields) -> DracoData | None:
    """The primitive's compressed triangles and attributes, or None where it is not compressed.

    Attributes are found by the unique ids that the extension names, and normalised as their accessors say.

    Raises:
        InputError: data that cannot be decoded, or that disagrees with the accessors.
    """
    packed = primitive.extension("KHR_draco_mesh_compression")
    if packed is None:
        return None
    import DracoPy

    data = bytes(document.view(packed.integer("bufferView"), packed))
    try:
        mesh = DracoPy.decode(data)
        faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
        by_id = {int(x["unique_id"]): np.asarray(x["data"]) for x in mesh.attributes}
    except Exception as e:  # the decoder has no common base for what it raises
        found = f"Draco data that cannot be decoded ({type(e).__name__})"
        raise packed.fail("", found, "the file is damaged") from None
    ids, accessors = packed.indices("attributes"), primitive.indices("attributes")
    attributes = {}
    for name, unique_id in ids.items():
        if unique_id not in by_id or name not in accessors:
            raise packed.fail(f"attributes.{name}", f"no attribute with the id {unique_id}", "the file is damaged")
        values = by_id[unique_id].reshape(len(by_id[unique_id]), -1)
        wanted = accessor_count(document, accessors[name], primitive), accessor_width(document, accessors[name])
        if values.shape != wanted:
            raise packed.fail(f"attributes.{name}", f"shape {values.shape}, the accessor says {wanted}")
        normalized = document.entry("accessors", accessors[name]).flag("normalized")
        attributes[name] = denormalised(values) if normalized else values
    if faces.ndim != 2 or faces.shape[1:] != (3,) or (len(faces) and int(faces.max()) >= 2**31):
        raise packed.fail("", "no triangles in the Draco data", "export triangles")
    return DracoData(faces.astype(np.int32), attributes)
