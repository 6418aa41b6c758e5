"""The proxy of a job: read from its file, or made from the splats as its recipe says."""

from __future__ import annotations

from mirelight.model import Job, ProxyMesh, ProxyRecipe
from mirelight.proxy.make import make
from mirelight.proxy.types import ProxySettings


def mesh_of(job: Job) -> ProxyMesh | None:
    """The mesh, in world space, with the job's albedo; None where the job has none.

    Raises:
        InputError: its file cannot be used, or the splats have no surface.
        BackendError: the variant cannot run here.
    """
    if job.made_proxy is not None:
        made_by(job.made_proxy)
    return None if job.proxy is None else job.proxy.value


def made_by(recipe: ProxyRecipe) -> ProxyMesh:
    """The mesh of a recipe, without a job's albedo; made now if it was not yet. Raises as :func:`mesh_of`."""
    if not recipe.mesh.is_there:
        settings = ProxySettings(variant=recipe.variant, threads=recipe.threads)
        made = make(recipe.splats.value, settings, cameras=recipe.cameras, source=recipe.source)
        recipe.mesh.supply(made.mesh)
    return recipe.mesh.value
