"""Everything in a folder looked at: files against the journal and their own digests, pixels, and sums of lights."""

from __future__ import annotations

import os
import struct
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirelight import relighting
from mirelight.base.errors import InputError, MirelightError
from mirelight.base.progress import CountProgress
from mirelight.batch import checks
from mirelight.batch.checks import Finding, Kind, Sums
from mirelight.batch.order import Order
from mirelight.io import image
from mirelight.io.exr import read_exr
from mirelight.io.safety import open_file
from mirelight.model import DisplaySettings, Frame, Job, Lighting, LightingBuffer
from mirelight.model.unit_lights import may_be_dark, terms
from mirelight.pipeline import mix
from mirelight.pipeline.codecs import light_of
from mirelight.pipeline.keys import Keys
from mirelight.store.arrays import read_arrays
from mirelight.store.folder import ASIDE, Folder
from mirelight.store.index import is_one_of, row_of
from mirelight.store.journal import Journal, Row, said_of
from mirelight.store.planned import PlannedFrame

SUFFIXES = (".exr", ".png")

Hear = Callable[[Finding], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verified:
    """What a look at a folder came to. What is wrong was told while it was found."""

    frames: int  # that were looked at
    findings: int
    forgotten: int  # files that were removed, for the next render to make
    recorded: int  # frames that were put into the journal
    unrecorded: int  # frames that are there and sound, and not in the journal
    in_flight: int  # frames of cameras that somebody is at: not looked at
    notes: tuple[str, ...]  # what could not be checked, or is not the job's


def verify(path: str | Path, hear: Hear, *, rebuild: bool = False, step: CountProgress | None = None) -> Verified:
    """Look at every frame of an output folder, and at the light that is kept beside them.

    Args:
        path: the folder.
        hear: is told each thing that is wrong.
        rebuild: remove damaged files, so that the next render makes them, and write frames that the journal does not
            know into it.
        step: is told how many frames of how many have been looked at.

    Raises:
        InputError: no such folder, or nothing of mirelight's in it.
        OutputError: the journal cannot be written.
    """
    look = _Look(Folder(path), hear, rebuild)
    try:
        return look.all(step or (lambda done, total: None))
    finally:
        look.journal.close()


class _Look:
    def __init__(self, folder: Folder, hear: Hear, rebuild: bool) -> None:
        self.folder, self._hear, self._rebuild = folder, hear, rebuild
        self.journal = Journal(folder.path / ASIDE / "journal")
        self._notes: list[str] = []
        self._counts: dict[str, int] = defaultdict(int)
        self._errors = {row.frame: row for rows in folder.rows for row in rows if row.error}
        self._job: Job | None = None
        self._keys: Keys | None = None

    def all(self, step: CountProgress) -> Verified:
        groups = self._groups()
        busy = {held.name for held in self.folder.held() if held.alive}
        total = sum(map(len, groups.values()))
        if not total and not self.folder.kept:
            raise InputError(self.folder.path, "no frames", "give the folder that mirelight render wrote to")
        self._job = self._loaded()
        self._keys = None if self._job is None else Keys(self._job)
        if said := said_of(self.folder.journal.bad):
            self._notes.append(said)
        done = in_flight = 0
        for name, frames in groups.items():
            if name in busy:
                in_flight += len(frames)
            else:
                self._group(frames)
            done += len(frames)
            step(done, total)
        self._kept()
        return Verified(
            frames=total - in_flight,
            findings=self._counts["findings"],
            forgotten=self._counts["forgotten"],
            recorded=self._counts["recorded"],
            unrecorded=self._counts["unrecorded"],
            in_flight=in_flight,
            notes=tuple(self._notes),
        )

    # --- what there is ---

    def _groups(self) -> dict[str, list[PlannedFrame]]:
        """Frames by camera: as they were planned, else as files say."""
        groups: dict[str, list[PlannedFrame]] = defaultdict(list)
        known: set[str] = set()
        for frame in self.folder.planned:
            groups[frame.group].append(frame)
            known.add(frame.name)
        strays = 0
        for frame in self._found():
            if frame.name not in known and not self.folder.runs:
                groups[frame.group].append(frame)
            strays += frame.name not in known
        if not self.folder.runs:
            self._notes.append("no record of what was to be made: what is missing cannot be told")
        elif strays:
            self._notes.append(f"{strays} frames are of no run that was started here; remove them where not wanted")
        return groups

    def _found(self) -> Iterator[PlannedFrame]:
        """Frames by their files alone."""
        files: dict[str, dict[str, str]] = defaultdict(dict)
        for path in sorted(self.folder.path.glob("[!.]*")):
            if path.suffix in SUFFIXES and path.is_file():
                files[path.stem][path.suffix] = image.read_fingerprint(path) or ""
        for name, keys in files.items():
            if any(keys.values()):  # what others have written has none, nor have previews and interrupted tries
                camera, _, lighting = name.rpartition(".")
                yield PlannedFrame(name, camera or name, lighting if camera else "", keys, camera or name)

    def _loaded(self) -> Job | None:
        """The job whose frames these are, where it is there and has not changed."""
        if not self.folder.runs:
            return None
        newest = self.folder.runs[-1]
        try:
            order = Order.of(newest.job, newest.settings)
            job = order.load()
            planned = {frame.name: frame.files for frame in newest.frames}
            if {task.name: task.files for task in order.plan(job).tasks} == planned:
                return job
            why = "has changed since"
        except (MirelightError, OSError) as e:
            why = f"cannot be loaded ({e})"
        self._notes.append(f"the job {why}: sums of lights are not checked")
        return None

    # --- one camera ---

    def _group(self, frames: Sequence[PlannedFrame]) -> None:
        if self.folder.layers.get(frames[0].group):
            self._layers(frames)
            return
        lightings = self._lightings(frames)
        sums = Sums(list(lightings.values()))
        first = sums.first()
        for frame in sorted(frames, key=lambda x: x.lighting not in first):
            if self._files(frame):
                self._content(frame, lightings.get(frame.lighting), sums)

    def _lightings(self, frames: Sequence[PlannedFrame]) -> dict[str, Lighting]:
        if self._job is None:
            return {}
        wanted = {frame.lighting for frame in frames}
        return {x.name: x for x in self._job.lightings if x.name in wanted}

    def _layers(self, frames: Sequence[PlannedFrame]) -> None:
        if not self.folder.has(frames[0]):
            text, remedy = self._missing(frames[0])
            self._tell("missing", frames[0].camera, f"its layers are {text}", remedy)

    def _files(self, frame: PlannedFrame) -> bool:
        """Whether all of a frame's files are there and whole."""
        index, paths = self.folder.index, {s: self._path(frame, s) for s in frame.files}
        gone = [suffix for suffix, path in paths.items() if not path.exists()]
        if len(gone) == len(paths):
            text, remedy = self._missing(frame)
            error = self._errors.get(frame.name)
            failed = error is not None and error.wanted == frame.files
            self._tell("failed" if failed else "missing", frame.name, text, remedy)
            return False
        if gone:
            there = ", ".join(s for s in paths if s not in gone)
            self._tell(
                "missing", frame.name, f"{', '.join(gone)} is missing beside {there}", "mirelight render makes it"
            )
        whole, unknown = not gone, False
        for suffix, key in frame.files.items():
            path, rows = paths[suffix], index.rows_of(frame.name + suffix, key)
            if suffix in gone:
                continue
            if self._closed(frame.name + suffix, path):
                whole = False
                continue
            found = image.read_fingerprint(path)
            sound = is_one_of(path, rows) if rows else image.is_intact(path)
            if found is None or (found == key and not sound):
                text = "its bytes are others than were written" if found else "it is cut off, or no picture of ours"
                self._bad(frame.name + suffix, text, path)
                whole = False
            elif found != key:
                self._tell("other", path.name, "made from other inputs or settings", "mirelight render makes it anew")
                whole = False
            unknown |= not rows
        if whole and unknown:
            self._record(frame)
        return whole

    def _missing(self, frame: PlannedFrame) -> tuple[str, str]:
        error = self._errors.get(frame.name)
        if error is not None and error.wanted == frame.files:
            return f"failed ({error.error.strip().rpartition(chr(10))[2]})", "mirelight render tries it again"
        return "missing", "mirelight render makes it"

    def _content(self, frame: PlannedFrame, lighting: Lighting | None, sums: Sums) -> None:
        exr, png = (self._path(frame, suffix) if suffix in frame.files else None for suffix in SUFFIXES)
        try:
            if exr is None:
                return
            file = read_exr(exr)
            broken = checks.broken_values(file)
            if broken:
                self._bad(exr.name, broken, exr, kind="values")
                return
            shown = image.frame_of(exr, file)
        except InputError as e:
            assert exr is not None
            self._bad(exr.name, e.found, exr)
            return
        if png is not None and _png_size(png) != (shown.camera.width, shown.camera.height):
            text = f"it is not the camera's {shown.camera.width} x {shown.camera.height} pixels"
            self._bad(png.name, text, png, kind="values")
        off = may_be_dark(lighting) if lighting is not None else []
        display = self._job.display if self._job is not None else DisplaySettings()
        for found in checks.picture(shown, display, off):
            self._tell("picture", frame.name, found.text, found.remedy)
        light = self._light(shown, lighting) if lighting is not None and sums.wants(lighting.name) else None
        if lighting is not None and light is not None:
            difference = sums.difference(lighting.name, light)
            if difference:
                remedy = "one of these is not the job's; remove their files and .mirelight/light, and render again"
                self._tell("sum", frame.name, difference, remedy)
            sums.add(lighting.name, light)

    def _light(self, frame: Frame, lighting: Lighting) -> LightingBuffer | None:
        """A frame's light apart by lights: as its file holds it, else put together from what is kept; None where
        neither does."""
        own = frame.lighting
        if own is not None and {term.layer for term in terms(lighting)} <= {x.name for x in own.noisy or own.layers}:
            return own
        if self._job is None or self._keys is None:
            return None
        seen = relighting.lighting_camera(frame.camera, self._job.relight)
        mixture = self._keys.mixture(lighting)
        found = {s.digest: self.folder.light.get(self._keys.light(s, seen), light_of(seen)) for s in mixture.sets}
        kept = {digest: buffer for digest, buffer in found.items() if buffer is not None}
        if len(kept) < len(found):
            return None
        return mix.mix(mixture, kept, seen, {}, mix.Wanted(layers=True, variance=True))

    def _path(self, frame: PlannedFrame, suffix: str) -> Path:
        return self.folder.path / f"{frame.name}{suffix}"

    # --- what is kept ---

    def _kept(self) -> None:
        """Light, composites and what scenes need: the bytes that were written, and finite."""
        for path in (*self.folder.light.files(), *self.folder.scene.files()):
            what = str(path.relative_to(self.folder.path))
            if self._closed(what, path):
                continue
            try:
                arrays = read_arrays(path).arrays
                broken = next((name for name, x in arrays.items() if not np.isfinite(x).all()), None)
            except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
                self._bad(what, "it is damaged", path, kind="layers")
                continue
            if broken is not None:
                self._bad(what, f"values of {broken} are not finite", path, kind="layers")

    # --- what is done about it ---

    def _closed(self, what: str, path: Path) -> bool:
        """Whether nobody lets us read a file, of which nothing is known then: it is said, and never forgotten."""
        closed = path.exists() and not os.access(path, os.R_OK)
        if closed:
            self._tell("closed", what, "there is no permission to read it", "allow reading it, and verify again")
        return closed

    def _bad(self, what: str, text: str, path: Path, kind: Kind = "damaged") -> None:
        """A file that must be made again."""
        if self._rebuild:
            with suppress(OSError):
                path.unlink()
                self._counts["forgotten"] += 1
            self._tell(kind, what, text, "forgotten: mirelight render makes it again")
        else:
            self._tell(kind, what, text, "mirelight verify --rebuild forgets it, and mirelight render makes it again")

    def _tell(self, kind: Kind, what: str, text: str, remedy: str) -> None:
        self._counts["findings"] += 1
        self._hear(Finding(kind, what, text, remedy))

    def _record(self, frame: PlannedFrame) -> None:
        """A frame whose files are sound, and which the journal does not know."""
        self._counts["unrecorded"] += 1
        if not self._rebuild:
            return
        rows = {suffix: row_of(self._path(frame, suffix), key) for suffix, key in frame.files.items()}
        (self.folder.path / ASIDE / "journal").mkdir(parents=True, exist_ok=True)
        self.journal.add(Row(frame.name, rows, 0.0))
        self._counts["recorded"] += 1


def _png_size(path: Path) -> tuple[int, int]:
    """Width and height, as the header says."""
    with open_file(path) as file:
        file.seek(16)
        width, height = struct.unpack(">II", file.read(8))
    return width, height
