"""What a frame's files cost: bytes and CPU seconds by compression, 16-bit colour, and what they hold.

    .venv/bin/mirelight render scenes/courtyard/job.toml --lighting night --camera front \\
        --set render.spp=8 --set output.half=false -o out/files
    .venv/bin/python scripts/bench_files.py out/files/front.night.exr

A frame's whole, 32-bit EXR is read, then written and read again and again; the least CPU time of five counts, of all
threads together. Waiting for the disk is not CPU time. Noise compresses badly, so few samples are the worst case.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import get_args

from mirelight.io.image import is_intact, read, read_fingerprint, write
from mirelight.model import Compression, OutputSettings

HOLDS = {
    "everything": OutputSettings(),
    "picture and lights": OutputSettings(aovs=False),
    "picture": OutputSettings(aovs=False, layers=False),
}


def cpu(call: Callable[[], object], repeats: int = 5) -> float:
    """Least CPU seconds of some calls, after one that does not count."""
    call()
    found = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        found.append(time.process_time() - start)
    return min(found)


def main() -> None:
    """Print the table of one frame."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("exr", type=Path, help="a frame with everything in it")
    frame = read(parser.parse_args().exr)
    layers = len(frame.lighting.layers) if frame.lighting else 0
    print(f"{frame.camera.width} x {frame.camera.height}, {layers} layers of lights")
    with tempfile.TemporaryDirectory() as folder:
        exr, png = Path(folder) / "a.exr", Path(folder) / "a.png"
        for compression in get_args(Compression):
            for half in (False, True):
                for held, settings in HOLDS.items():
                    output = replace(settings, compression=compression, half=half)
                    written = cpu(lambda output=output: write(frame, exr, output=output))  # type: ignore[misc]
                    taken = cpu(lambda: read(exr))
                    size = exr.stat().st_size / 1e6
                    label = f"{compression:5} {16 if half else 32}-bit colour, {held:20}"
                    print(f"{label} {size:6.1f} MB, {written:.3f} s, read {taken:.3f} s")
        small = replace(HOLDS["picture"], half=True)

        def both() -> None:
            write(frame, exr, output=small)
            write(frame, png)

        together, alone = cpu(both), cpu(lambda: write(frame, png))
        print(f"PNG {png.stat().st_size / 1e6:.1f} MB, {alone:.3f} s; with the picture in 16-bit EXR {together:.3f} s")
        write(frame, exr)
        print(f"fingerprint {cpu(lambda: read_fingerprint(exr)):.4f} s, intact {cpu(lambda: is_intact(exr)):.3f} s")


if __name__ == "__main__":
    main()
