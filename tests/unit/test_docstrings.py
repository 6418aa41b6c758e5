"""Docstrings: public functions that take or give NumPy arrays say their shapes.

Kernels on Dr.Jit hold one value a lane, which has no shape: `lighting/kernel` and the compositor but for its oracle.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from rooms import PACKAGE, parsed

_ARRAYS = re.compile(r"\b(?:[FI]32|[FI]64|U8|Bool|Int|NDArray|ArrayLike|Pixels)\b")
_SHAPES = re.compile(
    r"\((?:[\w. *+/²-]|\([^()]*\)²?)+,[^)]*\)|\([A-Z](?: \* [A-Z])*\)|\bshape\b|\bflat\b", re.IGNORECASE
)
_LANES = (PACKAGE / "lighting" / "kernel", PACKAGE / "compositor")


def public(body: list[ast.stmt], said: str = "") -> Iterator[tuple[ast.FunctionDef, str]]:
    """Functions and methods, each with its docstring and its class's."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public(node.body, ast.get_docstring(node) or "")
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node, f"{ast.get_docstring(node) or ''}\n{said}"


def of_arrays(function: ast.FunctionDef) -> bool:
    """Whether a parameter or the result is an array."""
    every = [a.annotation for a in (*function.args.args, *function.args.kwonlyargs)]
    return any(x is not None and _ARRAYS.search(ast.unparse(x)) for x in (*every, function.returns))


def without_shapes(path: Path) -> list[str]:
    """Names of public functions of a module whose docstrings miss a shape."""
    found = public(parsed(path).body)
    return [f.name for f, said in found if of_arrays(f) and not _SHAPES.search(said)]


def test_functions_of_arrays_say_their_shapes() -> None:
    modules = [x for x in PACKAGE.rglob("*.py") if not any(x.is_relative_to(y) for y in _LANES)]
    modules.append(PACKAGE / "compositor" / "reference.py")
    missing = {str(x.relative_to(PACKAGE)): names for x in sorted(modules) if (names := without_shapes(x))}
    assert missing == {}


def test_a_docstring_without_a_shape_is_found(tmp_path: Path) -> None:
    module = tmp_path / "some.py"
    module.write_text(
        'def f(x: F64) -> F64:\n    """Twice x."""\n\n\ndef g(x: F64) -> F64:\n    """(N, 3) twice x."""\n'
    )
    assert without_shapes(module) == ["f"]
