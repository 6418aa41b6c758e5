"""A ladder as one HTML file that opens from disk."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np

from mirelight.apps.explain.types import CAUSES, Ladder, Step, write_json
from mirelight.compare import figures, metrics
from mirelight.compare.page import HEAD, static
from mirelight.compare.types import Maps
from mirelight.io.atomic import write_file
from mirelight.io.folders import NewFolders
from mirelight.io.png import write_png
from mirelight.model import F32

_ENOUGH = 0.75  # the lead names causes until they make this share of the difference
_MOST_NAMED = 3


def write_ladder(directory: Path, ladder: Ladder) -> None:
    """Write explain.html, explain.json and a PNG of every rung into a folder, which is made where it is missing.

    Raises:
        OutputError: the folder or a file cannot be written.
        MirelightError: a package of the extra `compare` is missing.
    """
    NewFolders(directory).make()
    for k, rung in enumerate(ladder.rungs):
        pixels = np.rint(rung.frame * np.float32(255)).astype(np.uint8)
        write_png(directory / f"{k:02d}-{rung.name}.png", pixels, {})
    write_json(directory / "explain.json", ladder)
    write_file(directory / "explain.html", page(ladder))


def page(ladder: Ladder) -> str:
    """The report as text."""
    height, width = ladder.rungs[0].frame.shape[:2]
    last = len(ladder.rungs) - 1
    return _PAGE.format(
        title=f"Why real time differs: {escape(ladder.name)}",
        slider_css=static("img-comparison-slider.css"),
        css=static("report.css") + "\n" + static("explain.css"),
        lead=_lead(ladder),
        aspect=f"{width / height:.4f}",
        left=_choice(ladder, "left", 0),
        right=_choice(ladder, "right", last),
        table=_table(ladder),
        first=_first(ladder),
        steps="\n".join(_section(ladder, k + 1, step) for k, step in enumerate(ladder.steps)),
        absent=_list("Not in play here", [f"{CAUSES[name].title}: {why}" for name, why in ladder.absent]),
        warnings=_list("What the engine cannot follow in this job", ladder.warnings),
        slider_license=static("LICENSE.img-comparison-slider.txt").replace("--", "- -"),
        slider_js=static("img-comparison-slider.js"),
        js=static("explain.js"),
    )


# --- parts -----------------------------------------------------------------------------------------------------------


def _lead(ladder: Ladder) -> str:
    whole = ladder.whole
    if whole.squared == 0:
        return "The two frames are identical."
    largest = sorted(ladder.steps, key=lambda step: -step.share)
    named: list[Step] = []
    for step in largest[:_MOST_NAMED]:
        if step.share > 0 and sum(x.share for x in named) < _ENOUGH:
            named.append(step)
    causes = ", ".join(f"<b>{escape(CAUSES[x.name].title)}</b> ({x.share:.0%})" for x in named)
    direction = "brighter" if whole.brightness > 0 else "darker"
    return (
        f"The real-time frame and the physical one differ by FLIP {whole.flip:.3f} and {whole.psnr:.1f} dB; the "
        f"physical one is {abs(whole.brightness) * 255:.1f} of 255 levels {direction}. Most of it: {causes}."
    )


def _choice(ladder: Ladder, side: str, chosen: int) -> str:
    options = "".join(
        f'<option value="{k}"{" selected" if k == chosen else ""}>{escape(_name(ladder, k))}</option>'
        for k in range(len(ladder.rungs))
    )
    label = {"left": "Left", "right": "Right"}[side]
    return f'<label>{label} <select id="choice-{side}">{options}</select></label>'


def _name(ladder: Ladder, index: int) -> str:
    """What a rung shows, by the last cause that was taken away."""
    if index == 0:
        return "Real-time frame"
    if index == len(ladder.rungs) - 1:
        return "Physical frame"
    return f"After {index}: {ladder.rungs[index].title}"


def _table(ladder: Ladder) -> str:
    shares = [step.share for step in ladder.steps]
    low, high = min(0.0, *shares), max(0.0, *shares)
    rows = [
        f'<tr data-step="{step.name}"><th scope="row">{k}. '
        f'<a href="#step-{k}">{escape(CAUSES[step.name].title)}</a></th>'
        f"{_cells(step, _bar(step.share, low, high))}</tr>"
        for k, step in enumerate(ladder.steps, start=1)
    ]
    head = "".join(
        f'<th title="{escape(tip)}">{name}</th>'
        for name, tip in (
            ("share", "of the whole squared difference; a cause below 0 hides another one"),
            ("", "share, as a bar"),
            ("brightness", "mean change in 8-bit levels; adds up as well"),
            ("PSNR", "of this step alone: between the frames before and after it"),
            ("noise", "PSNR that the tracing's noise alone would give this step; a dash: nothing in it is sampled"),
            ("FLIP", "of this step alone: visible difference, 0 to 1"),
        )
    )
    return (
        '<div class="scroll"><table class="causes"><thead><tr><th>what the real-time frame does</th>'
        f"{head}</tr></thead>"
        f'<tbody>{"".join(rows)}</tbody><tfoot><tr><th scope="row">all together</th>{_cells(ladder.whole, "")}'
        "</tr></tfoot></table></div>"
    )


def _bar(share: float, low: float, high: float) -> str:
    span = (high - low) or 1.0
    zero = -low / span
    start, end = sorted((zero, (share - low) / span))
    kind = ' class="away"' if share < 0 else ""
    bar = f'<i{kind} style="left:{start:.2%};width:{end - start:.2%}"></i><b style="left:{zero:.2%}"></b>'
    return f'<span class="signed">{bar}</span>'


def _cells(step: Step, bar: str) -> str:
    return (
        f'<td data-figure="share">{_share(step.share)}</td><td class="share">{bar}</td>'
        f'<td data-figure="brightness">{_signed(step.brightness * 255, 2)}</td>'
        f'<td data-figure="psnr">{_db(step.psnr)}</td><td data-figure="noise">{_noise(step)}</td>'
        f'<td data-figure="flip">{step.flip:.4f}</td>'
    )


def _first(ladder: Ladder) -> str:
    rungs = ladder.rungs
    maker = ladder.engine if ladder.really_rendered else f"{ladder.engine}: the engine itself did not run"
    return f"""<section class="step" id="step-0">
