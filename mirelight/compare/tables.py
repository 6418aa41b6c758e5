"""Results as JSON and CSV."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from mirelight.compare.types import CompareSettings, Comparison, Scores
from mirelight.io.atomic import atomic_path, write_file

SCORE_FIELDS = tuple(f.name for f in fields(Scores))
JSON_SIGN = '{\n "settings": {\n  "exposure": '  # how a file of :func:`write_json` begins
CSV_SIGN = ",".join(("name", "gain", *SCORE_FIELDS))  # and one of :func:`write_csv`


def write_json(
    path: Path,
    results: Sequence[Comparison],
    settings: CompareSettings,
    failures: Sequence[str],
    unpaired: Sequence[str] = (),
) -> None:
    """All figures, worst pair first; an infinite PSNR becomes null.

    Raises:
        OutputError: the file cannot be written.
    """
    write_file(path, json_text(results, settings, failures, unpaired) + "\n")


def json_text(
    results: Sequence[Comparison], settings: CompareSettings, failures: Sequence[str], unpaired: Sequence[str] = ()
) -> str:
    """The results as JSON text, which :func:`write_json` writes."""
    document = {
        "settings": asdict(settings),
        "failures": list(failures),
        "unpaired": list(unpaired),
        "pairs": [_plain(result) for result in results],
    }
    return json.dumps(document, indent=1, default=str, allow_nan=False)


def write_csv(path: Path, results: Sequence[Comparison]) -> None:
    """One line per pair and region, figures as in :class:`Scores`; what is not defined is empty.

    Raises:
        OutputError: the file cannot be written.
    """
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(("name", "gain", *SCORE_FIELDS))
        for result in results:
            for scores in result.regions:
                values = (getattr(scores, name) for name in SCORE_FIELDS)
                table.writerow((result.name, f"{result.gain:.6g}", *(_cell(v) for v in values)))


def _plain(result: Comparison) -> dict[str, Any]:
    plain = asdict(result)
    plain["regions"] = [{k: _finite(v) for k, v in scores.items()} for scores in plain["regions"]]
    return {k: str(v) if isinstance(v, Path) else _finite_tree(v) for k, v in plain.items()}


def _finite_tree(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _finite_tree(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite_tree(v) for v in value]
    return _finite(value)


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else value
