"""From the tables of a job to the model's types: reads every file that the job names."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mirelight import model
from mirelight.base.conventions import Matrix
from mirelight.io.job import (
    camera_files,
    cameras,
    drawing,
    inserted,
    lighting,
    mixing,
    moments,
    moving,
    placing,
    sweep,
)
from mirelight.io.job.camera_file_tables import CamerasFromTable
from mirelight.io.job.camera_files import SceneCamera
from mirelight.io.job.fields import PROXY, SPLATS
from mirelight.io.job.hashing import digest, digest_of_all, file_digest
from mirelight.io.job.light_tables import CAPTURED, AsCaptured, LightUnit, Lit
from mirelight.io.job.mistakes import Mistake
from mirelight.io.job.positions import Path as Place
from mirelight.io.job.scene_tables import ObjectTable, ProxyTable, SplatsTable, Transform
from mirelight.io.job.settings_tables import RelightTable
from mirelight.io.job.source import Source
from mirelight.io.job.tables import JobTable
from mirelight.io.suffixes import GLTF, SCENES, USD
from mirelight.model import (
    F32,
    Deferred,
    EstimatedSky,
    Inserted,
    Job,
    Light,
    Lighting,
    ProxyMesh,
    ProxyRecipe,
    SplatCloud,
    SplatFile,
)
from mirelight.model.lights import SKY, SUN
from mirelight.model.profiles import COLOURING
from mirelight.model.recipe import not_made_yet

if TYPE_CHECKING:
    from mirelight.io.cameras import CameraFile
    from mirelight.io.gltf.moving_lights import Shot
    from mirelight.io.ies import IesFile


@dataclass(slots=True)
class Assets:
    """Reads files by the names that the job gives them, and keeps a digest of each."""

    folder: Path
    proxy: ProxyTable | None
    engine: model.EngineSettings  # what lights in its terms count on
    digests: dict[str, str] = field(default_factory=dict)
    shots: dict[Path, Shot] = field(default_factory=dict)  # open glTF files whose lights move
    notes: dict[str, None] = field(default_factory=dict)  # lines about what the files hold, each once

    def path(self, named: str) -> Path:
        """The file of a name in the job; its digest is taken now."""
        path = self.folder / named
        if named not in self.digests:
            self.digests[named] = digest(path)
        return path

    def splat_files(self, tables: list[SplatsTable]) -> tuple[SplatFile, ...]:
        """The splat files, and how the job places them."""
        return tuple(
            SplatFile(
                path=self.path(t.path),
                world_from_file=placing.matrix(t.transform),
                lod=t.lod,
                color_space=t.color_space,
            )
            for t in tables
        )

    def splats(self, tables: list[SplatsTable], files: tuple[SplatFile, ...]) -> Deferred[SplatCloud]:
        """All splat files in world space, as one cloud."""
        known = [
            (self.digests[t.path], x.world_from_file, x.lod, x.color_space) for t, x in zip(tables, files, strict=True)
        ]
        return Deferred(model.digest("splats", known), partial(_cloud, files))

    def mesh(self, table: ProxyTable) -> Deferred[ProxyMesh]:
        """The proxy in world space; gray where its colours come from the splats."""
        path, m = self.path(table.path), placing.matrix(table.transform)
        if path.suffix.lower() in GLTF:
            from mirelight.io.gltf.decoders import refuse_without_decoder

            refuse_without_decoder(path)
        albedo = "gray" if table.albedo == "splats" else table.albedo
        return Deferred(model.digest("proxy", self.digests[table.path], m, albedo), partial(_mesh, path, m, albedo))

    def inserted(self, table: ObjectTable) -> Inserted:
        """An object in world space, before it is dropped."""
        return inserted.of_table(table, self.path(table.path), self.digests[table.path])

    def scene_lights(
        self, path: str, unit: LightUnit | None = None, time: float | None = None
    ) -> tuple[tuple[Light, ...], Matrix]:
        """See :class:`lighting.LightFiles`."""
        from mirelight.io.gltf import blender
        from mirelight.io.gltf.moving_lights import Shot
        from mirelight.io.gltf.scene import read_lights_of

        file, default = self._scene(path)
        if file.suffix.lower() in USD:
            return self._stage_lights(file, time), default
        if time is not None and file not in self.shots:
            self.shots[file] = Shot.of(file)
        found = read_lights_of(file) if time is None else self.shots[file].at(time)
        if unit == "blender":
            return tuple(blender.as_in_blender(light) for light in found.lights), default
        if unit is None and found.blender and found.lights:
            remedy = f'lights_from = {{ path = "{path}", unit = "blender" }} takes that out, unit = "khr" keeps it'
            self.notes[blender.note(file.name, found.blender, remedy)] = None
        return found.lights, default

    def _stage_lights(self, file: Path, time: float | None) -> tuple[Light, ...]:
        from mirelight.io.usd.lights import read_lights

        found = read_lights(file, time)
        self.notes |= dict.fromkeys(f"{file.name}: {note}" for note in found.notes)
        return found.lights

    def light_times(self, path: str, fps: float | None, frames: int | None) -> list[float]:
        """See :class:`lighting.LightFiles`."""
        file, _ = self._scene(path)
        if file.suffix.lower() in USD:
            from mirelight.io.usd.lights import light_times as stage_times

            return stage_times(file, fps, frames)
        from mirelight.io.gltf.moving_lights import light_times

        return [float(t) for t in light_times(file, fps=fps, count=frames)]

    def scene_cameras(self, path: str) -> tuple[tuple[SceneCamera, ...], Matrix]:
        """See :class:`cameras.CameraFiles`."""
        file, default = self._scene(path)
        if file.suffix.lower() in USD:
            from mirelight.io.usd.cameras import read_cameras as stage_cameras

            return stage_cameras(file), default
        from mirelight.io.gltf.scene import read_cameras

        return read_cameras(file), default

    def sampled(
        self, path: str, name: str, fps: float | None, frames: int | None
    ) -> tuple[tuple[float, SceneCamera], ...]:
        """See :class:`cameras.CameraFiles`."""
        file, _ = self._scene(path)
        if file.suffix.lower() in USD:
            from mirelight.io.usd.cameras import sample_cameras as sampled_stage

            return sampled_stage(file, name, fps=fps, count=frames)
        from mirelight.io.gltf.animation import sample_cameras
        from mirelight.io.gltf.scene import read_cameras

        poses = sample_cameras(file, name, fps=fps, count=frames)  # says where there is no such camera
        camera = next(x for x in read_cameras(file) if x.name == name)
        return tuple((time, replace(camera, world=pose)) for time, pose in poses)

    def camera_file(self, path: str) -> CameraFile:
        """See :class:`cameras.CameraFiles`. Of a folder, the digests are those of the files that are read."""
        from mirelight.io.cameras import open_file

        found = open_file(self.folder / path)
        if len(found.files) > 2:  # one for each picture
            self.digests[path] = digest_of_all(found.files, found.files[0].parent)
        else:
            named = {os.path.relpath(file, self.folder): file for file in found.files}
            self.digests |= {name: file_digest(file) for name, file in named.items()}
        return found

    def ies(self, path: str) -> IesFile:
        """See :class:`lighting.LightFiles`."""
        from mirelight.io.ies import read_ies

        return read_ies(self.path(path))

    def panorama(self, path: str) -> Deferred[F32]:
        """A panorama (H, W, 3), read when it is first asked for; see :class:`lighting.LightFiles`."""
        file = self.path(path)
        return Deferred(
            model.digest("picture", self.digests[path]), partial(_panorama, file, self.digests[path]), keep=False
        )

    def _scene(self, path: str) -> tuple[Path, Matrix]:
        if path == PROXY and self.proxy is not None:
            return self.path(self.proxy.path), placing.matrix(self.proxy.transform)
        return self.path(path), placing.matrix(Transform())


def build(source: Source, table: JobTable) -> Job:
    """Read what the job names.

    Raises:
        InputError: a file cannot be used, or does not hold what the job wants of it.
        ManyInputsError: several names that the files do not have.
    """
    wrong: list[Mistake] = []
    assets = Assets(source.folder, table.proxy, model.EngineSettings(**_settings(table.engine)))
    found: list[tuple[model.Camera, ...]] = []  # the cameras, once they are asked for

    def cameras_of() -> tuple[model.Camera, ...]:
        if not found:
            found.append(cameras.of_job(table, assets, cameras.Extent(splats, proxy, there=made is None), wrong))
        return found[0]

    files = assets.splat_files(table.splats) if table.splats else ()
    splats = assets.splats(table.splats, files) if table.splats else None
    compositor = drawing.compositor(table, files, wrong)
    capture_cameras = _capture_cameras(table, assets, wrong)
    made = _made_of_splats(source, table, splats, capture_cameras)
    proxy = _with_job_albedo(made.mesh, table) if made else assets.mesh(table.proxy) if table.proxy else None
    wrong += moments.mistakes(table)
    lightings, is_moment = _lightings(table, assets, cameras_of, wrong)
    captured = _captured(table, lightings, assets, wrong)
    if table.sweep is not None and not wrong:
        relit = partial(relight_settings, table)
        lightings = sweep.swept(table, lightings, assets, source.folder, relit, wrong)
        is_moment = [False] * len(lightings)
    mixed = mixing.mixed(moving.moved(lightings, table.moved, wrong), table.mix, wrong)
    captured = captured or _estimated(table, splats, proxy, assets, wrong)
    if any(isinstance(x, AsCaptured) for x in table.lightings):
        mixed, is_moment = _as_captured(captured, relight_settings(table), wrong)
    cameras_of()
    source.refuse(wrong)
    return Job(
        source=source.path,
        splats=splats,
        splat_files=files,
        proxy=proxy,
        made_proxy=made,
        capture_cameras=capture_cameras,
        objects=tuple(assets.inserted(x) for x in table.objects),
        albedo_from_splats=_uses_splat_albedo(table),
        cameras=cameras_of(),
        lightings=moments.numbered(mixed, is_moment),
        pooled=table.sweep is not None,
        captured=captured,
        render=model.RenderSettings(profile=table.profile, **_settings(table.render)),
        compositor=compositor,
        relight=relight_settings(table),
        display=drawing.display(source, table.display, assets.path),
        output=_output(source, table),
        dataset=model.DatasetSettings(**_settings(table.dataset)),
        engine=assets.engine,
        inputs=dict(sorted(assets.digests.items())),
        notes=tuple(assets.notes),
    )


def _uses_splat_albedo(table: JobTable) -> bool:
    """Whether the proxy takes the splats' colours: asked for, or nothing else said in a mode that is about colours."""
    if table.proxy is None or table.proxy.albedo == "splats":
        return table.proxy is not None
    traced = model.rules_of(table.profile).path_traced
    by_default = "albedo" not in table.proxy.model_fields_set and traced
    return by_default and relight_settings(table).mode in COLOURING


