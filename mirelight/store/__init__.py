"""Frames in a folder: which are there, new ones, and what they are made from. Safe for several processes and machines.

The frame files are the truth: each carries the key of what it was made from. Beside them `.mirelight/` holds the
journal (what was written, so that ten thousand frames are known at once), claims (who works on which camera), and
artefacts (traced unit lights, so that a changed colour or intensity traces nothing). It can be removed at any time.
"""

from __future__ import annotations

import hashlib
import math
import os
import re
import tempfile
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from pathlib import Path

from mirelight.base.errors import OutputError
from mirelight.io import image
from mirelight.io.atomic import clear, output_error
from mirelight.io.folders import NewFolders
from mirelight.io.safety import read_file
from mirelight.model import DisplaySettings, Frame, Job, OutputSettings, SplatLayer
from mirelight.pipeline import keys
from mirelight.pipeline.codecs import composite_of
from mirelight.pipeline.plan import FrameTask
from mirelight.store.artefacts import Artefacts, StoredArtefacts
from mirelight.store.ballast import Ballast
from mirelight.store.claims import Claims
from mirelight.store.folder import ASIDE
from mirelight.store.index import Index, row_of
from mirelight.store.journal import FileRow, Journal, Row, sync_folder
from mirelight.store.planned import PlannedRuns
from mirelight.store.touching import Toucher

__all__ = ["Index", "Row", "Store", "write"]


class Store:
    """The output folder of a job: its frames; `artefacts` is what they are made from.

    Args:
        job: its output folder and the settings of its files are used.
    """

    def __init__(self, job: Job) -> None:
        self.folder = job.output.directory
        self._output, self._display = job.output, job.display
        aside = self.folder / ASIDE
        self._aside = {name: aside / name for name in ("journal", "claims", "light", "scene", "plans")}
        self._journal = Journal(self._aside["journal"])
        self._toucher = Toucher()
        self._claims = Claims(self._aside["claims"], self._toucher)
        self._job = str(job.source.absolute())
        maker = hashlib.sha256(self._job.encode(errors="surrogateescape")).hexdigest()[:16]
        self._light, self._scene = (Artefacts(self._aside[name], maker) for name in ("light", "scene"))
        self.artefacts = StoredArtefacts(self._scene, self._light, job.output.store, self.claim)
        self._opened = 0.0  # by the folder's own clock
        self.planned = PlannedRuns(self._aside["plans"])
        self._index: Index | None = None
        self._ballast = Ballast(aside, self._toucher)
        self._run = ""
        self._new = NewFolders(self.folder, *self._aside.values())
        self.partial: tuple[Path, ...] = ()  # of the frame that an interrupt stopped, where it could be kept

    def open(self) -> None:
        """Make the folder, see that files can be written there before hours of work, and clear away what killed
        processes left.

        Raises:
            OutputError: they cannot be written.
        """
        self._new.make()
        try:
            with tempfile.TemporaryFile(dir=self.folder) as probe:
                self._opened = os.fstat(probe.fileno()).st_mtime
        except OSError as e:
            raise output_error(self.folder, e) from None
        for folder in (self.folder, *self._aside.values()):
            clear(folder)
        clear(self._ballast.folder)
        self._claims.clear()
        self._ballast.take()

    def begin(self, run: str) -> None:
        """Work for a scheduler's run of that name: see :meth:`mirelight.store.claims.Claims.claim`."""
        self._run = run
        self._ballast.take()

    def rest(self, run: str) -> None:
        """No more work of that run: the ballast's room is given back, unless another run has begun."""
        if run == self._run:
            self._ballast.free()

    def close(self) -> None:
        """No more writing by this process. What is left of others that were killed meanwhile is cleared away, and of
        what a scene needs besides light the oldest, beyond a reserve."""
        self._journal.close()
        self._claims.close()
        self._ballast.free()
        for folder in (self.folder, *self._aside.values(), self._ballast.folder):
            clear(folder)
        self._claims.clear()
        self._scene.tidy(self._named(), self._opened)

    def withdraw(self) -> None:
        """Close, and where nothing came of the run take away what opening made: bad input leaves no empty folders, and
        no plan of what cannot be made. Whatever was there before, was made, or is another process's, stays."""
        self.close()
        aside = self.folder / ASIDE
        if aside not in self._new:
            return
        held = [x for x in aside.rglob("*") if not x.is_dir()]
        plans = (aside, self._aside["plans"])  # the index of what is to be kept, and the plan
        if all(x.parent in plans and x.suffix == ".json" and x.name[0] != "." for x in held):
            with suppress(OSError):  # of another process, that takes them away as well
                for path in held:
                    path.unlink()
            self._new.remove()

    # --- frames ---

    def index(self) -> Index:
        """What is there now, from the journal and one look at the folder."""
        self._index = Index(self.folder, self._journal.rows())
        return self._index

    @property
    def bad_rows(self) -> int:
        """Lines of the journal that are no rows, of those that were read."""
        return self._journal.bad

    def hear(self, tell: Callable[[str], None]) -> None:
        """Have what is found damaged, and is made again, said."""
        self._light.tell = self._scene.tell = tell

    def refresh(self) -> None:
        """Take what other processes have written into the journal since it was read."""
        if self._index is not None:
            self._index.add(self._journal.new_rows())

    def has(self, task: FrameTask) -> bool:
        """Whether every file of the frame is there, whole, and made from the same inputs; each is looked at now."""
        return not self.missing(task)

    def missing(self, task: FrameTask) -> list[str]:
        """Suffixes of the frame's files that are not there, or not made from these inputs; each is looked at now."""
        index = self._index or self.index()
        files = task.files.items()
        return [suffix for suffix, key in files if not index.has_file(self.folder / f"{task.name}{suffix}", key)]

    def put(self, task: FrameTask, frame: Frame, seconds: float = 0.0) -> None:
        """Write those of the frame's files that are not there, each whole or not at all, then its row; remove those of
        an interrupted try and its preview.

        Raises:
            OutputError: a file cannot be written.
        """
        rows: dict[str, FileRow] = {}
        try:
            for suffix in self.missing(task):
                path, key = self.folder / f"{task.name}{suffix}", task.files[suffix]
                image.write(_stamped(frame, key), path, self._display, self._output)
                rows[suffix] = row_of(path, key)
            sync_folder(self.folder)
            self._journal.add(Row(task.name, rows, round(seconds, 3)))
        except OutputError as e:
            self._ballast.free()  # so that there is room to say why the run ended
            self.put_failed(task, str(e))
            raise
        for path in self._partial_paths(task):
            if path.exists() and not _is_finished(path):
                path.unlink()
        self.drop_preview(task)

    def put_failed(self, task: FrameTask, error: str) -> None:
        """Record that a frame could not be made. Where not even that can be written, it is just missing."""
        with suppress(OutputError):
            self._journal.add(Row(task.name, {}, 0.0, error, dict(task.files)))

    def put_partial(self, task: FrameTask, frame: Frame) -> None:
        """Write a frame that is not done to files of its own, which :meth:`has` never takes for the frame."""
        for path in self._partial_paths(task):
            if _is_finished(path):  # of a lighting called "partial"
                continue
            image.write(frame, path, self._display, self._output)
            self.partial = (*self.partial, path)

    def rows(self) -> Iterator[Row]:
        """The manifest: every frame that any process has written here, as often as it was written."""
        return self._journal.rows()

    def claim(self, name: str) -> AbstractContextManager[bool]:
        """As :meth:`mirelight.store.claims.Claims.claim` describes it."""
        return self._claims.claim(name, self._run)

    def _partial_paths(self, task: FrameTask) -> list[Path]:
        return [self.folder / f"{task.name}.partial{suffix}" for suffix in task.files]

    def preview_path(self, task: FrameTask) -> Path:
        """Where a frame is shown while it is not finished; never taken for the frame."""
        return self.folder / f"{task.name}.preview.png"

    def put_preview(self, task: FrameTask, frame: Frame) -> None:
        """Show a frame that is not finished, in place of what was shown of it before."""
        if _is_finished(self.preview_path(task)):  # of a lighting called "preview"
            return
        image.write(_stamped(frame, ""), self.preview_path(task), self._display, self._output)

    def drop_preview(self, task: FrameTask) -> None:
        """Show it no more: the frame is there."""
        if _is_finished(self.preview_path(task)):
            return
        with suppress(OSError):
            self.preview_path(task).unlink(missing_ok=True)

    # --- what frames are made from ---

    def keep_composite(self, key: str, splats: SplatLayer) -> None:
        """Keep a composite under its key, where frames are to be mixed from layers and it is not there.

        Raises:
            OutputError: layers alone are wanted, and it cannot be written.
        """
        if self._output.store != "frames" and not self._light.is_whole(key):
            self.artefacts.put(key, splats, composite_of(splats.camera, splats.profile, splats.linear))

    def has_layers(self, wanted: Collection[str]) -> bool:
        """Whether all of these composites and traced buffers are there."""
        return self._light.there() >= set(wanted)

    def add_row(self, name: str, seconds: float) -> None:
        """Note that a camera's layers are there."""
        sync_folder(self._aside["light"])
        self._journal.add(Row(name, {}, round(seconds, 3)))

    def tidy(self, used: Collection[str]) -> None:
        """See :meth:`mirelight.store.artefacts.Artefacts.tidy`; what other jobs keep instead of frames is in use."""
        others = (run for run in self.planned.runs() if run.job != self._job)
        wanted = {key for run in others for keys in run.layers.values() for key in keys}
        self._light.tidy({*used, *wanted, *self._named()}, math.inf)

    def _named(self) -> set[str]:
        """What the index of a data set names."""
        try:
            return set(re.findall("[0-9a-f]{16,}", read_file(self.folder / ASIDE / "dataset.json").decode()))
        except (OSError, ValueError):
            return set()


