"""Settings that a product reads: what of a job goes into its key."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace

from mirelight.model import CompositorSettings, DisplaySettings, Job, OutputSettings
from mirelight.model.profiles import rules_of
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


def compositor_reads(settings: CompositorSettings) -> set[str]:
    """Names of the settings that shape a composite in its profile."""
    rules = rules_of(settings.profile).splats
    names = {"profile", "sort", "alpha_clip"}
    if rules.drops_small:
        names.add("min_pixel_size")
    if rules.packed:
        names.add("work_buffer")
    names |= {"linear", "eight_bit", "tone", "exposure"} if rules.pipelines else {"color_space", "cutoff"}
    return names


def light_reads(job: Job) -> set[str]:
    """Names of the settings that shape a traced buffer in its profile."""
    names = {"profile", "variant"}
    if requirements.follows_engine(job):
        return names
    names |= {"spp", "noise", "max_depth", "indirect", "seed", "denoise"}
    return names | {"ao_distance"} if requirements.wants_aovs(job) else names