def _cloud(files: tuple[SplatFile, ...]) -> SplatCloud:
    from mirelight.io import splats

    clouds = []
    for file in files:
        cloud, m = splats.read(file.path, lod=file.lod), file.world_from_file
        cloud = replace(cloud, color_space=file.color_space or cloud.color_space)
        clouds.append(cloud if placing.is_identity(m) else splats.transform(cloud, m))
    return clouds[0] if len(clouds) == 1 else splats.merge(clouds)


def _capture_cameras(table: JobTable, assets: Assets, wrong: list[Mistake]) -> tuple[model.Camera, ...]:
    """Those of the capture's pictures, in world space: the proxy is made, and colours are looked at, from there."""
    if table.proxy is None or table.proxy.cameras is None or table.splats is None:
        return ()
    named = CamerasFromTable.model_construct(
        {"path"}, path=table.proxy.cameras, transform="splats", distortion="ignore"
    )
    at, size = ("proxy", "cameras"), (table.resolution[0], table.resolution[1])
    found = tuple(camera_files.cameras_from(named, at, size, table.splats, assets, wrong))
    if not found and not wrong:
        wrong.append(Mistake(at, "a file without cameras", "give the capture's, or leave it out"))
    return found


def _made_of_splats(
    source: Source, table: JobTable, splats: Deferred[SplatCloud] | None, cameras: tuple[model.Camera, ...]
) -> ProxyRecipe | None:
    """How a job has its mesh made from its splats; None where it names a file, or none."""
    if table.proxy is None or table.proxy.path != SPLATS or splats is None or table.splats is None:
        return None
    render = table.render
    named = source.folder / table.splats[0].path if len(table.splats) == 1 else source.path
    known = model.digest("proxy of splats", splats.digest, render.variant, *((cameras,) if cameras else ()))
    return ProxyRecipe(
        mesh=Deferred(known, not_made_yet),
        splats=splats,
        cameras=cameras,
        variant=render.variant,
        threads=render.threads,
        source=str(named),
    )


