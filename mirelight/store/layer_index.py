"""The index of kept layers, `.mirelight/dataset.json`: which files hold what, so that any lighting can be mixed.

A few numbers for each camera, unit light and lighting, and the keys by which composites and traced light are kept.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from mirelight.base.errors import InputError
from mirelight.io import records
from mirelight.io.atomic import write_file
from mirelight.io.records import Key
from mirelight.io.safety import read_file
from mirelight.model import Camera, DisplaySettings, Light, Profile, RelightSettings

FILE = Path(".mirelight") / "dataset.json"
LIGHT, SCENE = Path(".mirelight") / "light", Path(".mirelight") / "scene"
VERSION = 3


@dataclass(frozen=True, slots=True)
class Around:
    """Light from far away, kept as an array."""

    key: Key  # of a map (h, w, 3) of linear radiance, or of suns (n, 7): the way they shine, lux, degrees across
    rotation: float = 0.0  # degrees, of a map
    intensity: float = 1.0  # multiplies it
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)  # linear, multiplies it, too: of what is traced as it is
    ground: tuple[float, float, float] | None = None  # albedo of the ground that a sky model counts on; None: no model


@dataclass(frozen=True, slots=True)
class UnitLight:
    """Light that can be dimmed and coloured on its own."""

    name: str  # unique; that of its layer in the first lighting that has it
    kind: str  # lamp, sun, area, group, environment, sky, or whole: a lighting that was traced as it is
    lights: tuple[Light, ...]  # white, of intensity 1; those of a group or a whole as they shine; none of skies
    group: int  # index of the set that it was traced in; of each arrangement the sets are its own
    layer: str  # its layer there; "": all of them
    around: tuple[Around, ...] = ()  # of environments and skies


@dataclass(frozen=True, slots=True)
class Weighted:
    """A lighting as weights over unit lights."""

    name: str
    groups: tuple[int, ...]  # the sets that it is made of, at least one
    units: tuple[int, ...]
    weights: tuple[tuple[float, float, float], ...]  # linear: colour times intensity
    relight: RelightSettings | None = None  # how it meets the splats; None: as the job says
    arrangement: int = 0  # index of that which stands in the capture then


@dataclass(frozen=True, slots=True)
class KeptSight:
    """What a camera sees of an arrangement besides its light, each a key."""

    glow: Key  # of what surfaces send out of themselves; there is no such file where nothing glows
    front: Key | None = None  # of the splats in front of inserted objects
    objects: Key | None = None  # of which of them is seen where; None: there are none


@dataclass(frozen=True, slots=True)
class KeptView:
    """A camera, and where its pictures are kept."""

    camera: Camera
    light_size: tuple[int, int]  # rows and columns of the light's pictures
    composite: Key | None  # key; None: the job has no splats
    groups: tuple[Key, ...]  # keys of the traced sets
    captured_glow: Key  # key of what surfaces send out in the captured light, which knows no inserted objects
    sights: tuple[KeptSight, ...]  # one for each arrangement
    mirrored: tuple[Key | None, ...] = ()  # keys of what the proxy's materials mirror of each set; (): of none
    mirrored_glow: Key | None = None  # key of what they mirror of what glows
    bare: tuple[Key | None, ...] = ()  # keys of the sets without objects, where their shadow is wanted


@dataclass(frozen=True, slots=True)
class KeptObject:
    """An object that is put into the capture."""

    name: str  # unique in its arrangement
    category: str


@dataclass(frozen=True, slots=True)
class Arrangement:
    """Objects, each in its place."""

    objects: tuple[KeptObject, ...] = ()
    boxes: Key | None = None  # of an array (n, 4, 4): world from the cube of side 1 about 0, round each of them
    first: int = 0  # index of a set that shows all of the scene with them


@dataclass(frozen=True, slots=True, kw_only=True)
class Index:
    """All that mixing needs to know."""

    job: str  # the job file's name
    views: tuple[KeptView, ...]
    units: tuple[UnitLight, ...]
    lightings: tuple[Weighted, ...]
    captured: Weighted | None  # where the relight mode compares with it
    captured_level: Key | None  # of an array
    relight: RelightSettings
    display: DisplaySettings
    denoised: bool  # the job's own frames are, after mixing; the layers are as traced
    profile: Profile
    linear: bool  # composites hold linear light
    arrangements: tuple[Arrangement, ...] = (Arrangement(),)  # ways in which objects stand in the capture
    painted: bool = False  # factors are taken from around where a mask is painted, which no layer holds


def write(index: Index, folder: Path) -> None:
    """Write the index, unless that very one is there.

    Raises:
        OutputError: it cannot be written.
    """
    text = json.dumps({"version": VERSION, **records.packed(index)}, allow_nan=False, separators=(",", ":")) + "\n"
    path = folder / FILE
    try:
        if read_file(path) == text.encode():
            return
    except (OSError, ValueError):
        pass
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, text)


def read(folder: Path) -> Index:
    """The index of an output folder.

    Raises:
        InputError: there is none, or it is not one of this version.
    """
    path = folder / FILE
    remedy = 'render the job with output.store = "layers" or "both"'
    try:
        data = json.loads(read_file(path), parse_constant=_refused)
    except OSError:
        raise InputError(folder, "no kept layers", remedy) from None
    except (ValueError, RecursionError):
        raise InputError(path, "not an index of layers", remedy) from None
    try:
        if data["version"] != VERSION:
            raise InputError(path, f"version {data['version']}", f"this mirelight reads version {VERSION}; {remedy}")
        index = records.made(Index, data)
        _require_places(index)
        return index
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError):
        raise InputError(path, "a damaged index", remedy) from None


def _refused(constant: str) -> None:
    raise ValueError(constant)


def _require_places(index: Index) -> None:
    """Raises ValueError: something names what is not there."""
    counts = {len(view.groups) for view in index.views}
    if len(counts) != 1 or any(len(view.sights) != len(index.arrangements) for view in index.views):
        raise ValueError("views of different sets")
    groups, units = range(counts.pop()), range(len(index.units))
    for view in index.views:
        (rows, columns), camera = view.light_size, view.camera
        if any(len(x) not in (0, len(view.groups)) for x in (view.mirrored, view.bare)):
            raise ValueError("views of different sets")
        if not (0 < rows <= 4 * camera.height and 0 < columns <= 4 * camera.width):
            raise ValueError("light of another size")
    for one in (*index.lightings, *(() if index.captured is None else (index.captured,))):
        known = all(i in groups for i in one.groups) and all(i in units for i in one.units)
        known = known and one.arrangement in range(len(index.arrangements))
        if not one.groups or not known or len(one.units) != len(one.weights):
            raise ValueError("a lighting of unknown lights")
    if any(
        x not in groups for x in (*(u.group for u in index.units), *(a.first for a in index.arrangements if groups))
    ):
        raise ValueError("a light of an unknown set")
