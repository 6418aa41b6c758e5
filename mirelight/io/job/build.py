"""From the tables of a job to the model's types: reads every file that the job names."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from mirelight import model
from mirelight.io.job import (
    cameras,
    drawing,
    inserted,
    lighting,
    mixing,
    moments,
    moving,
    sweep,
)
from mirelight.io.job.assets import Assets
from mirelight.io.job.camera_files import FromFiles
from mirelight.io.job.fields import CAPTURED, PROXY, SPLATS
from mirelight.io.job.light_tables import Lit
from mirelight.io.job.material_tables import MaskTable
from mirelight.io.job.mistakes import Mistake
from mirelight.io.job.positions import Path as Place
from mirelight.io.job.scene_tables import ObjectTable
from mirelight.io.job.settings_tables import RelightTable
from mirelight.io.job.source import Source
from mirelight.io.job.tables import JobTable
from mirelight.io.job.words import shown
from mirelight.io.suffixes import SCENES
from mirelight.model import (
    F32,
    Deferred,
    EstimatedSky,
    Job,
    Light,
    Lighting,
    ProxyMesh,
    ProxyRecipe,
    SplatCloud,
)
from mirelight.model.dressing import Dress, Mask, dressed
from mirelight.model.lights import SKY, SUN
from mirelight.model.profiles import COLOURING
from mirelight.model.recipe import not_made_yet


def build(source: Source, table: JobTable) -> Job:
    """Read what the job names.

    Raises:
        InputError: a file cannot be used, or does not hold what the job wants of it.
        ManyInputsError: several names that the files do not have.
    """
    wrong: list[Mistake] = []
    assets = Assets(source.folder, table.proxy, model.EngineSettings(**_settings(table.engine)))

    @cache  # found once they are asked for
    def cameras_of() -> tuple[model.Camera, ...]:
        return cameras.of_job(table, assets, cameras.Extent(splats, proxy, there=made is None), wrong)

    files = assets.splat_files(table.splats) if table.splats else ()
    splats = assets.splats(table.splats, files) if table.splats else None
    compositor = drawing.compositor(table, files, wrong)
    capture_cameras, capture_pictures = _capture(table, assets, wrong)
    made = _made_of_splats(source, table, splats, capture_cameras)
    proxy = _with_job_albedo(made.mesh, table) if made else _of_file(table, assets)
    dresses = _dresses(table, assets, cameras_of, wrong)
    masks = _masks(table, assets, cameras_of, wrong)
    proxy = _glowing(proxy, dresses, source) if proxy else None
    wrong += moments.mistakes(table)
    lightings, is_moment = _lightings(table, assets, cameras_of, wrong)
    lightings, captured = _captured(table, lightings, (splats, proxy), assets, wrong)
    if any(x.is_captured for x in table.lightings):
        lightings = _with_captured(lightings, captured, relight_settings(table), wrong)

    def objects(tables: list[ObjectTable]) -> tuple[model.Inserted, ...]:
        return inserted.named_apart([assets.inserted(x) for x in tables])

    if table.sweep is not None and not wrong:
        makers = sweep.Makers(assets, partial(relight_settings, table), objects)
        lightings = sweep.swept(table, lightings, makers, source.folder, wrong)
        is_moment = [False] * len(lightings)
    mixed = mixing.mixed(moving.moved(lightings, table.moved, wrong), table.mix, wrong)
    cameras_of()
    source.refuse(wrong)
    return Job(
        source=source.path,
        splats=splats,
        splat_files=files,
        own_splats=assets.own_splats(table.splats, files),
        proxy=proxy,
        made_proxy=made,
        capture_cameras=capture_cameras,
        capture_pictures=capture_pictures,
        materials=dresses,
        masks=masks,
        objects=objects(table.objects),
        albedo_from_splats=_uses_splat_albedo(table),
        cameras=cameras_of(),
        lightings=moments.numbered(mixed, is_moment),
        pooled=table.sweep is not None and (table.sweep.how == "crossed" or all(x.objects is None for x in mixed)),
        captured=captured,
        render=model.RenderSettings(profile=table.profile, **_settings(table.render)),
        compositor=compositor,
        relight=relight_settings(table),
        display=drawing.display(source, table.display, assets.path),
        output=_output(source, table, cameras_of()),
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


def _capture(
    table: JobTable, assets: Assets, wrong: list[Mistake]
) -> tuple[tuple[model.Camera, ...], tuple[Deferred[F32] | None, ...]]:
    """The cameras of the capture's pictures, in world space: the proxy is made, and colours are looked at, from there;
    and those pictures, where they are known."""
    if table.proxy is None or table.proxy.cameras is None or table.splats is None:
        return (), ()
    size = table.resolution[0], table.resolution[1]
    cameras, pictures = FromFiles(size, table.splats, assets, wrong).with_pictures(table.proxy)
    if not cameras and not wrong:
        wrong.append(Mistake(("proxy", "cameras"), "a file without cameras", "give the capture's, or leave it out"))
    return tuple(cameras), assets.pictures(pictures)


def _made_of_splats(
    source: Source, table: JobTable, splats: Deferred[SplatCloud] | None, cameras: tuple[model.Camera, ...]
) -> ProxyRecipe | None:
    """How a job has its mesh made from its splats; None where it names a file, or none."""
    if table.proxy is None or table.proxy.path != SPLATS or splats is None or table.splats is None:
        return None
    render = table.render
    named = source.folder / table.splats[0].path if len(table.splats) == 1 else source.path
    ceiling = table.proxy.ceiling
    known = model.digest("proxy of splats", splats.digest, render.variant, ceiling, *((cameras,) if cameras else ()))
    return ProxyRecipe(
        mesh=Deferred(known, not_made_yet),
        splats=splats,
        cameras=cameras,
        ceiling=ceiling,
        variant=render.variant,
        threads=render.threads,
        source=str(named),
    )


def _with_job_albedo(made: Deferred[ProxyMesh], table: JobTable) -> Deferred[ProxyMesh]:
    """A made mesh with the job's albedo, which is not part of its making."""
    assert table.proxy is not None and table.proxy.albedo != "file"
    albedo = None if table.proxy.albedo == "splats" else tuple(table.proxy.albedo)
    return Deferred(model.digest("proxy", made.digest, albedo), partial(_with_albedo, made, albedo))


