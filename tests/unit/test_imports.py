"""The import rule of CONTRIBUTING.md, read from the source; and what importing and printing help may load."""

from __future__ import annotations

import ast
import importlib.util
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "mirelight"

BASE = {"base", "errors", "conventions", "model", "colour", "backend"}
TOOLS = {"colour", "sh"}
# Each unit of the package and the units that it may import beside itself; "*": any.
MAY_IMPORT: dict[str, set[str]] = {
    "": {"base"},  # mirelight/__init__.py: the public calls are looked up lazily, see LAZY_HOMES
    "errors": BASE,
    "extras": {"errors"},
    "base": set(),
    "conventions": BASE,
    "machine": set(),
    "model": BASE,
    "colour": set(),
    "sh": BASE,
    "viewing": BASE,
    "first": {"*"},
    "advice": BASE | {"colour"},
    "checking": BASE | {"advice", "lighting", "proxy", "viewing"},
    "engine_lights": BASE | {"colour"},
    "io": BASE | TOOLS | {"extras", "engine_lights", "machine", "peak", "proxy", "units", "viewing"},
    "dataset": BASE | TOOLS | {"io", "kept", "keys", "needs", "plan", "relighting", "store", "units"},
    "backend": {"errors"},
    "lighting": BASE | TOOLS | {"extras", "backend", "engine_lights", "machine"},
    "compositor": BASE | TOOLS | {"backend", "machine"},
    "relighting": {"model", "colour", "sh"},
    "units": {"model"},
    "mix": {"model", "units"},
    "provenance": {"base", "model", "backend"},
    "proxy": BASE | TOOLS | {"extras", "backend", "lighting", "compositor", "machine"},
    "estimate": BASE | TOOLS | {"lighting", "machine"},
    "needs": {"errors", "model", "units", "relighting", "lighting"},
    "keys": {"model", "needs", "units", "provenance", "relighting", "lighting"},
    "kept": {"model"},
    "cache": {"errors", "model", "io"},
    "view_light": {"model", "units", "mix", "keys", "needs", "kept", "lighting"},
    "splat_light": {"model", "units", "keys", "needs", "kept", "lighting", "relighting"},
    "surface_light": {"model", "units", "keys", "needs", "kept", "lighting"},
    "scene": {
        "extras",
        "advice",
        "errors",
        "model",
        "units",
        "keys",
        "needs",
        "kept",
        "cache",
        "backend",
        "lighting",
        "compositor",
        "view_light",
        "viewing",
    }
    | {"estimate", "surface_light", "splat_light", "relighting"},
    "stages": {"model", "keys", "needs", "provenance", "relighting", "scene", "view_light"},
    "plan": {"errors", "model", "engine_lights", "keys", "needs", "scene", "lighting"},
    "store": BASE | {"io", "keys", "plan"},
    "peak": {"keys", "model", "needs", "relighting", "units"},
    "forecast": {"peak", "viewing", "keys", "needs", "model", "plan", "relighting", "scene", "stages", "store"},
    "executor": {"viewing", "advice", "dataset", "errors", "model", "plan", "scene", "stages", "store", "units"},
    "matching": BASE | {"colour", "io", "relighting", "units", "scene", "stages"},
    "farm": BASE
    | {"advice", "extras", "io", "keys", "mix", "plan", "relighting", "scene", "store", "executor", "machine", "units"},
    "compare": {"*"},
    "realtime": {"*"},
    "mixing": {"*"},
    "showing": {"*"},
    "watching": {"*"},
    "baking": BASE | TOOLS | {"needs", "relighting", "scene", "splat_light"},
    "doctor": {"*"},
    "cli": {"*"},
    "__main__": {"cli"},
}
ONLY_CLI = {"cli", "__main__"}  # nobody else imports these

THIRD_PARTY_OWNERS = {
    "mitsuba": {"backend", "lighting"},
    "drjit": {"backend", "lighting", "compositor"},
}
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


