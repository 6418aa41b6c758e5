"""The job as the page has it, saved beside the job file: `mirelight render` takes it as it is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mirelight.base.errors import InputError
from mirelight.io import job as jobs
from mirelight.io.atomic import write_file
from mirelight.io.job import Source
from mirelight.io.job.limits import large_numbers, load_toml
from mirelight.io.job.write import with_mix
from mirelight.io.safety import open_binary

NAME = "mix.toml"
MOST_BYTES = 1 << 20


class Saved:
    """The one file that a page may write.

    Args:
        source: the job file as it was read.

    Raises:
        InputError: a file of that name is there, and is not one that was saved so.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._head = ("saved by mirelight mix --serve", f"the job {source.path.name} with the light of its page")
        self.path = source.folder / NAME
        if "sweep" in source.data:
            raise InputError(
                source.shown, "lightings made by a sweep, which are not saved", "take it out", field="sweep"
            )
        self._spare_others()

    def _spare_others(self) -> None:
        if self.path.exists() and not self._is_ours():
            raise InputError(
                self.path, "a file that was not saved by this job's page", f"rename it: {NAME} is the page's"
            )

    def _is_ours(self) -> bool:
        mark = "".join(f"# {line}\n" for line in self._head).encode()
        try:
            with open_binary(self.path) as file:
                return file.read(len(mark)) == mark
        except InputError:
            return False

    def save(self, text: bytes) -> None:
        """Write the job with the tables that the page exports.

        Args:
            text: TOML with `mix`, `moved` and `display.exposure`, and nothing else.

        Raises:
            InputError: it is something else, or does not fit the job.
            OutputError: the file cannot be written.
        """
        mix, moved, exposure = _read(text)
        self._spare_others()
        lightings = self._source.data.get("lightings") or [{"name": "lighting"}]
        if len(lightings) == 1:  # where there is one, the page leaves its name out
            name = lightings[0]["name"]
            plain = {key: value for key, value in moved.items() if not isinstance(value, dict)}
            moved = {key: value for key, value in moved.items() if isinstance(value, dict)}
            moved = {**moved, name: {**moved.get(name, {}), **plain}} if plain else moved
        made = with_mix(self._source, mix, moved, exposure, self.path, self._head)
        jobs.load_text(made, self.path)
        write_file(self.path, made)


def _read(text: bytes) -> tuple[Mapping[str, Any], dict[str, Any], float]:
    try:
        data = load_toml(text.decode("utf-8"))
    except ValueError:
        raise InputError("the page", "no TOML") from None
    if large_numbers(data):
        raise InputError("the page", "a number of more than 64 bits")
    display = data.pop("display", {})
    mix, moved = data.pop("mix", {}), data.pop("moved", {})
    if data or not all(isinstance(x, dict) for x in (mix, moved, display)) or set(display) - {"exposure"}:
        raise InputError("the page", "more than mix, moved and exposure")
    exposure = display.get("exposure", 0.0)
    if not isinstance(exposure, int | float) or isinstance(exposure, bool):
        raise InputError("the page", "an exposure that is no number")
    if any(not isinstance(x, dict | list) for x in moved.values()):
        raise InputError("the page", "a place that is none")
    return mix, moved, float(exposure)