def _of_file(table: JobTable, assets: Assets) -> Deferred[ProxyMesh] | None:
    return assets.mesh(table.proxy, finish=table.relight.gloss or table.sweep is not None) if table.proxy else None


def _dresses(table: JobTable, assets: Assets, cameras_of: moments.Cameras, wrong: list[Mistake]) -> tuple[Dress, ...]:
    """What the job says of the proxy's surface."""
    out: list[Dress] = []
    for i, one in enumerate(table.materials):
        mask: Mask | None = None
        if one.mask is not None:
            mask = _mask(one.mask, ("materials", i, "mask"), assets, cameras_of, wrong)
            if mask is None:
                continue
        out.append(one.dress(mask))
    return tuple(out)


def _masks(table: JobTable, assets: Assets, cameras_of: moments.Cameras, wrong: list[Mistake]) -> tuple[Mask, ...]:
    """Where factors are wrong. Captured light as the only lighting is compared with itself, so there is none."""
    if table.lightings and all(x.is_captured for x in table.lightings):
        return ()
    found = [_mask(x, ("relight", "mask", i), assets, cameras_of, wrong) for i, x in enumerate(table.relight.mask)]
    return tuple(x for x in found if x is not None)


def _mask(
    table: MaskTable, at: Place, assets: Assets, cameras_of: moments.Cameras, wrong: list[Mistake]
) -> Mask | None:
    """What is painted over a camera's frame; None, and a mistake more, where there is no such camera."""
    named = {x.name: x for x in cameras_of()}
    camera = named.get(table.camera)
    if camera is None:
        found, remedy = f"no camera is named {shown(table.camera)}", f"there are: {', '.join(list(named)[:10])}"
        wrong.append(Mistake((*at, "camera"), found, remedy))
        return None
    return Mask(camera=camera, painted=assets.painted(table.path, camera))


