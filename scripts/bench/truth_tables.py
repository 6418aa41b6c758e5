"""The tables of the part `truth`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from bench.common import Table, table
from bench.truth_rows import BEST, ORDER, REPAIRED, Row
from bench.truth_scores import mean


def by_capture(title: str, rows: Sequence[Row], of: Callable[[Row], str]) -> Table:
    """Light alone by capture, then the means of all figures."""
    names = list(dict.fromkeys(row.capture for row in rows))
    lines = []
    for label in dict.fromkeys(of(row) for row in rows):
        own = {row.capture: row for row in rows if of(row) == label}
        cells = [f"{own[n].score.light:.1f}" if n in own else "" for n in names]
        whole = mean([row.score for row in own.values()])
        cost = float(np.mean([row.trace + row.clean for row in own.values()]))
        cells += [f"**{whole.light:.1f}**", f"{whole.light_edges:.1f}", f"{whole.psnr:.1f}", f"{whole.ssim:.3f}"]
        cells += [f"{whole.flip:.3f}" if whole.flip == whole.flip else "", f"{cost:.1f}" if cost == cost else ""]
        lines.append([label, *cells])
    return table(title, ["", *names, "**mean**", "edges", "frame", "SSIM", "FLIP", "CPU s"], lines)


def tables(rows: Sequence[Row], spent: dict[str, float]) -> list[Table]:
    """Proxies and light, samples, and what it cost."""

    def proxy_label(row: Row) -> str:
        if row.mode not in ("ratio", REPAIRED):
            return row.mode
        return f"{row.proxy}, light {row.light}{', repaired' if row.mode == REPAIRED else ''}"

    def way_label(row: Row) -> str:
        return f"{row.way.label}{', denoised' if row.denoised else ''}"

    compared = {row.capture for row in rows if row.way != BEST}
    known = [r for r in rows if r.mode == "ratio" and r.proxy == "exact" and r.light == "known"]
    ways = [r for r in known if r.capture in compared and (r.denoised or r.way.scale == 1)]
    proxies = [r for r in rows if r.mode != "ratio" or (r.denoised and r.way == BEST)]
    order = {"unchanged": 0, "tint": 1, "ratio": 2, REPAIRED: 3}
    best = sorted(proxies, key=lambda r: (order[r.mode], r.light == "estimated", ORDER.index(r.proxy)))
    tried = [by_capture("Samples, exact proxy, light known", ways, way_label)] if ways else []
    costs = table("CPU seconds", ("part", "CPU s"), [(part, f"{seconds:.0f}") for part, seconds in spent.items()])
    return [by_capture("Proxy and light", best, proxy_label), *tried, costs]
