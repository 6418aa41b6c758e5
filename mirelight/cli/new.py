"""`mirelight new`: a first job for a capture; and the same without a file, for `mirelight render CAPTURE --light …`."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.errors import InputError, OutputError
from mirelight.base.progress import ShareProgress, quiet
from mirelight.cli import options, outputs, say
from mirelight.cli.command import Command
from mirelight.io.suffixes import GLTF, SPLATS, USD

if TYPE_CHECKING:
    from mirelight.io.job.overrides import Override
    from mirelight.model import Job


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("capture", metavar="CAPTURE", help="any splat file, or the folder of a training")
    parser.add_argument("-o", "--out", metavar="JOB", default="job.toml", help="the job to write (default: job.toml)")
    parser.add_argument("--light", metavar="LIGHT", default="", help="sun, point, or a file: .hdr, .exr, .glb, .gltf")
    parser.add_argument(
        "--object",
        metavar="FILE[#NODE]",
        action="append",
        default=[],
        dest="objects",
        help="a mesh to put into it, or one node of a glTF file; may be given several times",
    )
    parser.add_argument(
        "--cameras",
        metavar="FILE",
        help="the cameras of its pictures, a file or folder; default: what lies beside the capture",
    )
    options.add_json(parser)


_DIRECTORY = "out"


def run_new(args: argparse.Namespace) -> int:
    """The command. What was found goes to stdout."""
    from mirelight.apps.first_job import Wish, job_for
    from mirelight.cli.bar import bar
    from mirelight.io.atomic import write_file

    out = outputs.named(args.out, "a job is", ".toml")
    if out.exists():
        raise OutputError(f"{out}: is there already; name another with -o")
    objects = tuple(_object(x) for x in args.objects)
    capture = _capture(args.capture)
    cameras = None if args.cameras is None else Path(args.cameras)
    directory = _directory(out, capture)
    wish = Wish(light=args.light, objects=objects, estimated=True, directory=directory, cameras=cameras)
    with bar(args.json) as progress:
        found = job_for(capture, out.parent, wish, progress)
    write_file(out, found.text)
    notes = (found.up, *found.notes, found.as_captured)
    go_on = f"{out} is written; go on with: mirelight render {shlex.quote(str(out))}"
    say.outcome(args, {"files": [out], "notes": notes}, [*notes, go_on])
    return 0


def _directory(job: Path, capture: Path) -> str:
    """A folder for a job's frames that no other job beside it has, as frames of one name would replace each other; nor
    is it that of a training."""
    from mirelight.io.job.limits import load_toml

    own = f"{_DIRECTORY}-{job.stem}"
    if (job.parent / _DIRECTORY).resolve() in capture.resolve().parents:
        return own
    for other in job.parent.glob("*.toml"):
        try:
            taken = load_toml(other.read_text("utf-8"))["output"]["directory"]
        except (OSError, ValueError, KeyError, TypeError):  # no job, or a wrong one, as rendering it will say
            continue
        if taken == _DIRECTORY:
            return own
    return _DIRECTORY


COMMAND = Command(
    name="new",
    group="start",
    help="write a first job for a capture",
    description="Look at a capture, which way is up in it, how bright it is and what lies beside it, and write a "
    "commented job that renders well as it stands.",
    examples=(
        "new capture.ply",
        "new capture.sog -o evening.toml --light sun",
        "new capture.ply --object chair.glb",
        "new capture.ply --object kit.glb#lamp",
    ),
    arguments=_arguments,
    call=run_new,
    page="first capture",
)


def is_capture(path: str) -> bool:
    """Whether `mirelight render` is given splats in place of a job."""
    return not path.lower().endswith(".toml")


def is_stage(path: str) -> bool:
    """Whether it is a stage of OpenUSD, which may have lights of its own."""
    return path.lower().endswith(USD)


def refuse_capture(path: str) -> None:
    """Raises InputError where splats are given in place of a job, and nothing to light them by; or are not there."""
    if path.lower().endswith(SPLATS):
        from mirelight.io.safety import existing

        existing(path)
        remedy = f"add --light sun, or write a job with: mirelight new {shlex.quote(path)}"
        raise InputError(path, "splats, not a job", remedy)


def first_job(
    path: str,
    light: str,
    overrides: list[Override],
    note: Callable[[str], None],
    progress: ShareProgress = quiet,
) -> Job:
    """The job that `mirelight new` would write here, without a file; `note` hears of meshes and cameras that are not
    taken, `progress` of what is done.

    Raises:
        InputError: the capture or the light cannot be used.
    """
    from mirelight.apps.first_job import Wish, job_for
    from mirelight.io import job

    capture = _capture(path)
    found = job_for(capture, Path.cwd(), Wish(light=light), progress)
    for line in found.notes:
        note(line)
    return job.load_text(found.text, Path.cwd() / f"{capture.name.split('.')[0] or 'capture'}.toml", overrides)


def _object(text: str) -> tuple[Path, str | None]:
    """A file, and the node of it that is meant."""
    from mirelight.io.safety import existing

    file, _, node = text.rpartition("#")
    return (existing(file), node) if node and file.lower().endswith(GLTF) else (existing(text), None)


def _capture(name: str) -> Path:
    from mirelight.io.safety import existing
    from mirelight.io.splats.training import resolved

    path = existing(name)
    if path.suffix.lower() == ".toml":
        raise InputError(name, "a job, not a capture", "name a splat file")
    return resolved(path)
