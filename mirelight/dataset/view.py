"""A folder of kept layers as a data set: any lighting of its unit lights, mixed when it is read.

Nothing heavy is loaded: neither Mitsuba nor Dr.Jit, nor torch. A data set can be sent to other processes (it opens the
folder again there) and read by forked ones.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirelight import relighting
from mirelight.base.errors import InputError
from mirelight.dataset.far_light import FarLight
from mirelight.dataset.layers import REMEDY, Layers
from mirelight.dataset.planes import ReadyView, surface_of
from mirelight.model import (
    F32,
    F64,
    Camera,
    LightingBuffer,
    SplatLayer,
)
from mirelight.pipeline.codecs import matte_of
from mirelight.relighting.surroundings import Sun, Surroundings
from mirelight.store import layer_index as indexing
from mirelight.store.artefacts import Artefacts
from mirelight.store.layer_index import Around, Index, KeptObject, KeptView, UnitLight

_MEMORY = 2**30  # bytes of layers that a process keeps


class Sample(NamedTuple):
    """One mixed frame. A named tuple of arrays and numbers, which torch's DataLoader makes batches of."""

    rgba: F32  # (H, W, 4) linear Rec.709, premultiplied
    weights: F32  # (L, 3) of the unit lights, linear: colour times intensity
    camera: int  # index
    lighting: int  # index; -1: none of the job's


