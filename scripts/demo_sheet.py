"""One picture of what relighting does: capture, tint, ratio and truth side by side, with their PSNR against the truth.

    mirelight render scenes/courtyard/job.toml --camera front --out out/courtyard/ratio
    mirelight render scenes/courtyard/job.toml --camera front --set relight.mode=tint --out out/courtyard/tint
    python scripts/demo_sheet.py scenes/courtyard --camera front --frames out/courtyard

The frames' folder holds `ratio/` and `tint/`; the sheet is written beside them.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from page_pictures import Pixels, picture, unlit

from mirelight.base.errors import InputError, MirelightError
from mirelight.io.atomic import atomic_path

MARGIN, CAPTION, HEADING = 14, 40, 64
INK, QUIET, PAPER = (236, 232, 224), (166, 160, 150), (24, 23, 22)


@dataclass(frozen=True, kw_only=True)
class Row:
    """One lighting: what was captured, the two relit pictures, and the true one, all (H, W, 3) display values."""

    lighting: str
    capture: Pixels
    tint: Pixels
    ratio: Pixels
    truth: Pixels

    def scores(self) -> dict[str, float]:
        """PSNR in dB of each picture against the truth."""
        relit = {"capture": self.capture, "tint": self.tint, "ratio": self.ratio}
        return {name: psnr(shown, self.truth) for name, shown in relit.items()}


def psnr(shown: Pixels, truth: Pixels) -> float:
    """Peak signal-to-noise ratio of display values, in dB."""
    difference = (shown.astype(np.float64) - truth.astype(np.float64)) / 255
    return -10 * math.log10(max(float(np.mean(difference**2)), 1e-12))


def rows_of(scene: Path, frames: Path, camera: str) -> list[Row]:
    """A row for each lighting that was rendered in both modes and has a true picture of the same size."""
    rows = []
    for relit in sorted((frames / "ratio").glob(f"{camera}.*.png")):
        tinted, truth = frames / "tint" / relit.name, scene / "truth" / relit.name
        if not (tinted.exists() and truth.exists()):
            continue
        pictures = {"capture": unlit(relit), "tint": picture(tinted), "ratio": picture(relit), "truth": picture(truth)}
        if len({x.shape for x in pictures.values()}) > 1:
            sizes = ", ".join(f"{name} {x.shape[1]}x{x.shape[0]}" for name, x in pictures.items())
            raise InputError(relit, f"pictures of different sizes: {sizes}", "render at the size of the truth")
        rows.append(Row(lighting=relit.stem.removeprefix(f"{camera}."), **pictures))
    return rows


def draw(rows: list[Row], title: str, path: Path, width: int) -> None:
    """The sheet: a row for each lighting, panels `width` pixels wide."""
    from PIL import Image, ImageDraw, ImageFont

    height = round(width * rows[0].truth.shape[0] / rows[0].truth.shape[1])
    size = (4 * (width + MARGIN) + MARGIN, HEADING + len(rows) * (height + CAPTION + MARGIN))
    sheet = Image.new("RGB", size, PAPER)
    pen = ImageDraw.Draw(sheet)
    big, small = ImageFont.load_default(24), ImageFont.load_default(17)
    pen.text((MARGIN, 18), title, fill=INK, font=big)
    for k, row in enumerate(rows):
        y = HEADING + k * (height + CAPTION + MARGIN)
        scores = row.scores()
        captions = (
            ("capture", f"as captured, {scores['capture']:.1f} dB"),
            ("tint", f"tint, {scores['tint']:.1f} dB"),
            ("ratio", f"ratio, {scores['ratio']:.1f} dB"),
            ("truth", f"truth ({row.lighting})"),
        )
        for j, (name, caption) in enumerate(captions):
            x = MARGIN + j * (width + MARGIN)
            panel = Image.fromarray(getattr(row, name)).resize((width, height), Image.Resampling.LANCZOS)
            sheet.paste(panel, (x, y))
            pen.text((x, y + height + 8), caption, fill=INK if name in ("ratio", "truth") else QUIET, font=small)
    with atomic_path(path) as temporary:
        sheet.save(temporary, "PNG" if path.suffix == ".png" else "JPEG", optimize=True, quality=88)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder of a shipped scene, with truth/")
    parser.add_argument("--camera", default="front")
    parser.add_argument("--frames", type=Path, required=True, help="folder with ratio/ and tint/")
    parser.add_argument("--width", type=int, default=480, help="of a panel, in pixels")
    parser.add_argument("-o", "--output", type=Path, help=".png or .jpg; else CAMERA.sheet.png in the frames' folder")
    arguments = parser.parse_args()
    try:
        rows = rows_of(arguments.scene, arguments.frames, arguments.camera)
        if not rows:
            found = "no lighting was rendered in both modes for a camera that has a true picture"
            raise InputError(arguments.frames, found, "run the two commands of --help first")
        path = arguments.output or arguments.frames / f"{arguments.camera}.sheet.png"
        draw(
            rows,
            f"{arguments.scene.resolve().name}: relit against path-traced truth (PSNR of display values)",
            path,
            arguments.width,
        )
    except MirelightError as error:
        print(f"demo_sheet: {error}", file=sys.stderr)
        return 2
    for row in rows:
        scores = "  ".join(f"{name} {value:5.1f} dB" for name, value in row.scores().items())
        print(f"{row.lighting:10} {scores}")
    print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
