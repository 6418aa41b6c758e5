"""The kinds of value that a job file holds, and the base of its tables.

Checks that pydantic has no rule for raise through :func:`wrong`, so that every message has the same two halves: what
was found, and what to do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, TypeAlias

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo
from pydantic_core import PydanticCustomError

from mirelight.io.job.words import shown, shown_path

LARGEST = 1e9  # no length, position or intensity of a job is larger; keeps float32 arithmetic far from overflow


def wrong(found: str, remedy: str, *, at: str = "") -> PydanticCustomError:
    """An error of a validator; `at` names the key of the table that the error is about, where it is one."""
    return PydanticCustomError("mirelight", "{found}; {remedy}", {"found": found, "remedy": remedy, "at": at})


class Table(BaseModel):
    """A table of the job file: no unknown keys, no conversions between types."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


def given(table: Table, *names: str) -> list[str]:
    """Those of `names` that the table sets."""
    return [name for name in names if getattr(table, name) is not None]


def one_way(table: Table, *ways: tuple[str, ...], needed: str = "") -> None:
    """Check that at most one of several groups of keys is used; with `needed` (what to do), that one is."""
    used = [way for way in ways if given(table, *way)]
    if len(used) > 1:
        a, b = given(table, *used[0])[0], given(table, *used[1])[0]
        raise wrong(f"both {a} and {b} are given", f"keep one of them ({a} or {b})", at=b)
    if needed and not used:
        raise wrong("nothing is given for it", needed)


# --- numbers ---------------------------------------------------------------------------------------------------------

Number: TypeAlias = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
Positive: TypeAlias = Annotated[float, Field(gt=0, le=LARGEST, allow_inf_nan=False)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Share: TypeAlias = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Degrees: TypeAlias = Annotated[float, Field(ge=-3600, le=3600, allow_inf_nan=False)]
FieldOfView: TypeAlias = Annotated[float, Field(ge=0.01, le=179, allow_inf_nan=False)]
Elevation: TypeAlias = Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]  # degrees
Kelvin: TypeAlias = Annotated[float, Field(ge=1000, le=40_000, allow_inf_nan=False)]
Seed: TypeAlias = Annotated[int, Field(ge=0, le=2**31 - 1)]
Pixels: TypeAlias = Annotated[int, Field(ge=1, le=65536)]

# --- vectors ---------------------------------------------------------------------------------------------------------


def _not_zero(vector: list[float]) -> list[float]:
    if not math.hypot(*vector) > 1e-12:
        raise wrong("a vector of length zero", "give a direction")
    return vector


Vec3: TypeAlias = Annotated[list[Number], Field(min_length=3, max_length=3)]
Direction: TypeAlias = Annotated[Vec3, AfterValidator(_not_zero)]
Quaternion: TypeAlias = Annotated[list[Number], Field(min_length=4, max_length=4), AfterValidator(_not_zero)]


def _low_and_high(corners: list[list[float]]) -> list[list[float]]:
    if any(a > b for a, b in zip(*corners, strict=True)):
        raise wrong("a first corner above the second", "give the lowest x, y and z first, then the highest")
    return corners


Euler: TypeAlias = Annotated[list[Degrees], Field(min_length=3, max_length=3)]
Bounds: TypeAlias = Annotated[list[Vec3], Field(min_length=2, max_length=2), AfterValidator(_low_and_high)]
Color: TypeAlias = Annotated[list[NotNegative], Field(min_length=3, max_length=3)]
DisplayColor: TypeAlias = Annotated[list[Share], Field(min_length=3, max_length=3)]
Resolution: TypeAlias = Annotated[list[Pixels], Field(min_length=2, max_length=2)]


def _affine(rows: list[list[float]]) -> list[list[float]]:
    if rows[3] != [0, 0, 0, 1]:
        raise wrong(
            "a last row that is not [0, 0, 0, 1]", "give the matrix row by row, the translation in its last column"
        )
    (a, b, c, _), (d, e, f, _), (g, h, i, _), _ = rows
    if abs(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)) < 1e-18:
        raise wrong("a matrix that flattens space", "give an invertible matrix")
    return rows


