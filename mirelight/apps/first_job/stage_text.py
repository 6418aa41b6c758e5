"""A first job of a whole stage: its own splats, meshes, cameras and lights, rendered as they stand."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from mirelight.apps.first_job.toml_text import Names, quoted
from mirelight.base.errors import printable
from mirelight.io.suffixes import USD
from mirelight.io.usd.contents import Contents, contents


def of_stage(capture: Path, folder: Path, resolution: tuple[int, int], directory: str) -> str | None:
    """The job's text; None where it is no stage, or one without lights, for which a light is chosen as for any capture.

    Args:
        capture: a file of splats.
        folder: where the job will be, which its paths are relative to.
        resolution: width and height of pictures in pixels.
        directory: of the frames.

    Raises:
        InputError: a stage that cannot be used.
    """
    if capture.suffix.lower() not in USD:
        return None
    found = contents(capture)
    if not (found.lamps or found.domes) or not (found.splats or found.meshes):
        return None
    lines = _lines(found, Names(folder)(capture), printable(capture.name), resolution)
    return "\n".join([*lines, f"directory = {quoted(Path(directory))}"]) + "\n"


def said(path: Path) -> str:
    """What a stage has, for people."""
    found = contents(path)
    counts = {"splats": found.splats, "meshes": found.meshes, "cameras": found.cameras, "lamps": found.lamps}
    counts["domes"] = found.domes
    return "A stage: " + ", ".join(f"{count:,} {name}" for name, count in counts.items()) + ". Metres, +Y is up."


def _lines(found: Contents, name: str, title: str, resolution: tuple[int, int]) -> Iterator[str]:
    yield f"# {title}: a whole stage, written by `mirelight new`."
    if found.splats:
        yield f"splats = {name}"
    if found.meshes:
        colours = "" if found.splats else ', albedo = "file"'
        yield f"proxy = {{ path = {name}{colours} }}"
    else:
        yield 'proxy = "splats" # made from the splats once'
    yield f"resolution = [{resolution[0]}, {resolution[1]}]"
    if found.cameras:
        yield f'cameras_from = {name} # of one that moves: {{ path = …, names = ["…"], fps = 24 }}'
    yield ""
    if found.splats:
        yield "# The light that the splats were captured under is not known; an even one of 1 cd/m² is assumed."
        yield "[captured]"
        yield "environment = { radiance = 1.0 }"
        yield ""
    yield "[[lightings]]"
    yield 'name = "stage"'
    if found.lamps:
        yield f"lights_from = {name}"
    if found.domes:
        yield f"environment = {name} # its dome lights"
    yield ""
    yield "[render]"
    yield "spp = 64 # samples per pixel; more is cleaner and slower"
    if find_spec("pyoidn") is not None:
        yield "denoise = true"
    yield ""
    yield "[output]"
