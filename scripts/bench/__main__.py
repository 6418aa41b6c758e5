"""The benchmarks: how good frames are, and what they cost.

    python scripts/bench PART [its options] [--quick] [--json FILE]
    python scripts/bench tables     # the pages of docs/benchmarks, from the JSON files beside them

Each part prints its tables. `--json` puts them into a file as docs/benchmarks has them: a table takes the place of the
one in the section with its title, and the section's text stays. `--quick` shows that a part runs; its figures say
nothing.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run as a folder, this one alone is on the path

from bench import pages
from bench.common import path
from mirelight.base.version import __version__

PARTS = {
    "truth": "how close frames come to path-traced truth: proxies, captured light, samples, denoising",
    "objects": "objects in a capture beside path-traced truth",
    "gloss": "highlights beside path-traced truth, materials given and told from pictures",
    "shipped": "the shipped capture that was trained on pictures, relit, beside its truth",
    "modes": "ways of relighting on the shipped scenes, and what formats lose of a bake",
    "lighting": "error and CPU time of this tracer, Mitsuba's path and Blender Cycles",
    "noise": "what layers, AOVs and noise targets cost, and whether error bars are true",
    "surface": "what light on the surface gains",
    "compositor": "milliseconds of the compositor's stages",
    "batch": "what a batch costs beside its light",
    "files": "bytes and CPU seconds of a frame's files",
    "mixer": "what a moved light costs on the mixer's page",
    "studio": "how soon the studio shows a capture in its light",
    "lens": "samples of light that the pinholes of a lens need",
    "start": "what it takes from a clone to pictures, and until commands answer",
    "usd": "lights of UsdLux beside their closed forms, one panorama in four primaries",
    "cycles": "whether Blender Cycles and this tracer show the same light",
}


def main(arguments: Sequence[str]) -> int:
    """Run a part; heavy imports are those of that part alone."""
    parser = argparse.ArgumentParser(
        prog="scripts/bench", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    commands = parser.add_subparsers(dest="part", required=True, metavar="PART")
    commands.add_parser("tables", help="write the pages of docs/benchmarks")
    asked = next((x for x in arguments if not x.startswith("-")), "")
    for name, help_ in PARTS.items():
        part = commands.add_parser(name, help=help_)
        part.add_argument("--quick", action="store_true", help="small and few: does it run?")
        part.add_argument("--json", type=path, metavar="FILE", help="put the tables there")
        if name == asked:
            import_module(f"bench.{name}").options(part)
    chosen = parser.parse_args(arguments)
    if chosen.part == "tables":
        pages.write()
        return 0
    if chosen.json is not None and not chosen.json.parent.is_dir():
        parser.error(f"--json {chosen.json}: the folder does not exist")
    tables = import_module(f"bench.{chosen.part}").run(chosen)
    for table in tables:
        print(f"\n{table.title}\n\n{pages.block(asdict(table))}", flush=True)
    if chosen.json is not None:
        places = ("--json", "--cache", "--pictures")  # of one machine, and of no weight for a figure
        kept = [x for i, x in enumerate(arguments) if x not in places and arguments[max(i - 1, 0)] not in places]
        pages.put(chosen.json, [asdict(x) for x in tables], f"python scripts/bench {shlex.join(kept)}", __version__)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