def _with_job_albedo(made: Deferred[ProxyMesh], table: JobTable) -> Deferred[ProxyMesh]:
    """A made mesh with the job's albedo, which is not part of its making."""
    assert table.proxy is not None and table.proxy.albedo != "file"
    albedo = None if table.proxy.albedo == "splats" else tuple(table.proxy.albedo)
    return Deferred(model.digest("proxy", made.digest, albedo), partial(_with_albedo, made, albedo))


def _with_albedo(made: Deferred[ProxyMesh], albedo: tuple[float, ...] | None) -> ProxyMesh:
    return made.value if albedo is None else replace(made.value, albedo=np.asarray(albedo))


def _mesh(path: Path, m: Matrix, albedo: list[float] | str) -> ProxyMesh:
    from mirelight.io import mesh

    found = mesh.read_mesh(path, textures=albedo == "file")
    found = found if placing.is_identity(m) else mesh.transform(found, m)
    if albedo == "gray":
        return found
    return replace(found, albedo=None if albedo == "file" else np.asarray(albedo))


@lru_cache(maxsize=2)  # neighbouring frames share theirs; a job may name hundreds
def _panorama(path: Path, sha256: str) -> F32:
    if path.suffix.lower() in USD:
        from mirelight.io.usd.lights import read_domes

        return read_domes(path)
    from mirelight.io.environment import read_environment

    return read_environment(path)


