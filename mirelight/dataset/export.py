"""Data sets on disk: the frames of kept layers in a layout that loaders read.

One exposure for all frames, recorded; the rig of lights in the data set's world; a page that says what there is. What
is there already is not made again, so an export that was interrupted goes on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np

from mirelight import relighting
from mirelight.base import colour
from mirelight.base.conventions import Matrix
from mirelight.base.errors import InputError
from mirelight.dataset import card, contact, croissant, rig
from mirelight.dataset.draws import Split, split
from mirelight.dataset.layouts import LAYOUTS, WRITERS, Files, Geometry, Labelled, Picture, Pixels, Shared, world_of
from mirelight.dataset.layouts.pictures import PARTS, Part, file_names
from mirelight.dataset.view import DataSet
from mirelight.io.cameras.colmap_write import Points
from mirelight.model import DatasetSettings, HeldOut, Job, Layout, PointLight, SpotLight, digest
from mirelight.pipeline import requirements
from mirelight.store.layer_index import Index, KeptView, Weighted

__all__ = ["LAYOUTS", "Progress", "Silent", "check", "export"]

_NO_LAMP = "no lighting of one point or spot light", "sweep with one_at_a_time = true, or leave the layout olat out"
_BY_FRAME: tuple[Layout, ...] = ("coco", "hub")  # layouts whose frames need not be of one scene
_MOST_POINTS = 100_000
_MARGIN = 0.1  # that the range of depths is wider, as a share


class Progress(Protocol):
    """Hears how far an export is. What it raises ends it in order."""

    def started(self, count: int) -> None:
        """Before the first of so many frames."""

    def finished(self, name: str, skipped: bool) -> None:
        """A frame is there: made now, or found."""

    def note(self, line: str) -> None:
        """Told a line for the person who waits."""


class Silent:
    """A `Progress` that says nothing."""

    def started(self, count: int) -> None: ...

    def finished(self, name: str, skipped: bool) -> None: ...

    def note(self, line: str) -> None: ...


def export(
    data: DataSet,
    out: Path,
    layout: Layout,
    settings: DatasetSettings | None = None,
    lightings: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> int:
    """Write the frames of a data set; says how many.

    Args:
        data: from `mirelight.dataset.open`.
        out: a folder; made where it is missing. What is there of the same content stays.
        layout: see docs/guides/datasets.md. olat: lightings of one lamp alone, its place in every frame.
        settings: its `layouts` have no part in it.
        lightings: names; None: all.
        progress: hears of every frame.

    Raises:
        InputError: a camera or lighting that the layout cannot hold, before anything is written; an unknown lighting.
        OutputError: a file cannot be written.
    """
    settings, heard = settings or DatasetSettings(), progress or Silent()
    names = data.lightings if lightings is None else tuple(dict.fromkeys(lightings))
    for name in names:
        if name not in data.lightings:
            raise InputError(data.folder, f"no lighting {name!r}", f"there are: {', '.join(data.lightings[:10])}")
    seen = _Seen.of(data)
    world = _world(data, seen) if settings.normalize else world_of()
    lamps = {name: lamp for name in names if (lamp := rig.only_lamp(data, name, world)) is not None}
    if layout == "olat":
        names = tuple(lamps)
        if not lamps:
            raise InputError(data.folder, *_NO_LAMP)
    chosen = _Chosen.of(data, names, settings)
    files_of = chosen.lightings
    shared = Shared(
        name=file_names([Path(data.index.job).stem], "set")[Path(data.index.job).stem],
        source=data.folder,
        world=world,
        points=seen.points,
        surroundings={files_of[x]: one for x in names if (one := data.surroundings(x)) is not None},
        lamps={files_of[x]: lamp for x, lamp in lamps.items() if x in files_of},
        near_far=seen.near_far(world),
        training=files_of[chosen.training],
        exposure=data.index.display.exposure,
        hdr=settings.hdr,
        objects=tuple(dict.fromkeys(x.name for one in data.index.arrangements for x in one.objects)),
    )
    writer = WRITERS[layout]
    _check_arrangements(data.folder, layout, len(data.index.arrangements))
    writer.check(data.cameras, shared)
    heard.started(len(names) * len(data.cameras))
    for line in chosen.advice(settings):
        heard.note(line)
    if data.index.denoised:
        heard.note(
            "frames of a data set are mixed from light as traced, not denoised: more render.spp makes them cleaner"
        )
    with Files(out, heard.finished) as files:
        frames = _Frames(data, chosen, world)
        writer.write(files, frames, shared)
        contact.write(files, [x.name for x in data.cameras], names, frames.one)
        files.json("lights.json", rig.described(data, names, files_of, shared, files.names()))
        files.json("splits.json", chosen.described(settings))
        about = f"{len(files.frames)} frames of {shared.name}, relit with mirelight"
        croissant.write(files, shared.name, about, settings.license)
        card.write(files, data, layout, settings, chosen.facts(), shared)
        files.finish()
    return len(names) * len(data.cameras)


def check(job: Job) -> None:
    """Refuse what the job's data sets could not hold before anything is rendered.

    Raises:
        InputError: names the camera, or says that no lighting fits.
    """
    objects = tuple(x.name for x in job.objects)
    for layout in job.dataset.layouts:
        _check_arrangements(job.source, layout, len(requirements.arrangements(job)))
        WRITERS[layout].check(job.cameras, Shared(source=job.source, objects=objects))
        alone = [x.lights[0] for x in job.lightings if len(x.lights) == 1 and x.environment is None and x.sky is None]
        if layout == "olat" and not any(isinstance(light, PointLight | SpotLight) for light in alone):
            raise InputError(job.source, *_NO_LAMP, field="dataset.layouts")


def _check_arrangements(source: Path, layout: Layout, count: int) -> None:
    """Raises InputError: objects stand in more than one way, and the layout has one depth a camera for all frames."""
    if count > 1 and layout not in _BY_FRAME:
        found = f"objects that stand elsewhere in other frames, and the layout {layout}, which has one scene"
        raise InputError(source, found, f"use the layouts {' or '.join(_BY_FRAME)}", field="dataset.layouts")


def _labelled(data: DataSet, lighting: int) -> tuple[Labelled, ...]:
    """The objects as they stand under a lighting."""
    here = zip(data.objects(lighting), data.boxes(lighting), strict=True)
    return tuple(Labelled(x.name, x.category, box) for x, box in here)


# --- what is chosen --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Chosen:
    """The frames of an export, by name and part."""

    cameras: dict[str, str]  # file name of each camera
    lightings: dict[str, str]  # file name of each lighting that is written
    places: dict[str, int]  # index of those in the data set
    parts: dict[int, Part]  # by index of a frame in the data set
    count: int  # of all lightings in the data set

    @staticmethod
    def of(data: DataSet, names: Sequence[str], settings: DatasetSettings) -> _Chosen:
        held: Split = split(data, settings.split, settings.held_out, settings.seed)
        parts: dict[int, Part] = {i: part for part in PARTS for i in getattr(held, part)}
        cameras = file_names([x.name for x in data.cameras], "camera")
        places = {name: data.lightings.index(name) for name in names}
        return _Chosen(cameras, file_names(names, "lighting"), places, parts, len(data.lightings))

    def part(self, camera: int, lighting: str) -> Part:
        """The part of the split that a frame is in."""
        return self.parts[camera * self.count + self.places[lighting]]

    @property
    def training(self) -> str:
        """The first lighting that is not held out; the first where all are."""
        seen = [x for x in self.lightings if self.part(0, x) in ("seen", "novel_view")]
        return next(iter(seen), next(iter(self.lightings)))

    def frames(self) -> dict[Part, list[str]]:
        """By part the frames, "LIGHTING/CAMERA", by file name."""
        out: dict[Part, list[str]] = {part: [] for part in PARTS}
        for i, view in enumerate(self.cameras.values()):
            for name, lighting in self.lightings.items():
                out[self.part(i, name)].append(f"{lighting}/{view}")
        return out

    def described(self, settings: DatasetSettings) -> dict[str, object]:
        """The parts of a data set, as splits.json has them."""
        return {"by": settings.split, "held_out": settings.held_out, "seed": settings.seed, "parts": self.frames()}

    def facts(self) -> card.Facts:
        """For the data set's page."""
        counts = {part: len(frames) for part, frames in self.frames().items()}
        return card.Facts(len(self.cameras), tuple(self.lightings.values()), self.lightings[self.training], counts)

    def advice(self, settings: DatasetSettings) -> Iterator[str]:
        """What a user would want to know before training."""
        counts = {part: len(frames) for part, frames in self.frames().items()}
        if settings.held_out and not counts["seen"]:
            yield "no frame is left to train on: lower --held-out, or choose another --seed"
        elif settings.held_out and counts["seen"] == sum(counts.values()) and self._could_split(settings.split):
            yield "no frame is held out (names are chosen by a hash): raise --held-out, or choose another --seed"

    def _could_split(self, by: HeldOut) -> bool:
        """Whether there are names to hold one out of; of a single one nobody expects that."""
        return (by != "lighting" and len(self.cameras) > 1) or (by != "camera" and self.count > 1)


