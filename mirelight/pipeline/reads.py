"""Settings that a product reads: what of a job goes into its key."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace

from mirelight.model import Camera, CompositorSettings, DisplaySettings, Job, Lighting, OutputSettings, digest
from mirelight.model.profiles import rules_of
from mirelight.model.unit_lights import terms
from mirelight.pipeline import requirements


def exr_settings(output: OutputSettings) -> dict[str, object]:
    """The settings that decide what an EXR holds."""
    elsewhere = "directory", "exr", "png", "store"
    return read(output, (field.name for field in fields(output) if field.name not in elsewhere))


def read(settings: object, names: Iterable[str]) -> dict[str, object]:
    return {name: getattr(settings, name) for name in sorted(names)}


def display_reads(settings: DisplaySettings) -> tuple[object, ...]:
    """What decides a PNG's pixels: of a view not where its config lies, but what it computes."""
    view, settings = settings.view, replace(settings, backdrop=None)  # what stands behind has its own key
    if view is None:
        return (settings,)
    return replace(settings, view=None), view.display, view.view, view.identity


def view(camera: Camera) -> str:
    """Digest of what a camera sees: all of it but its name and when that is."""
    return digest("view", read(camera, (x.name for x in fields(camera) if x.name not in ("name", "time", "frame"))))


def light(lighting: Lighting) -> str:
    """Digest of a lighting without its names."""
    return digest("lighting", [(x.unit.digest, x.weight) for x in terms(lighting)])


def compositor_reads(settings: CompositorSettings) -> set[str]:
    """Names of the settings that shape a composite in its profile."""
    rules = rules_of(settings.profile).splats
    names = {"profile", "sort", "alpha_clip"}
    if rules.drops_small:
        names.add("min_pixel_size")
    if rules.packed:
        names.add("work_buffer")
    names |= (
        {"linear", "eight_bit", "tone", "exposure"} if rules.pipelines else {"color_space", "cutoff", "supersampling"}
    )
    return names


def light_reads(job: Job) -> set[str]:
    """Names of the settings that shape a traced buffer in its profile."""
    names = {"profile", "variant"}
    if requirements.follows_engine(job):
        return names
    names |= {"spp", "noise", "max_depth", "indirect", "seed", "denoise"}
    return names | {"ao_distance"} if requirements.wants_aovs(job) else names
