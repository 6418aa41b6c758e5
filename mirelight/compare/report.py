"""The report: one HTML file that opens from disk, with every picture and script inside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from mirelight.compare import figures
from mirelight.compare.page import HEAD, static
from mirelight.compare.types import CompareSettings, Comparison, Maps, Scores, Verdict
from mirelight.io.atomic import write_file

_TITLE = "Comparison of"
SIGN = f"<title>{_TITLE}"  # near the beginning of a report

_WITH_PICTURES = 40  # pairs shown with pictures, worst first; the table holds all
_MAX_SHOWN = 80  # characters of a setting's value

_VERDICTS: dict[Verdict, tuple[str, str]] = {
    "identical": ("identical", "No pixel differs."),
    "noise": ("within noise", "The difference is no larger than the noise of the lighting explains."),
    "difference": ("difference", "The difference is larger than the noise of the lighting explains."),
    "unknown": ("noise unknown", "Neither file says how noisy it is, so a small difference may be noise."),
}
_REGIONS = {"all": "whole picture", "covered": "inside the proxy", "silhouette": "around silhouettes"}


@dataclass(frozen=True, slots=True)
class _Images:
    """A pair's pictures, encoded."""

    reference: str
    test: str
    flip: str
    signed: str
    limit: float
    luma: str
    errors: str


class Report:
    """Collects pairs, then writes the page."""

    def __init__(self, settings: CompareSettings) -> None:
        self._settings = settings
        self._pairs: list[tuple[Comparison, _Images]] = []

    def add(self, result: Comparison, maps: Maps) -> None:
        """Take in one pair; its maps are encoded at once and not kept."""
        limit = figures.signed_limit(maps)
        images = _Images(
            reference=figures.picture(maps.reference),
            test=figures.picture(maps.test),
            flip=figures.flip_map(maps),
            signed=figures.signed_map(maps, limit),
            limit=limit,
            luma=figures.luma_histogram(maps),
            errors=figures.error_histogram(maps, limit),
        )
        self._pairs.append((result, images))

    def write(self, path: Path, failures: Sequence[str] = (), unpaired: Sequence[str] = ()) -> None:
        """Write the page, worst pair first.

        Raises:
            OutputError: the file cannot be written.
        """
        page = self.page(failures, unpaired)
        write_file(path, page)

    def page(self, failures: Sequence[str] = (), unpaired: Sequence[str] = ()) -> str:
        """The report's page as HTML text."""
        pairs = sorted(self._pairs, key=lambda p: (-p[0].overall.flip, p[0].overall.psnr))
        sections = [_section(k, result, images) for k, (result, images) in enumerate(pairs[:_WITH_PICTURES])]
        return _PAGE.format(
            title=f"{_TITLE} {len(pairs)} {'pair' if len(pairs) == 1 else 'pairs'}",
            slider_css=static("img-comparison-slider.css"),
            css=static("report.css"),
            slider_license=static("LICENSE.img-comparison-slider.txt").replace("--", "- -"),
            slider_js=static("img-comparison-slider.js"),
            lead=_lead([result for result, _ in pairs], failures),
            failures=_failures(failures),
            table=_table([result for result, _ in pairs]),
            unpaired=_unpaired(unpaired),
            shown=_shown(self._settings),
            sections="\n".join(sections),
        )


# --- parts -----------------------------------------------------------------------------------------------------------


def _lead(results: Sequence[Comparison], failures: Sequence[str]) -> str:
    if not results:
        return "Nothing was compared."
    worst = results[0]
    verdicts = [r.overall.verdict for r in results]
    alike = sum(v in ("identical", "noise") for v in verdicts)
    words = [f"Worst: {escape(worst.name)} with FLIP {worst.overall.flip:.3f} and {_db(worst.overall.psnr)}."]
    if "unknown" not in verdicts:
        words.append(f"{alike} of {len(results)} differ by no more than noise.")
    if failures:
        words.append(f"{len(failures)} requirement{'s' if len(failures) > 1 else ''} not met.")
    return " ".join(words)