class DataSet:
    """The frames of a job, mixed from its layers: every camera under every lighting, and under any other.

    `dataset[i]` is camera `i // len(lightings)` under lighting `i % len(lightings)`; cameras whose layers are not there
    yet are left out when it is opened. Nothing is denoised: of a job with `render.denoise` frames are mixed from its
    light as it was traced.

    Args:
        folder: the output folder of a job whose `output.store` is "layers" or "both".
        memory: bytes of layers kept in this process; more cameras are read again when their turn comes.

    Raises:
        InputError: no layers there, or of a job whose light is found for splats.
    """

    def __init__(self, folder: str | Path, memory: int = _MEMORY) -> None:
        self.folder, self._memory = Path(folder), memory
        self._index: Index = indexing.read(self.folder)
        ways = [self._index.relight, *(x.relight for x in self._index.lightings if x.relight is not None)]
        if any(relighting.per_splat(x) for x in ways):
            found = "frames whose light is found for splats"
            raise InputError(self.folder, found, 'render with relight.per = "pixel"')
        if self._index.painted:
            raise InputError(self.folder, "frames with a painted mask", "render without relight.mask")
        self._kept = Artefacts(self.folder / indexing.LIGHT)
        self._scene = Artefacts(self.folder / indexing.SCENE)
        self._far = FarLight(self.folder, self._index, self._scene, REMEDY)
        self._layers = Layers(self.folder, self._index, self._kept, self._scene, self._far)
        there = self._kept.there()
        placed = [
            (i, v)
            for i, v in enumerate(self._index.views)
            if there >= {*v.groups, *(x for x in (v.composite, *v.mirrored, *v.bare, *_veils(v)) if x is not None)}
        ]
        self._views = tuple(v for _, v in placed)
        self.numbers = tuple(i for i, _ in placed)  # of the cameras in the job
        if not self._views:
            raise InputError(self.folder, "no camera whose layers are all there", "render the job to its end")
        self._ready: OrderedDict[tuple[int, int], ReadyView] = OrderedDict()  # by camera and arrangement

    def __reduce__(self) -> tuple[Any, ...]:
        return DataSet, (self.folder, self._memory)

    def __repr__(self) -> str:
        lights = f"{len(self.lights)} unit lights"
        return f"DataSet({self.folder}: {len(self.cameras)} cameras, {lights}, {len(self.lightings)} lightings)"

    # --- what there is ---

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """Those whose layers are there."""
        return tuple(v.camera for v in self._views)

    @property
    def views(self) -> tuple[KeptView, ...]:
        """The cameras with the keys of what is kept of them."""
        return self._views

    @property
    def lights(self) -> tuple[UnitLight, ...]:
        """The unit lights, L of them, in the order of weights."""
        return self._index.units

    @property
    def lightings(self) -> tuple[str, ...]:
        """Names of the job's lightings."""
        return tuple(x.name for x in self._index.lightings)

    @property
    def index(self) -> Index:
        """All that the job says of them."""
        return self._index

    def weights(self, lighting: int | str) -> F32:
        """(L, 3) what a lighting takes of the unit lights."""
        return self._layers.weights(self._index.lightings[self._at(lighting, self.lightings, "lighting")])

    @cached_property
    def strongest(self) -> F32:
        """(L, 3) the most that any of the job's lightings takes of each unit light; 0 where none has it."""
        every = [self._layers.weights(x) for x in self._index.lightings]
        return np.asarray(np.max(every, axis=0) if every else np.zeros((len(self.lights), 3)), dtype=np.float32)

    def layers(self, camera: int | str) -> F32:
        """(L, h, w, 3) linear radiance of each unit light on the proxy, premultiplied by its coverage."""
        place = self._at(camera, [x.name for x in self.cameras], "camera")
        out = np.zeros((len(self.lights), *self._views[place].light_size, 3), np.float32)
        for arrangement in range(len(self._index.arrangements)):
            view = self._view(place, arrangement)
            out[view.lights] = np.moveaxis(view.planes.units, 0, -1).reshape(-1, *view.size, 3)
        return out

    def geometry(self, camera: int | str, lighting: int | str = 0) -> LightingBuffer:
        """The proxy, and objects as they stand under a lighting, as that camera sees them: coverage, depth, position,
        normals, albedo; without light."""
        view = self._views[self._at(camera, [x.name for x in self.cameras], "camera")]
        group = self._index.arrangements[self._arrangement(lighting)].first
        return surface_of(self._layers.buffer(view.groups[group], self._layers.light_camera(view)))

    def environment(self, lighting: int | str, rows: int | None = None) -> F32 | None:
        """What a lighting sends from far away: environment, sky and suns as one equirectangular map.

        Args:
            lighting: index or name.
            rows: of the map; None: as many as are kept, at most 1024.

        Returns:
            (rows, 2 rows, 3) linear radiance, row 0 is +Y, `mirelight.base.conventions` says which way the columns
            look; None where there is no such light.
        """
        found = self.surroundings(lighting)
        return None if found is None else found.picture(rows)

    def surroundings(self, lighting: int | str) -> Surroundings | None:
        """The maps and suns of a lighting, by index or name; None where it has none.

        Raises:
            InputError: a map was not kept.
        """
        return self._far.of(self._index.lightings[self._at(lighting, self.lightings, "lighting")])

    def background(self, camera: int, lighting: int, alpha: F32) -> F32 | None:
        """(H, W, 3) linear light behind a frame of that alpha (H, W), as its job shows it; None: a plain colour."""
        return self._far.behind(self._views[camera], self._index.lightings[lighting], alpha)

    def suns(self, around: Around) -> tuple[Sun, ...] | None:
        """The suns that light from far away was kept as; None where it is a map. Raises InputError."""
        return self._far.suns(around)

    def composite(self, camera: int | str) -> SplatLayer | None:
        """The splats as that camera sees them; None where the job has none."""
        view = self._views[self._at(camera, [x.name for x in self.cameras], "camera")]
        return self._layers.splats(view, view.composite)

    # --- inserted objects ---

    def objects(self, lighting: int | str = 0) -> tuple[KeptObject, ...]:
        """Those that stand in the capture under a lighting, n of them."""
        return self._index.arrangements[self._arrangement(lighting)].objects

    def boxes(self, lighting: int | str = 0) -> F64:
        """(n, 4, 4) round each object the least box along its own axes: world from the cube of side 1 about 0."""
        key = self._index.arrangements[self._arrangement(lighting)].boxes
        return np.zeros((0, 4, 4)) if key is None else self._far.array(key).astype(np.float64)

    def shares(self, camera: int | str, lighting: int | str = 0) -> F32:
        """(n, H, W) how much of each pixel an object is seen to cover: not what splats in front of it veil."""
        view = self._views[self._at(camera, [x.name for x in self.cameras], "camera")]
        objects, sight = self.objects(lighting), view.sights[self._arrangement(lighting)]
        out = np.zeros((len(objects), view.camera.height, view.camera.width), np.float32)
        if sight.objects is None:
            return out
        matte = self._kept.get(sight.objects, matte_of(tuple(x.name for x in objects)))
        if matte is None or matte.index.shape[:2] != out.shape[1:] or int(matte.index.max(initial=-1)) >= len(out):
            raise InputError(self.folder, f"what {view.camera.name!r} sees of objects is damaged", REMEDY)
        front = self._layers.splats(view, sight.front)
        for k, share in enumerate(out):
            share += (matte.share * (matte.index == k)).sum(-1)
            if front is not None:
                share *= front.transmittance
        return out

    def shadow(self, camera: int | str, lighting: int | str) -> F32 | None:
        """(H, W, 3) light beside objects over that without them; None where `output.aovs` names no "shadow"."""
        one = self._index.lightings[self._at(lighting, self.lightings, "lighting")]
        place = self._at(camera, [x.name for x in self.cameras], "camera")
        return self._view(place, one.arrangement).shadow(self._layers.weights(one))

    # --- frames ---

    def __len__(self) -> int:
        return len(self._views) * len(self._index.lightings)

    def __getitem__(self, i: int) -> Sample:
        """Frame `i` of cameras times lightings."""
        if not -len(self) <= i < len(self):
            raise IndexError(f"frame {i} of {len(self)}")
        camera, lighting = divmod(i % len(self), len(self._index.lightings))
        one = self._index.lightings[lighting]
        weights = self._layers.weights(one)
        return Sample(self._view(camera, one.arrangement).frame(weights, one.relight), weights, camera, lighting)

    def __iter__(self) -> Iterator[Sample]:
        return (self[i] for i in range(len(self)))

    def frame(self, camera: int | str, lighting: int | str | ArrayLike) -> F32:
        """One frame, mixed from the kept layers.

        Args:
            camera: index or name.
            lighting: index or name of one of the job's, or weights (L, 3) or (L,) of the unit lights, 0 or more.

        Returns:
            (H, W, 4) linear Rec.709, premultiplied: `rgba` of the frame that `mirelight render` makes, to the rounding
            of float32.

        Raises:
            InputError: no such camera or lighting. ValueError: weights of another shape, or below 0.
        """
        place = self._at(camera, [x.name for x in self.cameras], "camera")
        if isinstance(lighting, int | str):
            one = self._index.lightings[self._at(lighting, self.lightings, "lighting")]
            return self._view(place, one.arrangement).frame(self._layers.weights(one), one.relight)
        weights = np.asarray(lighting, dtype=np.float32)
        weights = np.repeat(weights[:, None], 3, axis=1) if weights.ndim == 1 else weights
        if weights.shape != (len(self.lights), 3) or not (weights >= 0).all():
            names = ", ".join(x.name for x in self.lights)
            wanted = f"give {len(self.lights)} numbers or colours, 0 or more, for {names}"
            raise ValueError(f"weights of shape {np.shape(lighting)}, or one below 0; {wanted}")
        used = np.flatnonzero(weights.any(axis=1))
        for arrangement in range(len(self._index.arrangements)):
            if np.isin(used, self.lights_in(arrangement)).all():
                return self._view(place, arrangement).frame(weights)
        raise ValueError("weights of lights that shine on objects in different places")

    def lights_in(self, arrangement: int) -> NDArray[np.intp]:
        """(l,) indices of the unit lights, in order, that are known with objects in an arrangement, or with none."""
        return self._layers.lights_in(arrangement)

    # --- inside ---

    def _at(self, wanted: int | str, names: Sequence[str], kind: str) -> int:
        if isinstance(wanted, str):
            if wanted not in names:
                raise InputError(self.folder, f"no {kind} {wanted!r}", f"there are: {', '.join(names[:10])}")
            return names.index(wanted)
        return range(len(names))[wanted]

    def _arrangement(self, lighting: int | str) -> int:
        """Index of how objects stand under a lighting."""
        if not self._index.lightings:
            return 0
        return self._index.lightings[self._at(lighting, self.lightings, "lighting")].arrangement

    def _view(self, place: int, arrangement: int) -> ReadyView:
        found = self._ready.pop((place, arrangement), None)
        found = found or self._layers.ready(self._views[place], arrangement)
        self._ready[place, arrangement] = found
        while len(self._ready) > 1 and sum(x.nbytes for x in self._ready.values()) > self._memory:
            self._ready.popitem(last=False)
        return found


def _veils(view: KeptView) -> Iterator[str | None]:
    """Keys of which objects a camera sees in any arrangement, and of what is in front of them."""
    return (key for sight in view.sights for key in (sight.front, sight.objects))
