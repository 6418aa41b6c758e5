"""How long functions are, and how much they take."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from rooms import PACKAGE, parsed, sources

MOST_LINES, MOST_PARAMETERS = 60, 8  # of a body without its docstring; of a signature without self and cls


def _too_large() -> Iterator[str]:
    for path in sources():
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                body = node.body[ast.get_docstring(node) is not None :]
                lines = (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0
                taken = [x.arg for x in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
                count = len(taken) - (taken[:1] in (["self"], ["cls"]))
                if lines > MOST_LINES or count > MOST_PARAMETERS:
                    yield f"{path.relative_to(PACKAGE).as_posix()} {node.name}"


def test_functions_are_short_and_take_little() -> None:
    assert list(_too_large()) == []