class _Frames:
    """The frames, each with its names and keys; nothing is mixed before its pixels are asked for."""

    def __init__(self, data: DataSet, chosen: _Chosen, world: Matrix) -> None:
        self._data, self._chosen, self._world, self._read = data, chosen, world, _Geometry(data)
        self._objects: dict[int, tuple[Labelled, ...]] = {}  # by arrangement

    def __iter__(self) -> Iterator[Picture]:
        """Camera by camera: a camera's layers are read once."""
        return (self.one(i, name) for i in range(len(self._data.cameras)) for name in self._chosen.lightings)

    def _labelled(self, arrangement: int, lighting: int) -> tuple[Labelled, ...]:
        if arrangement not in self._objects:
            self._objects[arrangement] = _labelled(self._data, lighting)
        return self._objects[arrangement]

    def one(self, camera: int, lighting: str) -> Picture:
        """The frame of a camera, by its index, and a lighting."""
        data, chosen, seen = self._data, self._chosen, self._data.cameras[camera]
        view, place = data.views[camera], chosen.places[lighting]
        arrangement = data.index.lightings[place].arrangement
        return Picture(
            camera=seen,
            view=chosen.cameras[seen.name],
            lighting=chosen.lightings[lighting],
            number=data.numbers[camera],
            part=chosen.part(camera, lighting),
            key=picture_key(data.index, view, place, self._world),
            view_key=view_key(data.index, view, place, self._world),
            arrangement=arrangement if len(data.index.arrangements) > 1 else None,
            objects=self._labelled(arrangement, place),
            pixels=Pixels(
                partial(data.frame, camera, place),
                partial(self._read, camera, place),
                data.index.display,
                partial(data.shares, camera, place) if data.objects(place) else None,
                partial(data.shadow, camera, place) if view.bare else None,
            ),
        )


