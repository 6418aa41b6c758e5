"""Whether a job says enough to be rendered."""

from __future__ import annotations

from mirelight import relighting
from mirelight.base import extras
from mirelight.base.errors import InputError
from mirelight.model import Job, RelightSettings
from mirelight.model.profiles import COMPARING
from mirelight.pipeline import requirements


def check(job: Job) -> None:
    """Raises InputError where a job names too little to be rendered, BackendError where it needs a package that is not
    installed."""
    if job.render.denoise and job.proxy is not None and not requirements.follows_engine(job):
        extras.require("denoise")
    if job.splats is None and (job.proxy is None or not job.lightings):
        raise InputError(job.source, "nothing to render", "name splats, or a proxy and lights")
    kept_apart = job.output.store == "layers" or job.dataset.layouts
    if kept_apart and job.splats is not None and any(_asks_splats(x) for x in _relights(job)):
        raise InputError(
            job.source,
            "light that is found for splats, and frames that are mixed from the layers of pixels",
            'set per to "pixel", or leave dataset.layouts and output.store = "layers" out',
            field="relight.per",
        )
    if job.objects:
        _check_objects(job)
    if kept_apart and job.has_motion:
        found = "objects that move, and frames that are mixed from layers"
        remedy = 'leave dataset.layouts and output.store = "layers" out'
        raise InputError(job.source, found, remedy, field="objects")
    if kept_apart and any(x.exposure is not None for x in job.cameras):
        found = "a lens or a shutter, and frames that are mixed from the layers of one pinhole"
        remedy = 'leave dataset.layouts and output.store = "layers" out'
        raise InputError(job.source, found, remedy, field="cameras")
    if any(x.gloss for x in _relights(job)):
        _check_gloss(job)
    if job.masks:
        _check_masks(job, bool(kept_apart))
    if any(x.follows_sky for x in _relights(job)):
        _check_background(job)
    if job.lightings and job.proxy is None:
        raise InputError(job.source, "lights but no proxy mesh for them to fall on", 'add the line proxy = "splats"')
    if job.lightings and job.splats is not None and requirements.compares(job) and job.captured is None:
        raise InputError(
            job.source,
            f"mode {_comparing(job)!r} without the lighting that the capture was made under",
            "name it, or set mode to 'tint'",
            field="relight.mode",
        )


def _check_objects(job: Job) -> None:
    """Raises InputError, in one line, where a job asks for objects together with what they are not made for."""
    lit = _relights(job)[1:]
    wrong = (
        (job.proxy is None, "no proxy mesh for them to stand on", 'add the line proxy = "splats"'),
        (not job.lightings, "no light on them", 'name lights, or lightings = "captured"'),
        (requirements.follows_engine(job), "the profile playcanvas, whose light is not traced", "use profile physical"),
        (
            job.splats is not None and not all(relighting.mode_of(x).needs_captured for x in lit),
            "a mode that does not compare with the captured light",
            'give captured, and set relight.mode to "ratio"',
        ),
        (any(_asks_splats(x) for x in lit), "light that is found for splats", 'set relight.per to "pixel"'),
    )
    for is_so, found, remedy in wrong:
        if is_so:
            raise InputError(job.source, f"inserted objects and {found}", remedy, field="objects")


def _check_gloss(job: Job) -> None:
    """Raises InputError, in one line, where a job asks for gloss together with what does not have it."""
    wrong = (
        (job.proxy is None, "no proxy mesh whose materials mirror", 'add the line proxy = "splats"'),
        (requirements.follows_engine(job), "the profile playcanvas, whose light is not traced", "use profile physical"),
    )
    for is_so, found, remedy in wrong:
        if is_so:
            raise InputError(job.source, f"gloss and {found}", remedy, field="relight.gloss")


def _check_background(job: Job) -> None:
    """Raises InputError, in one line, where splats of the sky are to follow light that is not known."""
    asking = [x for x in _relights(job) if x.follows_sky]
    captured, number = job.captured, "give a number"
    wrong = (
        (requirements.follows_engine(job), "the profile playcanvas, whose background is one number", number),
        (
            not all(relighting.mode_of(x).needs_captured for x in asking),
            "a mode that does not compare with the captured light",
            f'{number}, or name captured and set relight.mode to "ratio"',
        ),
        (
            captured is not None and captured.environment is None and captured.sky is None,
            "captured light without an environment",
            f"{number}, or name what the capture had around it",
        ),
    )
    for is_so, found, remedy in wrong:
        if is_so:
            raise InputError(job.source, f'"environment" and {found}', remedy, field="relight.background")


def _check_masks(job: Job, kept_apart: bool) -> None:
    """Raises InputError, in one line, where a job paints over factors that it does not have."""
    wrong = (
        (job.splats is None, "no splats whose colours are changed", "name a capture, or leave the mask out"),
        (requirements.follows_engine(job), "the profile playcanvas, whose light is not traced", "use profile physical"),
        (any(_asks_splats(x) for x in _relights(job)), "light that is found for splats", 'set relight.per to "pixel"'),
        (kept_apart, "frames that are mixed from layers", 'leave dataset.layouts and output.store = "layers" out'),
    )
    for is_so, found, remedy in wrong:
        if is_so:
            raise InputError(job.source, f"a mask and {found}", remedy, field="relight.mask")


def _comparing(job: Job) -> str:
    """The first mode that compares with the captured light."""
    return next(x.mode for x in _relights(job) if x.mode in COMPARING)


def _relights(job: Job) -> list[RelightSettings]:
    """How any of the job's lightings meets the splats."""
    return [job.relight_of(x) for x in (None, *job.lightings)]


def _asks_splats(settings: RelightSettings) -> bool:
    return relighting.per_splat(settings)
