"""The import rule, `scripts/rooms.py`, held against the source; and what importing and printing help may load."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import rooms
from rooms import LEVEL, PACKAGE, imports, parsed, room_of, rooms_used, sources

THIRD_PARTY_OWNERS = {
    "mitsuba": {"base/backend.py", "lighting"},
    "drjit": {"base/backend.py", "lighting", "compositor"},
}
SHARED_APPS = {"realtime"}  # serves pages and renders the engine's frames for other apps
MADE_OF = {"studio": {"first_job", "mixer"}}  # what an app is made of
HEAVY = {
    "mitsuba",
    "drjit",
    "colour",
    "OpenEXR",
    "scipy",
    "trimesh",
    "PIL",
    "skimage",
    "flip_evaluator",
    "playwright",
    "matplotlib",
    "numba",
    "DracoPy",
}


def at_import_time(path: Path) -> Iterator[str]:
    """Top-level names of modules that importing a file loads at once."""
    pending: list[ast.stmt] = list(parsed(path).body)
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield (node.module or "").split(".")[0]
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            pending += node.orelse
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            pending += [child for child in ast.iter_child_nodes(node) if isinstance(child, ast.stmt)]


def test_every_module_stands_in_a_room() -> None:
    assert {room_of(path) for path in sources()} == {"", "__main__", *LEVEL}


def test_a_room_imports_what_is_below_it() -> None:
    for path in sources():
        room = room_of(path)
        if room in LEVEL:
            up = {other for other in rooms_used(path) if LEVEL.get(other, sys.maxsize) >= LEVEL[room]}
            assert not up, f"{path.relative_to(PACKAGE)} imports {up}, which {room} stands no higher than"
    assert rooms_used(PACKAGE / "__main__.py") == {"cli"}


def test_no_app_knows_another() -> None:
    apps = PACKAGE / "apps"
    for path in sources(apps):
        own = path.relative_to(apps).with_suffix("").parts[0]
        used = {name.split(".")[2] for name in imports(path) if name.startswith("mirelight.apps.")}
        allowed = {own, *SHARED_APPS, *MADE_OF.get(own, ())}
        assert used <= allowed, f"{path.relative_to(PACKAGE)} imports {used - allowed}"


def test_no_module_imports_what_imports_it() -> None:
    """Modules of one room too, those inside functions and under TYPE_CHECKING included."""
    known = {path.relative_to(PACKAGE.parent).with_suffix("").as_posix().replace("/", "."): path for path in sources()}
    graph: dict[str, set[str]] = {}
    for module, path in known.items():
        if path.name != "__init__.py":  # a package's face hands on names of its own modules
            graph[module] = {x for x in _modules_used(path) if x in known} - {module}
    done: set[str] = set()

    def visit(module: str, trail: tuple[str, ...]) -> None:
        assert module not in trail, " -> ".join((*trail, module))
        if module not in done:
            for other in graph.get(module, ()):
                visit(other, (*trail, module))
            done.add(module)

    for module in graph:
        visit(module, ())


def _modules_used(path: Path) -> Iterator[str]:
    """Imported modules, where a package's name stands before what is taken from it too."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
    yield from imports(path)


def test_the_page_and_the_picture_are_of_now() -> None:
    remedy = "run: python scripts/rooms.py"
    assert rooms.PAGE.read_text(encoding="utf-8") == rooms.page(), remedy
    assert rooms.PICTURE.read_text(encoding="utf-8") == rooms.picture(), remedy


def test_progress_is_told_in_the_two_shapes_of_one_module() -> None:
    """What hears counts or shares is `CountProgress` or `ShareProgress`, and nobody writes them out or renames them."""
    shapes = {"Callable[[int, int], None]", "Callable[[str, float], None]", "Callable[[str, int, int], None]"}
    found = {path.relative_to(PACKAGE).as_posix() for path in sources() if shapes & set(_callables(path))}
    assert found == {"base/progress.py"}


def _callables(path: Path) -> Iterator[str]:
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "Callable":
            yield ast.unparse(node)


def test_mitsuba_and_drjit_are_named_by_their_owners_alone() -> None:
    for path in sources():
        places = {room_of(path), path.relative_to(PACKAGE).as_posix()}
        for name in imports(path):
            owners = THIRD_PARTY_OWNERS.get(name.split(".")[0])
            assert owners is None or owners & places, f"{name} in {path.name}"


def test_heavy_modules_are_imported_inside_functions() -> None:
    for path in sources():
        # A kernel's module may name Dr.Jit and Mitsuba at its top (decorators, types): it is itself imported inside
        # functions, which the next test holds.
        kernel = room_of(path) in {"lighting", "compositor"} and path.name != "__init__.py"
        assert not (HEAVY - set(THIRD_PARTY_OWNERS) if kernel else HEAVY) & set(at_import_time(path)), path


def test_importing_every_room_loads_no_backend() -> None:
    apps = [
        f"mirelight.apps.{x.stem}" for x in (PACKAGE / "apps").iterdir() if x.stem not in {"__init__", "__pycache__"}
    ]
    modules = ["mirelight", *(f"mirelight.{room}" for room in LEVEL), *apps]
    modules += [
        f"mirelight.{room}.{x.stem}" for room in ("base", "pipeline") for x in (PACKAGE / room).glob("[a-z]*.py")
    ]
    code = f"import sys, {', '.join(modules)}\nprint(*(m for m in {sorted(HEAVY)} if m in sys.modules))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.split() == []


def test_set_variant_has_one_caller() -> None:
    callers = [p.name for p in sources() if re.search(r"\bset_variant\s*\(", p.read_text(encoding="utf-8"))]
    assert callers == ["backend.py"]


@pytest.mark.parametrize(
    "arguments", [["-c", "import mirelight"], ["-m", "mirelight", "--help"]], ids=["import", "help"]
)
def test_import_and_help_load_nothing_heavy(arguments: list[str]) -> None:
    told = subprocess.run([sys.executable, "-X", "importtime", *arguments], capture_output=True, text=True, check=True)
    loaded = {line.rsplit("|", 1)[1].strip().split(".")[0] for line in told.stderr.splitlines() if "|" in line}
    assert "mirelight" in loaded
    assert not loaded & (HEAVY | {"drjit", "pydantic"})


def test_rule_sees_imports_inside_functions_and_strings(tmp_path: Path) -> None:
    (tmp_path / "io").mkdir()
    path = tmp_path / "io" / "ply.py"
    path.write_text(
        "def f():\n    from mirelight import pipeline\n    from ..lighting import trace\n    import mitsuba as mi\n"
        "if TYPE_CHECKING:\n    import scipy\nclass C:\n    import trimesh\nimport_module('mirelight.store.index')\n"
    )
    for room in ("pipeline", "lighting", "store"):
        (tmp_path / room).mkdir()
    assert rooms_used(path, tmp_path) == {"pipeline", "lighting", "store"}
    assert "mitsuba" in list(imports(path, tmp_path))
    assert set(at_import_time(path)) == {"trimesh"}
    assert room_of(path, tmp_path) == "io"