def sources() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def unit_of(path: Path) -> str:
    """The row of MAY_IMPORT that a file belongs to."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return "" if parts == ("__init__",) else parts[0]


def imports(path: Path) -> Iterator[str]:
    """Every imported module of a file, those inside functions and under TYPE_CHECKING too, as absolute dotted names."""
    package = "mirelight." + ".".join(path.relative_to(PACKAGE).parent.parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            home = node.module or ""
            if node.level:
                home = importlib.util.resolve_name("." * node.level + home, package.rstrip("."))
            if home == "mirelight":
                yield from (f"mirelight.{alias.name}" for alias in node.names)
            else:
                yield home


def at_import_time(path: Path) -> Iterator[str]:
    """Top-level names of modules that importing a file loads at once."""
    pending: list[ast.stmt] = list(ast.parse(path.read_text(encoding="utf-8")).body)
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


def unit_imports(path: Path) -> set[str]:
    """Units of this package that a file imports; names of `mirelight` itself (its version) are not units."""
    units = {name.split(".")[1] for name in imports(path) if name.startswith("mirelight.")}
    return {u for u in units if (PACKAGE / u).is_dir() or (PACKAGE / f"{u}.py").is_file()}


def test_modules_import_only_what_their_rows_allow() -> None:
    for path in sources():
        unit = unit_of(path)
        assert unit in MAY_IMPORT, f"{unit} has no row here and in CONTRIBUTING.md"
        used = unit_imports(path) - {unit}
        if unit == "":
            used -= lazy_homes()
        allowed = MAY_IMPORT[unit]
        if "*" not in allowed:
            assert used <= allowed, f"{path.relative_to(PACKAGE)} imports {used - allowed}"
        if unit not in ONLY_CLI:
            assert not used & ONLY_CLI, path


def lazy_homes() -> set[str]:
    """Units that the package's own __getattr__ looks up on first use."""
    import mirelight

    return {home.split(".")[1] for home in mirelight._HOMES.values()}


def test_mitsuba_and_drjit_are_named_by_their_owners_alone() -> None:
    for path in sources():
        for name in imports(path):
            owners = THIRD_PARTY_OWNERS.get(name.split(".")[0])
            assert owners is None or unit_of(path) in owners, f"{name} in {path.name}"


def test_heavy_modules_are_imported_inside_functions() -> None:
    for path in sources():
        # A kernel's module may name Dr.Jit and Mitsuba at its top (decorators, types): it is itself imported inside
        # functions, which the next test holds.
        kernel = unit_of(path) in {"lighting", "compositor"} and path.parent != PACKAGE and path.name != "__init__.py"
        assert not (HEAVY - set(THIRD_PARTY_OWNERS) if kernel else HEAVY) & set(at_import_time(path)), path


def test_importing_every_unit_loads_no_backend() -> None:
    units = sorted({f"mirelight.{unit_of(p)}".rstrip(".") for p in sources()} - {"mirelight.__main__"})
    code = f"import sys, {', '.join(units)}\nprint(*(m for m in {sorted(HEAVY)} if m in sys.modules))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.split() == []


def test_set_variant_has_one_caller() -> None:
    callers = [p.name for p in sources() if re.search(r"\bset_variant\s*\(", p.read_text(encoding="utf-8"))]
    assert callers == ["backend.py"]


def test_no_cycles_between_units() -> None:
    graph: dict[str, set[str]] = {}
    for path in sources():
        if unit_of(path):
            graph.setdefault(unit_of(path), set()).update(unit_imports(path) - {unit_of(path), ""})
    done: set[str] = set()

    def visit(unit: str, trail: tuple[str, ...]) -> None:
        assert unit not in trail, " -> ".join((*trail, unit))
        if unit not in done:
            for other in graph.get(unit, ()):
                visit(other, (*trail, unit))
            done.add(unit)

    for unit in graph:
        visit(unit, ())


@pytest.mark.parametrize(
    "arguments", [["-c", "import mirelight"], ["-m", "mirelight", "--help"]], ids=["import", "help"]
)
def test_import_and_help_load_nothing_heavy(arguments: list[str]) -> None:
    told = subprocess.run([sys.executable, "-X", "importtime", *arguments], capture_output=True, text=True, check=True)
    loaded = {line.rsplit("|", 1)[1].strip().split(".")[0] for line in told.stderr.splitlines() if "|" in line}
    assert "mirelight" in loaded
    assert not loaded & (HEAVY | {"drjit", "pydantic"})


def test_rule_sees_imports_inside_functions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "PACKAGE", tmp_path)
    (tmp_path / "io").mkdir()
    (tmp_path / "io" / "ply.py").write_text(
        "def f():\n    from mirelight import pipeline\n    from ..lighting import trace\n    import mitsuba as mi\n"
        "if TYPE_CHECKING:\n    import scipy\nclass C:\n    import trimesh\n"
    )
    (tmp_path / "pipeline.py").touch()
    (tmp_path / "lighting").mkdir()
    path = tmp_path / "io" / "ply.py"
    assert unit_imports(path) == {"pipeline", "lighting"}
    assert "mitsuba" in list(imports(path))
    assert set(at_import_time(path)) == {"trimesh"}
    assert unit_of(path) == "io"
