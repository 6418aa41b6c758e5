"""The proxy of a job: read from its file, or made from the splats as its recipe says."""

from __future__ import annotations

from functools import partial

from mirelight.base.progress import ShareProgress, quiet
from mirelight.model import Job, OwnSplats, ProxyMesh, ProxyRecipe
from mirelight.proxy.guessed import Guess, taken_as_placed
from mirelight.proxy.make import make
from mirelight.proxy.types import ProxySettings


def mesh_of(job: Job) -> ProxyMesh | None:
    """The mesh, in world space, with the job's albedo; None where the job has none.

    Raises:
        InputError: its file cannot be used, or the splats have no surface.
        BackendError: the variant cannot run here.
    """
    if job.made_proxy is not None:
        own = job.own_splats or OwnSplats.of_world(job.made_proxy.splats)
        made_by(job.made_proxy, partial(taken_as_placed, own, settings_of(job.made_proxy)))
    return None if job.proxy is None else job.proxy.value


def made_by(recipe: ProxyRecipe, guess: Guess, progress: ShareProgress = quiet) -> ProxyMesh:
    """The mesh of a recipe, without a job's albedo; made now if it was not yet, by guessed cameras where none are
    known. Raises as :func:`mesh_of`."""
    if not recipe.mesh.is_there:
        splats, settings = recipe.splats.value, settings_of(recipe)
        made = make(splats, settings, progress, cameras=recipe.cameras, source=recipe.source, guess=guess)
        recipe.mesh.supply(made.mesh)
    return recipe.mesh.value


def settings_of(recipe: ProxyRecipe) -> ProxySettings:
    """How a job's proxy is made."""
    return ProxySettings(ceiling=recipe.ceiling, variant=recipe.variant, threads=recipe.threads)
