"""What scripts/bench truth looks at: captures of scenes whose true pictures are known, from cameras kept apart.

True pictures come in two halves of independent noise.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scenegen import surfels, training
from scenegen.proxy import welded
from scenegen.recipe import Recipe
from scenegen.skies import Sky, sunlit, towards
from scenegen.training import Shooting, exposed
from scenegen.truth import Looks, Truth
from scipy.spatial import cKDTree

from bench.truth_store import F32, ROOT, Store
from mirelight.base import conventions
from mirelight.base.colour import srgb_encode
from mirelight.base.sh import C0
from mirelight.io import splats as splat_files
from mirelight.model import Camera, Lighting, ProxyMesh, SplatCloud
from mirelight.proxy.decimate import decimated
from mirelight.proxy.types import Soup

SHIPPED = ("courtyard", "stage")  # splats that lie in scenes/: discs until 0.25.0, which were then trained
BAKE_SPP = {
    "courtyard_walk": 64,
    "interior": 48,
    "sunroom": 48,
}  # for one splat's colour: noise, blended as shown, darkens it
PROBES = {
    "courtyard_walk": (300.0, 3.0),
    "interior": (1500.0, 6.0),
    "sunroom": (600.0, 5.0),
}  # for `candidates`; many cameras take few

F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Size:
    """How large the protocol is."""

    width: int
    height: int
    truth_spp: int  # of each of the two halves
    most: int | None = None  # new lightings of a capture; None: all

    def seen(self, camera: Camera) -> Camera:
        """The camera at this size."""
        return camera.resized(self.width, self.height)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Captured:
    """One capture: splats under a light that is known, and true pictures under it and under others."""

    name: str
    cloud: str  # name of the splats but for their colours
    whole: bool  # all proxies and ways are tried on it, not the ends alone
    camera: Camera  # not one that the splats were made from
    orbit: tuple[Camera, ...]  # those that they were made from, as they are known
    pictures: tuple[F32, ...]  # (H, W, 3) display-encoded, that those took; none: they are discs on the true surface
    sky: bool  # the splats show it, too: what they have before nothing is not scored
    splats: SplatCloud
    light: Lighting  # under which they were captured
    lightings: tuple[Lighting, ...]  # new ones
    exact: ProxyMesh  # the true surface, leaves and bars and all
    solid: ProxyMesh  # what a reconstruction has of it: no leaves, no thin bars
    simplified: Callable[[int], ProxyMesh]  # that, in about so many triangles
    truth: Mapping[str, tuple[F32, F32]]  # by lighting: two pictures (H, W, 3), linear on black


@dataclass(frozen=True, slots=True)
class _Plan:
    scene: str
    cloud: str  # module of `scenegen` whose cameras the splats are made from
    name: str
    captured: str  # lighting
    new: tuple[str, ...]
    whole: bool = False
    shooting: Shooting | None = None  # of the pictures that splats are trained on; None: discs on the true surface

    @property
    def splats(self) -> str:
        """Name of the splats but for their colours."""
        if self.shooting is None:
            return self.cloud
        how = "trained" if self.shooting.trainer == "grown" else self.shooting.trainer
        return f"{self.cloud}.{how}{'.textured' if self.shooting.textured else ''}"


_LONGER = Shooting(sky=True, iterations=1600, most=60_000)  # of what has much in it
OTHER_TRAINERS: tuple[tuple[str, training.Trainer], ...] = (("moved splats", "moved"), ("flat splats", "flat"))

_KIND = (
    _Plan("courtyard", "courtyard", "courtyard, soft sun", "day", ("evening", "night", "hard sun"), whole=True),
    _Plan("courtyard", "courtyard_walk", "courtyard, walked round", "hard sun", ("evening", "night", "day")),
    _Plan("courtyard", "courtyard_walk", "courtyard, walked round, soft sun", "day", ("evening", "night", "hard sun")),
    _Plan("stage", "stage", "stage, soft boxes", "studio", ("spots", "gels", "sunset")),
    _Plan("interior", "interior", "interior, sun", "sunny", ("overcast", "lamps", "low sun"), whole=True),
    _Plan("interior", "interior", "interior, clouds", "overcast", ("sunny", "lamps", "low sun")),
    _Plan("sunroom", "sunroom", "sunroom, sun", "sunny", ("overcast", "lamps", "low sun")),
    _Plan(
        "courtyard",
        "courtyard_walk",
        "courtyard, trained",
        "hard sun",
        ("evening", "night", "day"),
        shooting=Shooting(pose_noise=0.5),
    ),
    _Plan(
        "stage",
        "stage_walk",
        "stage, trained",
        "studio",
        ("spots", "gels", "sunset"),
        shooting=Shooting(exposure_noise=0.15),
    ),
    _Plan(
        "interior",
        "interior_walk",
        "interior, trained",
        "sunny, longer exposed",
        ("overcast", "lamps", "low sun"),
        shooting=Shooting(sky=True),
    ),
    _Plan(
        "mirrored",
        "mirrored",
        "mirrored room, trained",
        "sunny, longer exposed",
        ("overcast", "lamps", "low sun"),
        shooting=_LONGER,
    ),
    _Plan(
        "plinth", "plinth", "plinth, trained", "clear day", ("low sun", "clouds", "lamp"), shooting=Shooting(sky=True)
    ),
    *(
        _Plan(
            "plinth",
            "plinth",
            f"plinth, {called}",
            "clear day",
            ("low sun", "clouds", "lamp"),
            shooting=Shooting(sky=True, trainer=trainer),
        )
        for called, trainer in OTHER_TRAINERS
    ),
    *(
        _Plan(
            scene, scene, f"{called}, trained", "clear day", ("low sun", "clouds", "lamp"), shooting=Shooting(sky=True)
        )
        for scene, called in (("glazed", "glazed"), ("polished", "polished stone"))
    ),
    _Plan(
        "yard",
        "yard",
        "yard, trained",
        "clear day",
        ("low sun", "clouds", "lamp"),
        shooting=Shooting(iterations=1600, most=60_000),
    ),
    _Plan(
        "kitchen",
        "kitchen",
        "kitchen, trained",
        "lamp",
        ("sunny", "clouds", "other lamp"),
        shooting=_LONGER,
    ),
    _Plan(
        "painted",
        "painted",
        "painted kitchen, trained",
        "clouds",
        ("lamp", "sunny", "other lamp"),
        shooting=replace(_LONGER, textured=True),
    ),
    _Plan(
        "farm",
        "farm",
        "farm, trained",
        "clear day",
        ("low sun", "clouds", "lamp"),
        shooting=_LONGER,
    ),
    _Plan(
        "park",
        "park",
        "park, trained",
        "clear day",
        ("low sun", "clouds", "lamp"),
        shooting=_LONGER,
    ),
    _Plan(
        "hall",
        "hall",
        "hall, trained",
        "sunny",
        ("overcast", "lamps", "low sun"),
        shooting=replace(_LONGER, spp=32),
    ),
    _Plan("bust", "bust", "bust, trained", "soft boxes", ("low sun", "clouds", "lamp"), shooting=Shooting()),
    _Plan(
        "product",
        "product",
        "white table, trained",
        "soft boxes",
        ("sun", "clouds", "lamp"),
        shooting=Shooting(textured=True),
    ),
    _Plan("street", "street", "street, trained", "clouds", ("clear day", "low sun", "lanterns"), shooting=_LONGER),
    _Plan(
        "flat", "flat", "flat, trained", "sunny", ("overcast", "lamps", "low sun"), shooting=replace(_LONGER, spp=32)
    ),
)
_PLAIN = ("courtyard", "interior", "mirrored room", "kitchen", "hall")  # they have plain walls


def _from_texture(plan: _Plan) -> _Plan:
    """The same, trained from points where pictures have texture alone, as structure from motion finds them."""
    assert plan.shooting is not None
    name = plan.name.replace("trained", "from texture")
    return replace(plan, name=name, shooting=replace(plan.shooting, textured=True))


PLANS = (*_KIND, *(_from_texture(plan) for plan in _KIND if plan.name in {f"{name}, trained" for name in _PLAIN}))
NAMES = tuple(plan.name for plan in PLANS)
WHOLE = tuple(plan.name for plan in PLANS if plan.whole)
QUICK = ("courtyard, soft sun", "stage, soft boxes")  # their splats are shipped
APART = {  # eye and target between the cameras that a capture is made from
    "courtyard": ((2.05, 2.3, 5.75), (-0.3, 1.55, -1.5), 43),
    "stage": ((0.05, 1.45, 4.6), (0.02, 0.95, 0.0), 33),
    "interior": ((1.85, 1.45, 1.75), (-0.8, 0.85, -0.75), 58),
    "mirrored": ((1.3, 1.5, -1.3), (-0.5, 1.05, 1.5), 58),
    "sunroom": ((1.65, 1.5, 1.4), (-0.75, 0.75, -0.6), 58),
    "plinth": ((-1.1, 1.4, 1.6), (0.0, 0.7, 0.0), 48),
    "glazed": ((-1.1, 1.4, 1.6), (0.0, 0.7, 0.0), 48),
    "polished": ((-1.1, 1.4, 1.6), (0.0, 0.7, 0.0), 48),
    "yard": ((-1.7, 2.0, 5.2), (0.3, 0.9, -1.0), 50),
    "kitchen": ((0.95, 1.5, 0.85), (-0.03, 0.85, 0), 46),
    "painted": ((0.95, 1.5, 0.85), (-0.03, 0.85, 0), 46),
    "farm": ((12.5, 10.0, 13.0), (0.5, 1.0, 0.5), 46),
    "bust": ((0.39, 0.58, 1.06), (0.0, 0.165, 0.0), 27),
    "product": ((0.39, 0.58, 1.06), (0.0, 0.13, 0.0), 34),
    "hall": ((2.8, 1.55, 1.9), (-0.8, 1.35, -0.7), 52),
    "street": ((4.6, 1.65, 1.4), (-1.5, 1.7, -0.9), 54),
    "flat": ((-0.55, 1.5, 1.2), (-2.9, 1.0, -0.9), 60),
    "park": ((2.3, 1.3, 2.4), (0.0, 0.55, 0.2), 46),
}


def capture(name: str, size: Size, store: Store, say: Callable[[str], None]) -> Captured:
    """The capture of that name, made or read."""
    plan = next(plan for plan in PLANS if plan.name == name)
    return _Scene(plan, size, store, say).captured()


class _Scene:
    """A scene of `scenegen`, and what is made of it once."""

    def __init__(self, plan: _Plan, size: Size, store: Store, say: Callable[[str], None]) -> None:
        self._plan, self._size, self._store, self._say = plan, size, store, say
        self._name = plan.scene
        self.recipe: Recipe = importlib.import_module(f"scenegen.{plan.cloud}").recipe()
        own = {x.name: x for x in (self.recipe.captured, *self.recipe.lightings)}
        longer = replace(exposed(self.recipe.captured, 0.75), name="sunny, longer exposed")
        more = {"courtyard": _hard_sun(), "interior": longer, "mirrored": longer}.get(plan.scene)
        self._lightings = own | ({} if more is None else {more.name: more})
        eye, target, yfov = APART[plan.scene]
        self._camera = size.seen(Camera.look_at(eye, target, 960, 540, yfov=yfov, name="apart"))

    @cached_property
    def looks(self) -> Looks:
        """The true surface; building it takes seconds, so only where it is needed."""
        return self.recipe.looks()

    def captured(self) -> Captured:
        """The capture of the plan."""
        plan = self._plan
        new = plan.new[: self._size.most]
        return Captured(
            name=plan.name,
            cloud=plan.splats,
            whole=plan.whole,
            camera=self._camera,
            orbit=self.recipe.orbit if plan.shooting is None else training.known(self.recipe.orbit, plan.shooting),
            pictures=() if plan.shooting is None else tuple(self._pictures(plan.captured, plan.shooting)),
            sky=plan.shooting is not None and plan.shooting.sky,
            splats=self._splats(plan.captured),
            light=self._lightings[plan.captured],
            lightings=tuple(self._lightings[x] for x in new),
            exact=self._exact(),
            solid=self._solid(),
            simplified=self._simplified,
            truth={x: self._truth(x) for x in (plan.captured, *new)},
        )

    def _truth(self, lighting: str) -> tuple[F32, F32]:
        """Half the samples each; their noise is independent."""
        size = self._size
        name = f"{self._name}.{lighting}.{size.width}x{size.height}.{size.truth_spp}"

        def make() -> F32:
            self._say(f"true picture of {self._name} under {lighting}")
            scene = Truth(self.looks, self._lightings[lighting])
            return np.stack([scene.picture(self._camera, size.truth_spp, seed=k)[..., :3] for k in (1, 2)])

        first, second = self._store.array(name, "true pictures", make)
        return first, second

    def _exact(self) -> ProxyMesh:
        return self._store.mesh(f"{self._name}.exact", "true surfaces", lambda: _welded(self.looks), "scenes")

    def _solid(self) -> ProxyMesh:
        bare = replace(self.looks, soups=[s for s in self.looks.soups if s.solid])
        return self._store.mesh(f"{self._name}.solid", "true surfaces", lambda: _welded(bare), "scenes")

    def _simplified(self, triangles: int) -> ProxyMesh:
        def make() -> ProxyMesh:
            self._say(f"{self._name} in {triangles} triangles")
            solid = self._solid()
            return decimated(Soup(solid.vertices.astype(np.float64), solid.faces.astype(np.int64)), triangles).mesh()

        return self._store.mesh(f"{self._name}.{triangles}", "decimated proxies", make)

    def _splats(self, lighting: str) -> SplatCloud:
        cloud = self._plan.cloud
        if self._plan.shooting is not None:
            return self._trained(lighting, self._plan.shooting)
        if cloud in SHIPPED:
            shipped = splat_files.read(ROOT / "scenes" / cloud / "splats.compressed.ply")
            assert lighting == self.recipe.captured.name
            return shipped  # fitted to pictures, as a capture is

        def make() -> F32:
            self._say(f"splats of {cloud}")
            recipe = self.recipe
            truth = Truth(self.looks, recipe.captured)
            points, seen = surfels.candidates(surfels.Triangles.of(self.looks.soups), recipe, truth, *PROBES[cloud])
            kept = surfels.thin_out(points, seen.spacing, seed=2)
            form = surfels.shape(points.where(kept), seen.spacing[kept], points)
            made = surfels.cloud(form, np.zeros((len(kept), 3)))
            return np.concatenate([made.means, made.quats, made.scales], axis=1)

        rows = self._store.array(f"{cloud}.splats", "splats", make)
        n = len(rows)
        bare = SplatCloud(
            means=rows[:, :3],
            quats=rows[:, 3:7],
            scales=rows[:, 7:],
            opacities=np.full(n, 0.97, np.float32),
            sh=np.zeros((n, 1, 3), np.float32),
        )
        return self._coloured(bare, lighting)

    def _pictures(self, lighting: str, how: Shooting) -> F32:
        def make() -> F32:
            self._say(f"{len(self.recipe.orbit)} pictures of {self._plan.cloud}")
            light = self._lightings[lighting]
            return np.stack(training.shots(Truth(self.looks, light), light, self.recipe.orbit, how))

        return self._store.array(f"{self._plan.cloud}.pictures.{lighting}", "pictures", make)

    def _trained(self, lighting: str, how: Shooting) -> SplatCloud:
        def make() -> F32:
            pictures = list(self._pictures(lighting, how))
            self._say(f"splats of {self._plan.cloud}, trained on {len(pictures)} pictures")
            truth = Truth(self.looks, self._lightings[lighting])
            return training.trained(truth, pictures, self.recipe.orbit, how)

        return training.cloud_of(self._store.array(f"{self._plan.splats}.{lighting}", "trained splats", make))

    def _coloured(self, splats: SplatCloud, lighting: str) -> SplatCloud:
        """The splats with the colours that they have under a lighting, by path tracing from each."""

        def make() -> F32:
            self._say(f"colours of the splats of {self._plan.cloud} under {lighting}")
            frames = conventions.rotation_from_quaternion(splats.quats.astype(np.float64))
            order = np.argsort(-splats.scales, axis=1, kind="stable")
            frames = np.take_along_axis(frames, order[:, None, :], axis=2)
            deviations = np.take_along_axis(splats.scales, order, axis=1).astype(np.float64)
            means = splats.means.astype(np.float64)
            form = surfels.Shape(positions=means, frames=frames, deviations=deviations)
            truth, normals = Truth(self.looks, self._lightings[lighting]), frames[:, :, 2]
            # the side that cameras see: from the other one, looked at from inside of a thing, a splat is black
            points = surfels.Points(positions=means, normals=normals)
            seen = surfels.look(points, self.recipe.orbit, truth, self.recipe.pixels_per_splat)
            light = surfels.bake(form, seen.eye, truth, BAKE_SPP[self._plan.cloud], seed=3)
            known = np.isfinite(seen.spacing) & np.isfinite(light).all(axis=1)
            _, nearest = cKDTree(means[known]).query(means[~known])  # no picture shows them
            light[~known] = light[known][nearest]
            return np.asarray(srgb_encode(np.clip(light, 0, 1)), np.float32)

        colour = self._store.array(f"{self._plan.cloud}.colours.{lighting}", "splats", make)
        return replace(splats, sh=((colour - 0.5) / C0)[:, None, :].astype(np.float32))


def _hard_sun() -> Lighting:
    """The courtyard on a clear day: a small sun from another side, and a darker sky."""
    look = Sky(
        zenith=(0.14, 0.24, 0.48),
        horizon=(0.36, 0.42, 0.52),
        ground=(0.16, 0.13, 0.10),
        glow=(0.20, 0.18, 0.14),
        sun=towards(108, 44),
    )
    return sunlit("hard sun", look, (1.0, 0.94, 0.86), 2.8, 0.53)


def _welded(looks: Looks) -> ProxyMesh:
    """All true triangles, corners within a tenth of a millimetre made one."""
    vertices, faces, left = welded(np.concatenate([s.positions for s in looks.soups]))
    mirrors = [np.full(len(s.positions), looks.surfaces[s.material].is_mirror) for s in looks.soups]
    mesh = ProxyMesh(vertices=vertices.astype(np.float32), faces=faces.astype(np.int32))
    return mesh.with_mirrors(np.concatenate(mirrors)[left])