def view_key(index: Index, view: KeptView, place: int, world: Matrix) -> str:
    """The key of what a camera sees with objects as under the lighting at a place in the index, whatever lights it."""
    arrangement = index.lightings[place].arrangement
    sight = view.sights[arrangement]
    first = index.arrangements[arrangement].first
    objects = (sight.front, sight.objects) if sight.objects is not None else ()
    return digest("view 1", view.composite, view.groups[first], view.camera, world, *objects)


def picture_key(index: Index, view: KeptView, place: int, world: Matrix) -> str:
    """The key of the frame of a camera under the lighting at a place in the index: all that decides its pixels."""

    def lit(of: Weighted | None) -> object:
        if of is None:
            return None
        units = [index.units[i] for i in of.units]
        beside = [x for x in (view.mirrored, view.bare) if x]
        return [
            (view.groups[u.group], u.layer, list(w), *(x[u.group] for x in beside))
            for u, w in zip(units, of.weights, strict=True)
        ]

    own = index.lightings[place]
    settings = own.relight or index.relight
    relit = {name: getattr(settings, name) for name in sorted(relighting.reads(settings))}
    compared = relighting.mode_of(settings).needs_captured
    captured = (lit(index.captured), index.captured_level) if compared else None
    glow = view.sights[own.arrangement].glow
    glows = (glow,) if view.captured_glow == glow else (glow, view.captured_glow)
    made_from = lit(own), captured, relit, index.display, index.linear, index.profile
    return digest("frame 2", view_key(index, view, place, world), *glows, *made_from)