def _failures(failures: Sequence[str]) -> str:
    if not failures:
        return ""
    return f'<ul class="failures">{"".join(f"<li>{escape(line)}</li>" for line in failures)}</ul>'


def _unpaired(lines: Sequence[str]) -> str:
    if not lines:
        return ""
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f'<details class="unpaired"><summary>{len(lines)} not compared</summary><ul>{items}</ul></details>'


def _table(results: Sequence[Comparison]) -> str:
    head = "".join(
        f'<th title="{escape(tip)}">{name}</th>'
        for name, tip in (
            ("FLIP", "mean visible difference when flipping between the two, 0 to 1; 0 is none"),
            ("PSNR", "of display values; higher is closer"),
            ("SSIM", "structural similarity; 1 is equal"),
            ("ΔE", "mean CIEDE2000; about 1 is just visible"),
            ("ΔE p99", "99 % of pixels are below"),
            ("relMSE", "relative squared error of linear light"),
            ("HDR-FLIP", "FLIP of linear light over several exposures"),
            ("gain", "what the reference's light was multiplied by"),
        )
    )
    rows = []
    for k, result in enumerate(results):
        s = result.overall
        name = escape(result.name)
        link = f'<a href="#pair-{k}">{name}</a>' if k < _WITH_PICTURES else name
        bar = f'<span class="bar"><i style="width:{min(s.flip / 0.3, 1) * 100:.0f}%"></i></span>'
        rows.append(
            f'<tr><th scope="row">{link}</th><td data-figure="flip">{s.flip:.4f}{bar}</td>'
            f'<td data-figure="psnr">{_db(s.psnr)}</td><td data-figure="ssim">{s.ssim:.4f}</td>'
            f'<td data-figure="delta_e">{s.delta_e:.2f}</td><td>{s.delta_e_p99:.2f}</td>'
            f"<td>{_optional(s.rel_mse)}</td><td>{_optional(s.hdr_flip)}</td><td>{_gain(result.gain)}</td>"
            f"<td>{_chip(s.verdict)}</td></tr>"
        )
    return (
        f'<div class="scroll"><table class="summary"><thead><tr><th>pair</th>{head}<th>verdict</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _section(index: int, result: Comparison, images: _Images) -> str:
    name = escape(result.name)
    reference, test = escape(str(result.reference)), escape(str(result.test))
    return f"""<section id="pair-{index}">
<h2>{name} {_chip(result.overall.verdict)}</h2>
<p class="files"><span>Reference <code>{reference}</code></span> <span>Test <code>{test}</code></span>
<span>{result.width} × {result.height} px</span></p>
{f'<p class="remark">{escape(result.remark)}</p>' if result.remark else ""}
<img-comparison-slider value="50" tabindex="0" aria-label="Reference on the left, test on the right"
 style="max-width:calc(80vh * {result.width / result.height:.4f})">
<figure slot="first"><img src="{images.reference}" alt="Reference of {name}"><figcaption>Reference</figcaption></figure>
<figure slot="second"><img src="{images.test}" alt="Test of {name}"><figcaption>Test</figcaption></figure>
</img-comparison-slider>
{_regions(result.regions)}
<div class="maps">
<figure><img src="{images.flip}" alt="FLIP map of {name}">
<figcaption>FLIP: where a viewer sees a difference {_scale(figures.FLIP_SCALE, "0", "1")}</figcaption></figure>
<figure><img src="{images.signed}" alt="Signed error of {name}">
<figcaption>Brightness: test minus reference
{_scale(figures.SIGNED_SCALE, f"−{images.limit:g}", f"+{images.limit:g}")}</figcaption></figure>
<figure>{images.luma}<figcaption>Brightness: reference (area), test (line)</figcaption></figure>
<figure>{images.errors}<figcaption>Brightness error, logarithmic counts</figcaption></figure>
</div>
{_both_settings(result.reference_settings, result.test_settings)}
</section>"""


def _regions(regions: Sequence[Scores]) -> str:
    head = "<th>region</th><th>pixels</th><th>FLIP</th><th>PSNR</th><th>SSIM</th><th>ΔE</th><th>ΔE p99</th>"
    head += "<th>relMSE</th><th>HDR-FLIP</th><th>noise floor</th><th>verdict</th>"
    rows = [
        f'<tr data-region="{s.region}"><th scope="row">{_REGIONS[s.region]}</th><td>{s.pixels}</td>'
        f'<td data-figure="flip">{s.flip:.4f}</td><td data-figure="psnr">{_db(s.psnr)}</td><td>{s.ssim:.4f}</td>'
        f"<td>{s.delta_e:.2f}</td><td>{s.delta_e_p99:.2f}</td><td>{_optional(s.rel_mse)}</td>"
        f"<td>{_optional(s.hdr_flip)}</td><td>{'–' if s.noise_psnr is None else _db(s.noise_psnr)}</td>"
        f"<td>{_chip(s.verdict)}</td></tr>"
        for s in regions
    ]
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'


def _scale(colours: Sequence[str], low: str, high: str) -> str:
    ramp = f"background:linear-gradient(90deg,{','.join(colours)})"
    return f'<span class="scale"><b>{low}</b><i style="{ramp}"></i><b>{high}</b></span>'


def _both_settings(reference: Mapping[str, Any], test: Mapping[str, Any]) -> str:
    sides = (_flat(reference), _flat(test))
    keys = sorted(set(sides[0]) | set(sides[1]))
    if not keys:
        return '<p class="quiet">Neither file says what made it.</p>'
    rows = []
    for key in keys:
        values = [side.get(key, "") for side in sides]
        kind = ' class="differs"' if values[0] != values[1] else ""
        cells = "".join(f"<td>{escape(v)}</td>" for v in values)
        rows.append(f'<tr{kind}><th scope="row">{escape(key)}</th>{cells}</tr>')
    return (
        '<details><summary>Settings of both sides</summary><div class="scroll"><table class="settings"><thead><tr>'
        f"<th></th><th>reference</th><th>test</th></tr></thead><tbody>{''.join(rows)}</tbody></table></div></details>"
    )


def _flat(settings: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Nested settings as dotted keys and short texts; matrices and long lists are left out."""
    out: dict[str, str] = {}
    for key, value in settings.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            out |= _flat(value, f"{name}.")
        elif isinstance(value, list):
            if len(value) <= 4 and not any(isinstance(v, list | dict) for v in value):
                out[name] = ", ".join(str(v) for v in value)
        elif value is not None:
            text = str(value)
            out[name] = text if len(text) <= _MAX_SHOWN else text[: _MAX_SHOWN - 1] + "…"
    return out


def _shown(settings: CompareSettings) -> str:
    curve = {"auto": "sRGB, or the engine's 2.2 power where a file says so", "srgb": "sRGB", "power": "2.2 power"}
    words = [
        f"Linear pictures are shown at {settings.exposure:+g} stops with tone curve “{settings.tone}” and the display "
        f"curve {curve[settings.transfer]}; figures are of these display values, relMSE and HDR-FLIP of linear light.",
        f"FLIP at {settings.pixels_per_degree:g} pixels per degree; silhouettes are ± {settings.band} px.",
    ]
    if settings.fit_gain:
        words.append("One gain on the reference's light was fitted per pair.")
    return " ".join(words)


def _chip(verdict: Verdict) -> str:
    name, tip = _VERDICTS[verdict]
    return f'<span class="chip {verdict}" title="{escape(tip)}">{name}</span>'


def _db(value: float) -> str:
    return "∞ dB" if value == float("inf") else f"{value:.2f} dB"


def _optional(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def _gain(gain: float) -> str:
    return "1" if gain == 1 else f"{gain:.3f}"


_PAGE = (
    HEAD
    + """<noscript><style>
img-comparison-slider, img-comparison-slider [slot] {{ visibility: visible; display: block }}
</style></noscript>
</head>
<body>
<header>
<h1>{title}</h1>
<p class="lead">{lead}</p>
{failures}
</header>
<main>
{table}
{unpaired}
<p class="quiet">{shown}</p>
{sections}
</main>
<!-- {slider_license} -->
<script>{slider_js}</script>
</body>
</html>
"""
)
