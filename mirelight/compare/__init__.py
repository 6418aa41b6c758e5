"""`mirelight compare`: pairs of pictures scored, and a report that a person understands. See docs/guides/compare.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mirelight.base.progress import CountProgress
from mirelight.compare import metrics
from mirelight.compare.evaluate import evaluate
from mirelight.compare.pairing import find_pairs
from mirelight.compare.report import Report
from mirelight.compare.requirements import Requirement, parse_requirement, unmet
from mirelight.compare.tables import write_csv, write_json
from mirelight.compare.types import CompareSettings, Comparison, Maps, Pair, Pairing, Scores

__all__ = [
    "CompareSettings",
    "Comparison",
    "Maps",
    "Outcome",
    "Pair",
    "Pairing",
    "Report",
    "Requirement",
    "Scores",
    "compare",
    "evaluate",
    "find_pairs",
    "parse_requirement",
    "summary",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Every pair's figures, worst first; a line for each requirement that is not met, and for each frame left out."""

    results: tuple[Comparison, ...]
    failures: tuple[str, ...]
    unpaired: tuple[str, ...] = ()  # not compared; references among them are failures too where there are requirements


def compare(
    frames: Pairing,
    settings: CompareSettings = CompareSettings(),  # noqa: B008 - frozen
    *,
    requirements: Sequence[Requirement] = (),
    html: Path | None = None,
    json: Path | None = None,
    csv: Path | None = None,
    progress: CountProgress | None = None,
) -> Outcome:
    """Score pairs and write what is asked for.

    Args:
        frames: from :func:`find_pairs`.
        settings: how pictures are shown and scored.
        requirements: bounds that every pair must hold; a reference without a test does not.
        html: a report in one file.
        json: all figures.
        csv: all figures, one line per pair and region.
        progress: called with (done, total).

    Raises:
        InputError: a picture that cannot be read, or two of different sizes.
        OutputError: a file that cannot be written.
        MirelightError: a package of the extra `compare` is missing.
    """
    metrics.require()
    pairs = frames.pairs
    report = Report(settings) if html is not None else None
    results: list[Comparison] = []
    for done, pair in enumerate(pairs):
        if progress is not None:
            progress(done, len(pairs))
        result, maps = evaluate(pair, settings)
        results.append(result)
        if report is not None:
            report.add(result, maps)
    if progress is not None:
        progress(len(pairs), len(pairs))

    worst_first = tuple(sorted(results, key=lambda r: (-r.overall.flip, r.overall.psnr)))
    failures = unmet(worst_first, requirements) + (frames.without_test if requirements else ())
    outcome = Outcome(
        results=worst_first, failures=failures, unpaired=(*frames.without_test, *frames.without_reference)
    )
    if report is not None and html is not None:
        report.write(html, failures, outcome.unpaired)
    if json is not None:
        write_json(json, worst_first, settings, failures, outcome.unpaired)
    if csv is not None:
        write_csv(csv, worst_first)
    return outcome


def summary(outcome: Outcome) -> str:
    """A table in plain text, worst pair first; below it remarks, what was not compared, and the failures."""
    rows = [("pair", "FLIP", "PSNR", "SSIM", "dE mean", "dE p99", "relMSE", "gain", "verdict")]
    for result in outcome.results:
        s = result.overall
        relative = "-" if s.rel_mse is None else f"{s.rel_mse:.3g}"
        figures = (f"{s.flip:.4f}", f"{s.psnr:.2f}", f"{s.ssim:.4f}", f"{s.delta_e:.2f}", f"{s.delta_e_p99:.2f}")
        rows.append((result.name, *figures, relative, f"{result.gain:.3g}", s.verdict))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for name, *cells in rows:
        aligned = (cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True))
        lines.append("  ".join([name.ljust(widths[0]), *aligned]))
    remarks = [f"{result.name}: {result.remark}" for result in outcome.results if result.remark]
    left_out = [f"not compared: {line}" for line in outcome.unpaired]
    return "\n".join([*lines, *remarks, *left_out, *outcome.failures])