<h2>Real-time frame</h2>
<p>Made by {escape(maker)}.</p>
<div class="maps">
<figure><img id="rung-0" src="{figures.picture(rungs[0].frame)}" alt="Real-time frame">
<figcaption>Real-time frame</figcaption></figure>
{_change(rungs[0].frame, rungs[-1].frame, "Change of brightness by all steps together")}
</div>
</section>"""


def _section(ladder: Ladder, index: int, step: Step) -> str:
    before, rung = ladder.rungs[index - 1], ladder.rungs[index]
    title = escape(rung.title)
    after = "After this step: the physical frame" if index == len(ladder.rungs) - 1 else "After this step"
    return f"""<section class="step" id="step-{index}">
<h2>{index}. {title}</h2>
<p>{escape(rung.change)}</p>
<p class="numbers">{_share(step.share)} of the difference · brightness {_signed(step.brightness * 255, 2)} levels ·
this step alone: PSNR {_db(step.psnr)}, FLIP {step.flip:.4f}{_verdict(step)}
<button data-rung="{index}">before and after</button></p>
<div class="maps">
<figure><img id="rung-{index}" src="{figures.picture(rung.frame)}" alt="{after}: {title}">
<figcaption>{after}</figcaption></figure>
{_change(before.frame, rung.frame, "Change of brightness by this step")}
</div>
</section>"""


def _change(before: F32, after: F32, caption: str) -> str:
    """The signed map of one change, on a scale of its own."""
    maps = Maps(
        reference=before,
        test=after,
        flip=np.zeros(after.shape[:2], dtype=np.float32),
        signed=metrics.luma(after) - metrics.luma(before),
        counted=np.ones(after.shape[:2], dtype=bool),
    )
    limit = figures.signed_limit(maps)
    ramp = f"background:linear-gradient(90deg,{','.join(figures.SIGNED_SCALE)})"
    return f"""<figure><img src="{figures.signed_map(maps, limit)}" alt="{caption}">
<figcaption>{caption}
<span class="scale"><b>−{limit:g}</b><i style="{ramp}"></i><b>+{limit:g}</b></span></figcaption></figure>"""


def _list(title: str, lines: tuple[str, ...] | list[str]) -> str:
    if not lines:
        return ""
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f'<h2>{title}</h2><ul class="absent">{items}</ul>'


def _noise(step: Step) -> str:
    if step.noise_psnr is None:
        return "–"
    text = _db(step.noise_psnr)
    return f'<strong class="noise">{text}: noise</strong>' if step.within_noise else text


def _verdict(step: Step) -> str:
    if step.within_noise:
        return ' · <strong class="noise">not more than noise; more samples would tell</strong>'
    return "" if step.noise_psnr is None else f" · its noise: {_db(step.noise_psnr)}"


def _share(value: float) -> str:
    return f"{_signed(value * 100, 1)} %"


def _signed(value: float, digits: int) -> str:
    text = f"{value:+.{digits}f}"
    return text[1:] if float(text) == 0 else text.replace("-", "−")


def _db(value: float) -> str:
    return "∞ dB" if value == float("inf") else f"{value:.1f} dB"


_PAGE = (
    HEAD
    + """<noscript><style>.viewer, .step button {{ display: none }}</style></noscript>
</head>
<body>
<header>
<h1>{title}</h1>
<p class="lead">{lead}</p>
</header>
<main>
<div class="viewer" id="viewer">
<div class="sides">{left}{right}</div>
<img-comparison-slider value="50" tabindex="0" aria-label="Two steps of the ladder, left and right"
 style="max-width:calc(70vh * {aspect})">
<figure slot="first"><img id="picture-left" alt=""><figcaption id="caption-left"></figcaption></figure>
<figure slot="second"><img id="picture-right" alt=""><figcaption id="caption-right"></figcaption></figure>
</img-comparison-slider>
</div>
{table}
<p class="quiet">From the real-time frame to the physical one, each step takes one cause away and keeps everything else.
Share: how far the step moves the picture along that way, so shares add up to 100 %; a gray bar leads away from it: that
cause hid another one. Where causes act together, the later step gets what they make together.</p>
{first}
{steps}
{absent}
{warnings}
</main>
<!-- {slider_license} -->
<script>{slider_js}</script>
<script type="module">{js}</script>
</body>
</html>
"""
)