def relight_settings(table: JobTable, own: RelightTable | None = None) -> model.RelightSettings:
    """The relight settings, with what depends on other tables filled in; `own`: those of one lighting."""
    rules = model.rules_of(table.profile)
    chosen = _settings(own or table.relight)
    chosen["mode"] = chosen["mode"] or rules.default_mode(table.captured is not None)
    chosen["space"] = chosen["space"] or rules.default_space(table.compositor.linear)
    return model.RelightSettings(profile=table.profile, **chosen)


def _output(source: Source, table: JobTable) -> model.OutputSettings:
    """Frames of a sweep hold the picture alone by default: what else there is, they share, and the store keeps it."""
    chosen = _settings(table.output)
    if table.objects and "store" not in table.output.model_fields_set:
        chosen["store"] = "frames"  # what is kept for mixing knows of no objects
    whole = table.sweep is None or chosen["store"] == "frames"
    chosen |= {name: whole for name in ("layers", "aovs") if chosen[name] is None}
    return replace(model.OutputSettings(**chosen), directory=(source.folder / table.output.directory).resolve())


def _settings(table: Any) -> dict[str, Any]:
    values = table.model_dump()
    return {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}


def _lightings(
    table: JobTable, assets: Assets, cameras_of: moments.Cameras, wrong: list[Mistake]
) -> tuple[tuple[Lighting, ...], list[bool]]:
    """The job's lightings, and of each whether it is a moment of lights that move: those of one share its name."""
    named = [(i, x) for i, x in enumerate(table.lightings) if not isinstance(x, AsCaptured)]
    tables: list[tuple[str, Lit, Place]] = [(x.name, x, ("lightings", i)) for i, x in named]
    if not tables and (table.lights or table.lights_from or table.environment):
        tables = [("lighting", table, ())]
    if not tables:
        still = _of_proxy(table, assets)
        return still, [False] * len(still)
    out: list[Lighting] = []
    is_moment: list[bool] = []
    for name, one, at in tables:
        made = moments.of_table(name, one, at, assets, cameras_of, wrong)
        out += made
        is_moment += [any(moments.moves(x) for x in one.lights_from)] * len(made)
    return tuple(out), is_moment


def _of_proxy(table: JobTable, assets: Assets) -> tuple[Lighting, ...]:
    """The lights of the proxy's file, where the job says nothing of light."""
    lights: tuple[Light, ...] = ()
    is_silent = not {"lights", "lights_from", "environment", "lightings"} & table.model_fields_set
    if is_silent and table.proxy is not None and table.proxy.path.lower().endswith(SCENES):
        found, m = assets.scene_lights(PROXY)
        lights = lighting.unique([placing.placed_light(light, m) for light in found])
    return (Lighting(name="lighting", lights=lights),) if lights else ()


def _captured(
    table: JobTable, lightings: tuple[Lighting, ...], assets: Assets, wrong: list[Mistake]
) -> Lighting | None:
    if table.captured is None or table.captured.estimate:
        return None
    if table.captured.lighting is not None:
        return next(x for x in lightings if x.name == table.captured.lighting)
    return lighting.lighting("captured", table.captured, ("captured",), assets, wrong)


def _as_captured(
    captured: Lighting | None, relight: model.RelightSettings, wrong: list[Mistake]
) -> tuple[tuple[Lighting, ...], list[bool]]:
    """The captured light as the job's only lighting. It is compared with itself, so there is nothing to repair."""
    if captured is None:
        remedy = 'add captured = "estimate", or name the light that the capture was made under'
        wrong.append(Mistake(("lightings",), "no captured light to render in", remedy))
        return (), []
    return (replace(captured, name=CAPTURED, relight=replace(relight, repair=False)),), [False]


def _estimated(
    table: JobTable,
    splats: Deferred[SplatCloud] | None,
    proxy: Deferred[ProxyMesh] | None,
    assets: Assets,
    wrong: list[Mistake],
) -> Lighting | None:
    """Captured light that a prepared scene estimates; None where the job does not ask for it."""
    if table.captured is None or not table.captured.estimate or splats is None or proxy is None:
        return None
    seed, exposure = table.render.seed, table.captured.exposure
    named = lighting.lighting("captured", table.captured, ("captured",), assets, wrong).lights
    white = [replace(light, color=np.ones(3), intensity=1.0, group=None) for light in named]
    lights = lighting.unique(white, {SUN, SKY})
    sky = EstimatedSky(splats=splats.digest, proxy=proxy.digest, seed=seed, exposure=exposure, lights=lights)
    return Lighting(name="captured", sky=sky)