def _glowing(mesh: Deferred[ProxyMesh], dresses: tuple[Dress, ...], source: Source) -> Deferred[ProxyMesh]:
    """A mesh with what the job's materials send out; how they mirror counts for no matt light. What is painted is found
    once there are rays."""
    glowing = tuple(x for x in dresses if x.emission is not None)
    if not glowing or any(x.mask is not None for x in glowing):
        return mesh
    return Deferred(model.digest("glowing", mesh.digest, glowing), partial(_dressed, mesh, glowing, str(source.shown)))


def _dressed(mesh: Deferred[ProxyMesh], dresses: tuple[Dress, ...], source: str) -> ProxyMesh:
    return dressed(mesh.value, dresses, source)


def _with_albedo(made: Deferred[ProxyMesh], albedo: tuple[float, ...] | None) -> ProxyMesh:
    return made.value if albedo is None else replace(made.value, albedo=np.asarray(albedo))


def relight_settings(table: JobTable, own: RelightTable | None = None) -> model.RelightSettings:
    """The relight settings, with what depends on other tables filled in; `own`: those of one lighting."""
    rules = model.rules_of(table.profile)
    chosen = _settings(own or table.relight)
    del chosen["mask"]  # of the whole job
    chosen["mode"] = chosen["mode"] or rules.default_mode(table.captured is not None)
    chosen["space"] = chosen["space"] or rules.default_space(table.compositor.linear)
    return model.RelightSettings(profile=table.profile, **chosen)


def _output(source: Source, table: JobTable, cameras: tuple[model.Camera, ...]) -> model.OutputSettings:
    """Frames of a sweep hold the picture alone by default: what else there is, they share, and the store keeps it. Of
    cameras with a lens, or of objects that move, frames alone are kept: they are mixed from no layers."""
    chosen = _settings(table.output)
    unmixed = any(x.exposure is not None for x in cameras) or any(x.keys for x in table.objects)
    if unmixed and chosen["store"] == "both":
        chosen["store"] = "frames"
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
    tables: list[tuple[str, Lit, Place]] = [(x.name, x, ("lightings", i)) for i, x in enumerate(table.lightings)]
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
        lights = lighting.unique([light.carried(m) for light in found])
    return (Lighting(name="lighting", lights=lights),) if lights else ()


def _captured(
    table: JobTable,
    lightings: tuple[Lighting, ...],
    scene: tuple[Deferred[SplatCloud] | None, Deferred[ProxyMesh] | None],
    assets: Assets,
    wrong: list[Mistake],
) -> tuple[tuple[Lighting, ...], Lighting | None]:
    """The lightings, and the captured one, which may be one of them; None where the job names none. `scene`: splats and
    proxy, of which it may be estimated."""
    if table.captured is None or table.captured.estimate:
        return lightings, _estimated(table, *scene, assets, wrong)
    if table.captured.lighting is None:
        return lightings, lighting.lighting("captured", table.captured, ("captured",), assets, wrong)
    named = next(x for x in lightings if x.name == table.captured.lighting)
    left = _unchanged(named, relight_settings(table))
    return tuple(left if x is named else x for x in lightings), left


def _with_captured(
    lightings: tuple[Lighting, ...], captured: Lighting | None, relight: model.RelightSettings, wrong: list[Mistake]
) -> tuple[Lighting, ...]:
    """The lightings, with the captured light in the place of that which has its name."""
    if captured is None:
        remedy = 'add captured = "estimate", or name the light that the capture was made under'
        wrong.append(Mistake(("lightings",), "no captured light to render in", remedy))
        return lightings
    own = _unchanged(replace(captured, name=CAPTURED, relight=None), relight)
    return tuple(own if x.name == CAPTURED else x for x in lightings)


def _unchanged(captured: Lighting, relight: model.RelightSettings) -> Lighting:
    """The captured light as one of the job's lightings. It is compared with itself: there is nothing to repair, and
    gloss that the capture has is not made anew."""
    return replace(captured, relight=replace(captured.relight or relight, repair=False, gloss=False))


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
