"""The report in a real browser, opened from disk: the slider is dragged and the numbers are read."""

from __future__ import annotations

import base64
import io
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.compare import CompareSettings, Outcome, compare, find_pairs, parse_requirement


@pytest.fixture
def report(made: Any, save: Any, lighter: Any, tmp_path: Path) -> tuple[Path, Outcome]:
    """Three pairs: identical, noise, and clearly brighter; one requirement fails."""
    rng = np.random.default_rng(1)
    frames = [made(k, sigma=0.02) for k in range(3)]
    noise = 1 + 0.01 * rng.normal(size=(*frames[1].rgba.shape[:2], 3))
    tests = [frames[0], lighter(frames[1], noise), lighter(frames[2], 1.8)]
    for k, name in enumerate(("same", "noisy", "bright <b>&amp;")):
        save(frames[k], f"ref/{name}.exr")
        save(tests[k], f"test/{name}.exr")
    outcome = compare(
        find_pairs([tmp_path / "ref"], [tmp_path / "test"]),
        CompareSettings(),
        requirements=[parse_requirement("psnr>=30")],
        html=tmp_path / "report.html",
    )
    return tmp_path / "report.html", outcome


def test_the_slider_is_dragged_and_the_numbers_are_read(page: Any, report: tuple[Path, Outcome]) -> None:
    file, outcome = report
    page.open(file, 1280, 900)

    order = page.run("[...document.querySelectorAll('.summary tbody th')].map(x => x.innerText)")
    assert order == [r.name for r in outcome.results] == ["bright <b>&amp;", "noisy", "same"]
    for figure, digits in (("flip", 4), ("psnr", 2), ("ssim", 4), ("delta_e", 2)):
        shown = page.run(f"[...document.querySelectorAll('.summary [data-figure={figure}]')].map(x => x.innerText)")
        for text, result in zip(shown, outcome.results, strict=True):
            value = getattr(result.overall, figure)
            assert text.split()[0] == ("∞" if value == float("inf") else f"{value:.{digits}f}")
    chips = page.run("[...document.querySelectorAll('.summary .chip')].map(x => x.innerText)")
    assert chips == ["difference", "within noise", "identical"]
    assert "is not met" in page.run("document.querySelector('.failures').innerText")
    regions = page.run("[...document.querySelectorAll('#pair-0 [data-region]')].map(x => x.dataset.region)")
    assert regions == ["all", "covered", "silhouette"]

    slider = "document.querySelector('#pair-0 img-comparison-slider')"
    page.run(f"{slider}.scrollIntoView({{block: 'center'}})")
    x, y, width, height = page.run(
        f"(() => {{ const r = {slider}.getBoundingClientRect(); return [r.x, r.y, r.width, r.height] }})()"
    )
    middle = y + height / 2
    before = pixels(page)
    page.drag((x + width * 0.5, middle), (x + width * 0.2, middle))
    assert page.run(f"Number({slider}.value)") == pytest.approx(20, abs=1)
    after = pixels(page)
    at = (slice(int(y + height * 0.3), int(y + height * 0.35)), slice(int(x + width * 0.3), int(x + width * 0.4)))
    assert after[at].mean() > before[at].mean() * 1.1  # the brighter test now shows where the reference was
    page.drag((x + width * 0.2, middle), (x + width * 0.9, middle))
    assert page.run(f"Number({slider}.value)") == pytest.approx(90, abs=1)

    sizes = page.run("[...document.images].map(x => [x.naturalWidth, x.naturalHeight])")
    assert sizes == [[64, 48]] * 12
    assert page.complaints() == []


@pytest.mark.parametrize(("width", "height"), [(1280, 900), (390, 844)])
def test_it_fits_phones_and_desktops_in_light_and_dark(
    page: Any, report: tuple[Path, Outcome], width: int, height: int
) -> None:
    background = {}
    for scheme in ("light", "dark"):
        page.open(report[0], width, height, scheme)
        assert page.run("document.documentElement.scrollWidth") <= width
        wide = page.run(
            "[...document.querySelectorAll('img, svg, img-comparison-slider, h2, details')]"
            f".filter(x => x.getBoundingClientRect().right > {width}).length"
        )
        assert wide == 0
        background[scheme], text = page.run(
            "(() => { const s = getComputedStyle(document.body);"
            " return [s.backgroundColor, s.color].map(c => c.match(/\\d+/g).slice(0, 3).map(Number)) })()"
        )
        assert contrast(background[scheme], text) > 7
        for selector in (".quiet", ".files", ".chip.difference", ".chip.noise", ".failures"):
            own, behind = page.run(f"""(() => {{
                const x = document.querySelector('{selector}'); let b = x, colour;
                do {{ colour = getComputedStyle(b).backgroundColor; b = b.parentElement }}
                while (/, 0\\)$/.test(colour))
                return [getComputedStyle(x).color, colour].map(c => c.match(/\\d+/g).slice(0, 3).map(Number))
            }})()""")
            assert contrast(own, behind) > 4.5, (selector, scheme)
        assert page.complaints() == []
    assert sum(background["dark"]) < 150 < 600 < sum(background["light"])


def test_settings_of_both_sides_are_shown(page: Any, made: Any, save: Any, lighter: Any, tmp_path: Path) -> None:
    frame = made()
    other = lighter(frame, 1.1)
    settings = {**frame.made_by.settings, "render": {"spp": 256}}
    other = replace(other, made_by=replace(frame.made_by, settings=settings))
    pairs = find_pairs([save(frame, "a/f.exr")], [save(other, "b/f.exr")])
    compare(pairs, html=tmp_path / "r.html")
    page.open(tmp_path / "r.html", 1280, 900)
    rows = page.run("[...document.querySelectorAll('.settings .differs')].map(x => x.textContent)")
    assert rows == ["settings.render.spp64256"]


def test_the_file_is_whole_in_itself(report: tuple[Path, Outcome]) -> None:
    """No address but data; the licence of the slider is inside; every tag is closed."""
    text = report[0].read_text(encoding="utf-8")
    assert "Copyright (c) 2019 Dmitry Snisarenko" in text
    assert "bright &lt;b&gt;&amp;amp;" in text
    assert "<b>&amp;" not in text.split("<script>")[0].replace("bright &lt;b&gt;", "")

    class Checker(HTMLParser):
        open: list[str] = []  # noqa: RUF012

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            for name, value in attrs:
                if name in ("src", "href"):
                    assert value is not None
                    assert value.startswith(("data:", "#"))
            if tag not in ("meta", "img"):
                self.open.append(tag)

        def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            assert tag == "path"

        def handle_endtag(self, tag: str) -> None:
            assert self.open.pop() == tag

    checker = Checker()
    checker.feed(text)
    assert checker.open == []


def pixels(page: Any) -> Any:
    from PIL import Image

    return np.asarray(
        Image.open(io.BytesIO(base64.b64decode(page.send("Page.captureScreenshot")["data"]))), dtype=float
    )


def contrast(a: list[int], b: list[int]) -> float:
    """WCAG 2 contrast ratio of two sRGB colours."""
    from mirelight.base import colour

    light, dark = sorted((float(colour.luminance(colour.srgb_decode(np.array(c) / 255))) for c in (a, b)), reverse=True)
    return (light + 0.05) / (dark + 0.05)
