"""An output folder as it stands, looked at without its job."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

from mirelight.base.errors import InputError
from mirelight.store.artefacts import Artefacts
from mirelight.store.claims import Claims, Held
from mirelight.store.index import Index
from mirelight.store.journal import Journal, Row
from mirelight.store.planned import Planned, PlannedFrame, PlannedRuns

ASIDE = ".mirelight"


class Folder:
    """What a folder holds and lacks, by what its runs have written down. Looking changes nothing.

    Args:
        path: the output folder of a job.

    Raises:
        InputError: there is no such folder.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if not self.path.is_dir():
            remedy = "give the folder that a job's frames are in (output.directory, or --out)"
            raise InputError(path, "no such folder" if not self.path.exists() else "a file", remedy)
        aside = self.path / ASIDE
        self.journal = Journal(aside / "journal")
        self.light, self.scene = Artefacts(aside / "light"), Artefacts(aside / "scene")
        self._claims = Claims(aside / "claims")
        self._planned = PlannedRuns(aside / "plans")

    @cached_property
    def runs(self) -> tuple[Planned, ...]:
        """What was to be made, oldest first; none where nothing was written down."""
        return tuple(self._planned.runs())

    @cached_property
    def planned(self) -> tuple[PlannedFrame, ...]:
        """Every frame that was to be made, as the newest run had it."""
        return self._planned.frames()

    @cached_property
    def rows(self) -> tuple[tuple[Row, ...], ...]:
        """What was written, by process, each in order."""
        return tuple(tuple(rows) for rows in self.journal.by_process())

    @cached_property
    def index(self) -> Index:
        """The index of the files that are there."""
        return Index(self.path, (row for rows in self.rows for row in rows))

    @cached_property
    def kept(self) -> frozenset[str]:
        """Keys of the layers that are there."""
        return self.light.there()

    def has(self, frame: PlannedFrame) -> bool:
        """Whether a frame is there; of a job that keeps layers alone, whether they are."""
        layers = self.layers.get(frame.group, ())
        return self.kept.issuperset(layers) if layers else bool(frame.files) and self.index.has(frame)

    @cached_property
    def layers(self) -> dict[str, tuple[str, ...]]:
        """By group the keys of what is kept instead of frames."""
        return {group: keys for run in self.runs for group, keys in run.layers.items()}

    def held(self) -> list[Held]:
        """Who works on what, the oldest first."""
        return self._claims.held()