_Row: TypeAlias = Annotated[list[Number], Field(min_length=4, max_length=4)]
Matrix: TypeAlias = Annotated[list[_Row], Field(min_length=4, max_length=4), AfterValidator(_affine)]


def _gray(value: Any) -> Any:
    return [value] * 3 if isinstance(value, int | float) and not isinstance(value, bool) else value


ColorOrGray: TypeAlias = Annotated[Color, BeforeValidator(_gray, json_schema_input_type=NotNegative | Color)]

# --- names and paths -------------------------------------------------------------------------------------------------


def _file_name(name: str) -> str:
    if name[0] == "." or any(c in '/\\:*?"<>|' or not c.isprintable() for c in name):
        raise wrong(f"{shown(name)} cannot be part of a file name", "use letters, digits, spaces, '-', '_' and '.'")
    return name


Name: TypeAlias = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_file_name)]


def _printable(name: str) -> str:
    if not name.isprintable():
        raise wrong(f"{shown(name)} has characters that cannot be shown", "use letters, digits, spaces, '-' and '_'")
    return name


LightName: TypeAlias = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_printable)]


def existing(value: str, info: ValidationInfo) -> str:
    """Checks the path against the job's folder, so that a missing file is reported with the job's other mistakes."""
    if "://" in value:
        raise wrong(f"{shown_path(value)} is an address", "fetch the file and name its path")
    base = (info.context or {}).get("base")
    try:
        missing = base is not None and not (base / value).exists()
    except OSError as e:
        raise wrong(
            f"{shown_path(value)} cannot be reached ({e.strerror})", "check the path and its folders' permissions"
        ) from None
    except ValueError:
        raise wrong(f"{shown_path(value)} cannot be a path", "name a file, relative to the job file") from None
    if missing:
        raise wrong(f"there is no file {shown_path(value)}", f"paths are relative to the job file's folder, {base}")
    return value


AssetPath: TypeAlias = Annotated[str, Field(min_length=1, max_length=4096), AfterValidator(existing)]
CAPTURED = "captured"  # the lighting of this name that has no light: the captured one
PROXY = "proxy"  # in lights_from and cameras_from: the proxy's own file
SPLATS = "splats"  # as the proxy's path: it is made from them


def _existing_or_proxy(value: str, info: ValidationInfo) -> str:
    return value if value == PROXY else existing(value, info)


def _existing_or_splats(value: str, info: ValidationInfo) -> str:
    return value if value == SPLATS else existing(value, info)


MeshPath: TypeAlias = Annotated[str, Field(min_length=1, max_length=4096), AfterValidator(_existing_or_splats)]
GltfPath: TypeAlias = Annotated[str, Field(min_length=1, max_length=4096), AfterValidator(_existing_or_proxy)]


def path_as_table(value: Any) -> Any:
    """The short form: a string stands for a table with that path."""
    return {"path": value} if isinstance(value, str) else value


LIT = ("lights", "lights_from", "environment")  # what a lighting's light is said by


def has_light(table: Mapping[str, Any]) -> bool:
    """Whether a lighting, by its values, has light of its own."""
    return any(table.get(key) for key in LIT)


def is_captured(table: Mapping[str, Any]) -> bool:
    """Whether a lighting, by its values, is the captured light: it has that name, and no light of its own."""
    return table.get("name") == CAPTURED and not has_light(table)


def lightings_as_tables(value: Any) -> Any:
    """The word for the captured light, alone or in a list, as a table that has the name alone."""
    listed = value if isinstance(value, list) else [value]
    return [{"name": CAPTURED} if x == CAPTURED else x for x in listed] if CAPTURED in listed else value


def paths_as_tables(value: Any) -> Any:
    """One string or table, or a list of strings and tables, as a list of tables."""
    items = value if isinstance(value, list) else [value]
    return [path_as_table(item) for item in items]
