"""`mirelight export`: the frames of an output folder as a data set, or a stage; the end of `mirelight render`, too."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.layouts import LAYOUTS
from mirelight.cli import options, say
from mirelight.cli.command import Command

if TYPE_CHECKING:
    from mirelight.dataset.view import DataSet
    from mirelight.model import DatasetSettings, Job, Layout
    from mirelight.store import Store

STAGE = "usd"
_CLAIM = "the data sets"


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", metavar="DIR", help="the job's output folder")
    parser.add_argument(
        "--layout", required=True, choices=(*LAYOUTS, STAGE), help="how files are laid out; usd: a stage of OpenUSD"
    )
    parser.add_argument(
        "-o", "--out", metavar="DIR|FILE", required=True, help="folder of the data set, or the stage's file"
    )
    options.add_lightings(parser)
    parser.add_argument("--normalize", action="store_true", help="move and scale the world into a box of ±1")
    parser.add_argument("--split", choices=("camera", "lighting", "both"), default="camera", help="what is held out")
    parser.add_argument("--held-out", metavar="SHARE", type=float, default=0.1, help="of the names, 0 to 1 (0.1)")
    parser.add_argument("--seed", type=int, default=0, help="of what is held out (0)")
    parser.add_argument("--no-hdr", action="store_true", help="no linear pictures beside those of 8 bits")
    parser.add_argument("--license", default="", help="of the data set, for its page")
    options.add_json(parser)
    options.add_quiet(parser)


def run_export(args: argparse.Namespace) -> int:
    """The command. Progress goes to stderr, one line at the end to stdout."""
    from mirelight import dataset
    from mirelight.base.errors import InputError
    from mirelight.cli import stop
    from mirelight.cli.stage import run_stage
    from mirelight.io.job.settings_tables import LICENSE, is_license
    from mirelight.model import DatasetSettings

    if args.layout == STAGE:
        return run_stage(args)
    if not 0 <= args.held_out <= 1:
        raise InputError("--held-out", f"{args.held_out:g}", "give a share of the names, 0 to 1")
    if not is_license(args.license):
        raise InputError("--license", repr(args.license)[:80], f"give a name such as {LICENSE}")
    settings = DatasetSettings(
        normalize=args.normalize,
        split=args.split,
        held_out=args.held_out,
        seed=args.seed,
        license=args.license,
        hdr=not args.no_hdr,
    )
    counted = Counted(args.quiet)
    try:
        done = counted.export(dataset.open(args.folder), Path(args.out), args.layout, settings, args.lighting)
    except BaseException as e:
        code = stop.exit_code(e)
        if code is None:
            raise
        say.remark(f"interrupted; {counted.far} are in {args.out}, and the same command goes on from there")
        return code
    say.outcome(args, {"folder": args.out, "layout": args.layout, **counted.as_json()}, [done])
    return 0


COMMAND = Command(
    name="export",
    group="data",
    help="write the frames of an output folder as a data set",
    description='Mixes frames from the layers that `mirelight render` has kept (output.store "layers" or "both"). '
    "What is there already is not made again, so an interrupted export goes on when it is started again. "
    "--layout usd writes the job that was rendered there as a stage: splats, proxy, lights, cameras, frames by name.",
    examples=(
        "export out --layout nerf -o out/nerf",
        "export out --layout hub -o set --held-out 0.2 --license CC-BY-4.0",
        "export out --layout usd -o out/shot.usdc --lighting evening",
    ),
    arguments=_arguments,
    call=run_export,
    page="data sets",
)


@dataclass(frozen=True, slots=True)
class _Frame:
    name: str
    camera: None = None  # all frames take alike


class Counted:
    """Exports with progress on stderr."""

    def __init__(self, quiet: bool) -> None:
        from mirelight.cli import progress

        self._tally, self._last = progress.chosen(quiet), 0.0

    @property
    def far(self) -> str:
        """How many frames are there: "3 of 10 frames"."""
        return f"{self._tally.there} of {self._tally.total} frames"

    def as_json(self) -> dict[str, object]:
        """Its figures, as those of a render."""
        tally = self._tally
        return {"frames": tally.there, "skipped": tally.skipped, "seconds": round(tally.elapsed, 3)}

    def export(
        self,
        data: DataSet,
        out: Path,
        layout: Layout,
        settings: DatasetSettings,
        lightings: Sequence[str] | None = None,
    ) -> str:
        """One export; a line that says what is there."""
        from mirelight.cli import progress
        from mirelight.dataset.export import export

        with self._tally as tally:
            count = export(data, out, layout, settings, lightings, self)
        existed = f", {tally.skipped} of them already there" if tally.skipped else ""
        return f"{count} frames in {out}{existed}; {progress.duration(tally.elapsed)}"

    def started(self, count: int) -> None:
        """Starts counting before the first frame."""
        self._tally.started([_Frame("")] * count)
        self._last = self._tally.elapsed

    def finished(self, name: str, skipped: bool) -> None:
        """Counts a frame that is finished."""
        took, self._last = self._tally.elapsed - self._last, self._tally.elapsed
        self._tally.finished(_Frame(name), None if skipped else took)

    def note(self, line: str) -> None:
        """Prints a line for the person who waits."""
        self._tally.note(f"mirelight: {line}")


def at_end(job: Job, store: Store, quiet: bool) -> list[str]:
    """Write the job's data sets once the layers of all its frames are there; a line for each. Where another process
    writes them, or frames are missing, that is said instead."""
    from mirelight import dataset
    from mirelight.base.errors import InputError

    if not job.dataset.layouts:
        return []
    try:
        data = dataset.open(store.folder)
    except InputError:
        data = None
    if data is None or len(data.cameras) < len(job.cameras):
        there = 0 if data is None else len(data.cameras)
        return [f"data sets are written when all cameras are there: {there} of {len(job.cameras)} are"]
    with store.claim(_CLAIM) as mine:
        if not mine:
            return ["another process writes the data sets"]
        folder = store.folder / "dataset"
        return [Counted(quiet).export(data, folder / layout, layout, job.dataset) for layout in job.dataset.layouts]