class _Geometry:
    """Reads what a camera sees; that of the last one asked for is kept. Where light was traced at fewer pixels than
    frames have, a pixel has the geometry of the one that it lies in."""

    def __init__(self, data: DataSet) -> None:
        self._data = data
        self._last: tuple[tuple[int, int], Geometry] | None = None

    def __call__(self, camera: int, lighting: int) -> Geometry:
        known = camera, self._data.index.lightings[lighting].arrangement
        if self._last is None or self._last[0] != known:
            seen, size = self._data.geometry(camera, lighting), self._data.cameras[camera]
            rows, columns = (
                ((np.arange(count) + 0.5) * have / count).astype(np.intp)
                for count, have in zip((size.height, size.width), seen.depth.shape, strict=True)
            )
            planes = (plane[rows[:, None], columns] for plane in (seen.depth, seen.coverage, seen.normal, seen.albedo))
            found = Geometry(**dict(zip(("depth", "coverage", "normal", "albedo"), planes, strict=True)))
            self._last = known, found
        return self._last[1]


# --- the world -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """What all cameras see of the proxy, in mirelight's world."""

    low: Matrix  # (3,) corner of the box around it; inf where nothing is seen
    high: Matrix  # (3,)
    depths: tuple[float, float]  # the least and the largest; inf and 0 where nothing is seen
    points: Points | None  # evenly over the pictures, with the proxy's albedo

    @staticmethod
    def of(data: DataSet) -> _Seen:
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        near, far = np.inf, 0.0
        positions: list[np.ndarray] = []
        colors: list[np.ndarray] = []
        share = max(_MOST_POINTS // len(data.cameras), 1)
        for i in range(len(data.cameras)):
            geometry = data.geometry(i)
            seen = geometry.coverage > 0
            if not seen.any():
                continue
            where = geometry.position[seen]
            low, high = np.minimum(low, where.min(axis=0)), np.maximum(high, where.max(axis=0))
            depth = geometry.depth[seen]
            near, far = min(near, float(depth.min())), max(far, float(depth.max()))
            sure = np.flatnonzero(geometry.coverage.ravel() > 0.999)
            some = sure[:: max(1, -(-len(sure) // share))]
            positions.append(geometry.position.reshape(-1, 3)[some].astype(np.float64))
            colors.append(colour.encode(geometry.albedo.reshape(-1, 3)[some], "srgb"))
        points = None
        if sum(len(x) for x in positions):
            rgb = np.rint(255 * np.clip(np.concatenate(colors), 0, 1)).astype(np.uint8)
            points = Points(np.concatenate(positions)[:_MOST_POINTS], rgb[:_MOST_POINTS])
        return _Seen(low, high, (near, far), points)

    def near_far(self, world: Matrix) -> tuple[float, float] | None:
        """The range of depths in a data set's world, with a margin."""
        near, far = self.depths
        scale = float(np.cbrt(np.linalg.det(world[:3, :3])))
        return (near * scale * (1 - _MARGIN), far * scale * (1 + _MARGIN)) if far > 0 else None


def _world(data: DataSet, seen: _Seen) -> Matrix:
    if not np.isfinite(seen.low).all():
        raise InputError(data.folder, "no camera sees the proxy", "leave normalize out")
    return world_of((seen.low + seen.high) / 2, 2 / max(float((seen.high - seen.low).max()), 1e-9))
