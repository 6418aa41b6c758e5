"""What the pages tell people to type: commands that the program takes, Python that imports what there is, TOML."""

from __future__ import annotations

import ast
import re
import shlex
import tomllib
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

from mirelight.cli import make_parser

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_INDENTED = re.compile(r"(?:^ {4}\S.*\n)+", re.MULTILINE)
_SYNOPSIS = re.compile(r"…|\||\[")  # lines that show a command's form and not a command


def blocks(text: str, *languages: str) -> Iterator[str]:
    """The content of fences in any of the languages."""
    return (body for language, body in _FENCE.findall(text) if language in languages)


def commands(text: str) -> Iterator[list[str]]:
    """The arguments of every mirelight command of a page."""
    plain = _FENCE.sub("", text)
    indented = (re.sub(r"^ {4}", "", x, flags=re.MULTILINE) for x in _INDENTED.findall(plain))
    for block in (*blocks(text, "sh", "bash", ""), *indented):
        for line in block.replace("\\\n", " ").splitlines():
            found = re.match(r"(?:\$ )?(?:\.venv/bin/)?mirelight ((?:[^#'\"]|'[^']*'|\"[^\"]*\")*)", line)
            if found and not _SYNOPSIS.search(re.sub(r"'[^']*'", "", found[1])):
                yield shlex.split(found[1].split(" && ")[0].split(" > ")[0])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_are_ones_that_the_program_takes(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused = []
    for arguments in commands(page.read_text(encoding="utf-8")):
        try:
            make_parser().parse_args(arguments)
        except SystemExit as ended:
            if ended.code:
                refused.append((" ".join(arguments), capsys.readouterr().err.splitlines()[-1]))
    assert not refused


def test_there_are_commands_to_be_found() -> None:
    assert sum(len(list(commands(page.read_text(encoding="utf-8")))) for page in PAGES) >= 40


def test_figures_of_quality_stand_in_the_benchmarks_alone() -> None:
    """There a script writes them; a figure typed into another page is true of the day on which it was typed."""
    typed = [
        f"{page.relative_to(ROOT)}: {found}"
        for page in PAGES
        if page.parent.name != "benchmarks"
        for found in re.findall(r".*\d ?dB\b.*", page.read_text(encoding="utf-8"))
    ]
    assert not typed


def test_a_guide_is_read_at_one_sitting() -> None:
    long = [x.name for x in PAGES if x.parent.name == "guides" and x.read_text(encoding="utf-8").count("\n") > 150]
    assert not long


def pages_with(language: str) -> list[Path]:
    """Those that hold a block of a language: on others there would be nothing to test."""
    return [page for page in PAGES if any(blocks(page.read_text(encoding="utf-8"), language))]


@pytest.mark.parametrize(("language", "least"), [("python", 10), ("toml", 30)])
def test_every_block_is_looked_at(language: str, least: int) -> None:
    """Each fence that opens with the language, indented or not, is one of the blocks that the tests below take."""
    texts = [page.read_text(encoding="utf-8") for page in PAGES]
    opened = sum(len(re.findall(rf"^[ \t]*(?:```|~~~)[ \t]*{language}\b", text, re.MULTILINE)) for text in texts)
    assert opened == sum(len(list(blocks(text, language))) for text in texts) >= least


@pytest.mark.parametrize("page", pages_with("python"), ids=lambda page: page.name)
def test_python_imports_what_there_is(page: Path) -> None:
    for block in blocks(page.read_text(encoding="utf-8"), "python"):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "mirelight":
                home = import_module(node.module or "")
                for name in node.names:
                    if not hasattr(home, name.name):
                        import_module(f"{node.module}.{name.name}")
            elif isinstance(node, ast.Import):
                for name in node.names:
                    if name.name.split(".")[0] == "mirelight":
                        import_module(name.name)
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "mirelight":
                assert hasattr(import_module("mirelight"), node.attr)


@pytest.mark.parametrize("page", pages_with("toml"), ids=lambda page: page.name)
def test_toml_is_sound(page: Path) -> None:
    for block in blocks(page.read_text(encoding="utf-8"), "toml"):
        tomllib.loads(block)


PUBLIC = (
    "mirelight",
    "mirelight.model",
    "mirelight.dataset",
    "mirelight.dataset.export",
    "mirelight.compare",
    "mirelight.io.splats",
    "mirelight.proxy",
    "mirelight.estimate",
    "mirelight.apps.match",
    "mirelight.compositor",
    "mirelight.lighting",
    "mirelight.relighting",
)


@pytest.mark.parametrize("package", PUBLIC)
def test_public_names_are_in_the_api_reference(package: str) -> None:
    """A page shows what a module holds, one thing alone, or of a package what it lists as its own, but for what has the
    name of one of its modules: there the site shows the module."""
    pages = "".join(x.read_text(encoding="utf-8") for x in (ROOT / "docs" / "reference" / "api").glob("*.md"))
    shown = set(re.findall(r"^::: (\S+)$", pages, flags=re.MULTILINE))
    home = import_module(package)
    missing = []
    for name in home.__all__:
        value = getattr(home, name)
        own = getattr(value, "__module__", "")
        module = hasattr(home, "__path__") and find_spec(f"{package}.{name}") is not None
        places = {own, f"{own}.{name}"} | (set() if module else {package})
        if callable(value) and own.startswith("mirelight") and not places & shown:
            missing.append(name)
    assert not missing
