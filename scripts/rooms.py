"""The rooms of the package, in order: the import rule, its table in CONTRIBUTING.md and its picture in the docs.

    python scripts/rooms.py    # writes table and picture again

A room imports what stands below it, and nothing beside or above it; tests/unit/test_imports.py holds the code against
this list, and page and picture against what is made here.
"""

from __future__ import annotations

import ast
import importlib.util
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "mirelight"
PAGE = ROOT / "CONTRIBUTING.md"
PICTURE = ROOT / "docs" / "pictures" / "rooms.svg"


@dataclass(frozen=True, slots=True)
class Room:
    """A package, and what lives in it."""

    name: str
    holds: str


# From the top. Rooms of one row stand on the same floor.
FLOORS: tuple[tuple[Room, ...], ...] = (
    (Room("cli", "parse, load, call, write; no logic"),),
    (
        Room(
            "apps",
            "what people do: bake, demo, doctor, explain, first job, inspect, match, mixer, show, studio, watch",
        ),
    ),
    (
        Room("batch", "many frames: executor, forecast, previews, workers, shards, Dask, verify, status"),
        Room("dataset", "layouts of data sets; frames mixed from kept layers"),
    ),
    (Room("store", "frames, journal, claims and kept light in a folder; the index of layers"),),
    (
        Room(
            "pipeline", "a job made ready; light of a view, on the surface, on splats; stages, keys, plan, diagnostics"
        ),
    ),
    (
        Room("proxy", "meshes from splats, and how well a mesh fits them"),
        Room("estimate", "the light that splats were captured under"),
        Room("compare", "pictures scored against others, and the report"),
    ),
    (
        Room("relighting", "one module per relight mode; what turns light into frames"),
        Room("lighting", "the path tracer and the real-time engine's light, on Mitsuba and Dr.Jit"),
        Room("compositor", "splats to pixels, on Dr.Jit; `reference` is its NumPy oracle"),
        Room("io", "one module per file format, and the job file; makes nothing"),
    ),
    (Room("model", "the types that cross rooms; unit lights, PlayCanvas' lights, checks of cameras"),),
    (Room("base", "errors, progress, machine, extras, conventions, colour, spherical harmonics, backend, version"),),
)
LEVEL = {room.name: len(FLOORS) - row for row, floor in enumerate(FLOORS) for room in floor}  # 1: the ground
_MARKS = "<!-- rooms: written by scripts/rooms.py -->", "<!-- end of rooms -->"


def sources(package: Path = PACKAGE) -> list[Path]:
    """Every module."""
    return sorted(package.rglob("*.py"))


def room_of(path: Path, package: Path = PACKAGE) -> str:
    """The room of a file; empty for the package's own `__init__`, its name for `__main__`."""
    parts = path.relative_to(package).with_suffix("").parts
    return "" if parts == ("__init__",) else parts[0]


@cache
def parsed(path: Path) -> ast.Module:
    """A module's tree."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path: Path, package: Path = PACKAGE) -> tuple[str, ...]:
    """Every module that a file imports, as absolute dotted names: those inside functions and under TYPE_CHECKING, and
    those that a string names, too."""
    return tuple(_imports(path, package))


def _imports(path: Path, package: Path) -> Iterator[str]:
    own = "mirelight." + ".".join(path.relative_to(package).parent.parts)
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            home = node.module or ""
            if node.level:
                home = importlib.util.resolve_name("." * node.level + home, own.rstrip("."))
            yield from (f"mirelight.{alias.name}" for alias in node.names) if home == "mirelight" else (home,)
        elif isinstance(node, ast.Constant) and re.fullmatch(r"mirelight(\.\w+)+", str(node.value)):
            yield str(node.value)


def rooms_used(path: Path, package: Path = PACKAGE) -> set[str]:
    """Other rooms that a file imports from; names of the package itself (its calls) are none."""
    used = {name.split(".")[1] for name in imports(path, package) if name.startswith("mirelight.")}
    there = {x for x in used if (package / x).is_dir() or (package / f"{x}.py").is_file()}
    return there - {room_of(path, package)}


def arrows() -> dict[str, set[str]]:
    """Which rooms each room imports from."""
    out: dict[str, set[str]] = {}
    for path in sources():
        if room_of(path) in LEVEL:
            out.setdefault(room_of(path), set()).update(rooms_used(path))
    return out


def table() -> str:
    """The rooms as a Markdown table, from the top floor down."""
    rows = ["| floor | room | what lives there |", "|---|---|---|"]
    rows += [f"| {LEVEL[room.name]} | `{room.name}` | {room.holds} |" for floor in FLOORS for room in floor]
    return "\n".join(rows)


def page() -> str:
    """CONTRIBUTING.md with the table of now."""
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(_MARKS[0])
    return f"{before}{_MARKS[0]}\n\n{table()}\n\n{_MARKS[1]}{rest.partition(_MARKS[1])[2]}"


def picture() -> str:
    """The rooms as SVG: each on its floor, with an arrow to what it imports but for what it reaches through others."""
    width, height, box, tall = 860, 84 * len(FLOORS) + 4, 110, 36
    middle = {
        room.name: ((i + 1) * width / (len(floor) + 1), 84 * row + 30)
        for row, floor in enumerate(FLOORS)
        for i, room in enumerate(floor)
    }
    straight = arrows()
    reached = {name: _reached(name, straight) for name in straight}
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="#777"/></marker></defs>',
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
    ]
    for name in sorted(straight, key=lambda x: (-LEVEL[x], x)):
        for other in sorted(straight[name]):
            if any(other in reached[x] for x in straight[name] - {other}):
                continue
            (x, y), (u, v) = middle[name], middle[other]
            lines.append(
                f'<line x1="{x:.0f}" y1="{y + tall / 2:.0f}" x2="{u:.0f}" y2="{v - tall / 2:.0f}" stroke="#777" '
                'marker-end="url(#tip)"/>'
            )
    for name, (x, y) in middle.items():
        lines.append(
            f'<rect x="{x - box / 2:.0f}" y="{y - tall / 2:.0f}" width="{box}" height="{tall}" rx="6" fill="#eef2f8" '
            'stroke="#44546a"/>'
        )
        lines.append(f'<text x="{x:.0f}" y="{y + 5:.0f}" text-anchor="middle" font-size="15" fill="#111">{name}</text>')
    return "\n".join([*lines, "</svg>", ""])


def _reached(name: str, straight: dict[str, set[str]]) -> set[str]:
    """What a room imports, through whatever others."""
    out: set[str] = set()
    pending = [name]
    while pending:
        for other in straight.get(pending.pop(), set()) - out:
            out.add(other)
            pending.append(other)
    return out


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    PICTURE.write_text(picture(), encoding="utf-8")