def write(frame: Frame, path: str | Path, job: Job | None = None) -> None:
    """Write a frame as OpenEXR or PNG, told apart by the suffix: the very file that `mirelight render` writes.

    Args:
        frame: from `mirelight.relight`.
        path: a name ending in .exr or .png in an existing folder; appears whole or not at all.
        job: whose display and output settings are followed; None: the defaults.

    Raises:
        OutputError: another suffix, or the file cannot be written.
    """
    if not isinstance(frame, Frame):
        raise TypeError(f"write() takes a frame as mirelight.relight gives it, not {type(frame).__name__}")
    if job is None:
        image.write(frame, path, DisplaySettings(), OutputSettings())
        return
    made_by = frame.made_by
    if made_by is not None and made_by.fingerprint:
        lighting = next((x for x in job.lightings if x.name == made_by.lighting), None)
        suffix = Path(path).suffix.lower()
        frame = _stamped(frame, keys.Keys(job).file(made_by.fingerprint, frame.camera, lighting, suffix))
    image.write(frame, path, job.display, job.output)


def _stamped(frame: Frame, key: str) -> Frame:
    """The frame with the key of the file that it goes to."""
    return frame if frame.made_by is None else replace(frame, made_by=replace(frame.made_by, fingerprint=key))


def _is_finished(path: Path) -> bool:
    """Whether a file is a frame that is done: those that are shown before carry no key."""
    return image.read_fingerprint(path) is not None
