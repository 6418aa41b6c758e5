"""Croissant metadata of a data set (mlcommons.org/croissant, 1.1): what a frame's row in frames.csv says."""

from __future__ import annotations

import csv
import hashlib
import io
from typing import Any

from mirelight.dataset.layouts.files import Files, FrameRow

TABLE = "frames.csv"
FILE = "croissant.json"
_PLAIN = (
    "arrayShape column conformsTo:dct containedIn citeAs equivalentProperty extract field fileProperty fileObject "
    "fileSet format includes isArray isLiveDataset jsonPath key md5 parentField path recordSet references regex "
    "repeated replace samplingRate separator source subField transform"
)
_FIELDS = {
    "frame": ("sc:Text", "lighting and camera"),
    "view": ("sc:Text", "file name of the camera"),
    "lighting": ("sc:Text", "file name of the lighting"),
    "part": ("sc:Text", "seen, novel_view, novel_light or novel_both"),
    "image": ("sc:Text", "8-bit picture, or the shard that holds it"),
    "linear": ("sc:Text", "linear picture, where there is one"),
    "sample": ("sc:Text", "key in the shard, where there are shards"),
    "width": ("sc:Integer", "pixels"),
    "height": ("sc:Integer", "pixels"),
}


def write(files: Files, name: str, description: str, license: str) -> None:
    """frames.csv and croissant.json. Raises OutputError: they cannot be written."""
    table = _table(files.frames)
    files.text(TABLE, table)
    files.json(FILE, _metadata(name, description, license, hashlib.sha256(table.encode()).hexdigest()))


def _table(rows: list[FrameRow]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(_FIELDS)
    writer.writerows([getattr(row, name) for name in _FIELDS] for row in rows)
    return stream.getvalue()


def _metadata(name: str, description: str, license: str, sha256: str) -> dict[str, Any]:
    context: dict[str, Any] = {
        "@language": "en",
        "@vocab": "https://schema.org/",
        "cr": "http://mlcommons.org/croissant/",
        "dct": "http://purl.org/dc/terms/",
        "rai": "http://mlcommons.org/croissant/RAI/",
        "sc": "https://schema.org/",
        "data": {"@id": "cr:data", "@type": "@json"},
        "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
        "examples": {"@id": "cr:examples", "@type": "@json"},
        **{word: {"@container": "@language"} for word in ("name", "description")},
    }
    for entry in _PLAIN.split():
        word, _, home = entry.partition(":")
        context[word] = f"{home or 'cr'}:{word}"
    fields = [
        {
            "@type": "cr:Field",
            "@id": f"frames/{field}",
            "name": field,
            "description": said,
            "dataType": kind,
            "source": {"fileObject": {"@id": TABLE}, "extract": {"column": field}},
        }
        for field, (kind, said) in _FIELDS.items()
    ]
    file = {"@type": "cr:FileObject", "@id": TABLE, "name": TABLE, "contentUrl": TABLE, "encodingFormat": "text/csv"}
    return {
        "@context": context,
        "@type": "sc:Dataset",
        "name": name,
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "description": description,
        **({"license": license} if license else {}),
        "version": "1.0.0",
        "distribution": [{**file, "sha256": sha256}],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "frames",
                "name": "frames",
                "key": {"@id": "frames/frame"},
                "field": fields,
            }
        ],
    }
