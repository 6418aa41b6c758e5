"""What was photographed, where single splats do not tell it: the splats as the cameras of their capture see them, in
the colours of its pictures where those are there.

A trained splat smears: what it shows in dark places is brighter by 5 to 25 % than its pictures had it. So composites
say where the surface lies, and pictures what it looks like.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mirelight.base import colour
from mirelight.base.errors import InputError
from mirelight.base.progress import ShareProgress, passed, quiet
from mirelight.compositor import Compositor
from mirelight.io.cameras.pictures import MOST_VIEWS, view_size
from mirelight.model import F32, F64, Camera, Deferred, SplatCloud, SplatLayer, Variant
from mirelight.proxy.capture import are_discs
from mirelight.proxy.guessed import Guess, taken_from
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import ProxySettings


def capture_views(
    splats: SplatCloud,
    cameras: Sequence[Camera],
    pictures: Sequence[Deferred[F32] | None] = (),
    *,
    variant: Variant = "llvm_ad_rgb",
    threads: int | None = None,
    report: Callable[[str], None] | None = None,
    progress: ShareProgress = quiet,
    guess: Guess | None = None,
) -> tuple[SplatLayer, ...]:
    """What the cameras of the capture see; where none are known, guessed ones, if the splats tell of any; of discs,
    where nothing tells it better, none.

    Args:
        splats: world space.
        cameras: of the pictures that the splats were made from.
        pictures: those, (H, W, 3), as `Job.capture_pictures` has them; composites stand for what is not there, cannot
            be read, or shows something else than the splats.
        variant: where they are composited.
        threads: worker threads, process-wide; None: as they are.
        report: gets a line on pictures that are not used.
        progress: hears how many views are there.
        guess: gives those that are guessed; None: that is done now.
    """
    if not any(pictures) and are_discs(splats):
        return ()
    if not cameras:
        cameras = guess() if guess else taken_from(splats, ProxySettings(variant=variant, threads=threads))
    if not cameras:
        return ()
    compositor = Compositor(splats, variant=variant, threads=threads)
    step = -(-len(cameras) // MOST_VIEWS)
    views = [
        compositor.composite(x.resized(*view_size(x.width, x.height)))
        for x in passed(cameras[::step], progress, "looking through the capture's cameras")
    ]
    photographs, refused, strangers = dict[int, F32](), list[str](), 0
    exposures = np.full(len(views), np.nan)
    for k, (view, picture) in enumerate(zip(views, pictures[::step], strict=bool(pictures))):
        if picture is None:
            continue
        try:
            photographs[k] = picture.value
            exposures[k] = _exposure(view, photographs[k])
        except InputError as unfit:
            refused.append(str(unfit))
        except ValueError as unlike:
            refused.append(f"that of {view.camera.name!r} {unlike}")
            del photographs[k]
            strangers += 1
    gains = _gains(exposures)
    for k, photograph in photographs.items():
        views[k] = _as_photographed(views[k], photograph, float(gains[k]))
    count = len(photographs) + len(refused)
    if strangers == count > 1 and report is not None:
        report(
            f"none of the {count} pictures of the capture shows what its splats show from there: their cameras may be "
            "another capture's, or in other axes; give its own, or none"
        )
    elif refused and report is not None:
        report(
            f"{len(refused)} of {count} pictures of the capture are not used, but what its splats show: {refused[0]}"
        )
    return tuple(views)


def _exposure(view: SplatLayer, picture: F32) -> float:
    """The logarithm of by how much more a picture (H, W, 4) shows than the splats, where it is bright; NaN where too
    little is. Raises ValueError: it shows something else."""
    alpha = 1 - view.transmittance
    own = np.maximum(view.color / np.maximum(alpha, 1e-6)[..., None], 0)
    own = own if view.linear else colour.srgb_decode(own)
    light = [colour.luminance(x) for x in (picture[..., :3], own)]
    told = (picture[..., 3] > TUNING.picture_counts) & (alpha > TUNING.picture_opaque) & (light[0] > 0) & (light[1] > 0)
    told &= np.maximum(picture[..., :3], own).max(axis=2) < TUNING.picture_white
    if np.count_nonzero(told) < TUNING.picture_fewest:
        return np.nan
    ratio = np.log(light[0][told] / light[1][told])
    ratio = ratio[light[1][told] > np.quantile(light[1][told], TUNING.picture_bright)]
    exposure = float(np.median(ratio))
    if float(np.median(np.abs(ratio - exposure))) > TUNING.picture_unlike:
        raise ValueError("shows something else than the splats do from there")
    return exposure


def _gains(exposures: F64) -> F64:
    """(N,) what pictures are multiplied by: all alike, unless they were exposed one by one or developed anew.

    Splats show a few hundredths more than the pictures that they were trained on, from one to the next by a little
    more or less. That is no exposure.
    """
    told = exposures[np.isfinite(exposures)]
    if not len(told):
        return np.ones(len(exposures))
    middle = float(np.median(told))
    common = middle if abs(middle) > TUNING.picture_developed else 0.0
    varied = float(np.median(np.abs(told - middle))) > TUNING.picture_varied
    apart = np.nan_to_num(exposures - middle) if varied else np.zeros(len(exposures))
    return np.asarray(np.exp(-common - apart))


def _as_photographed(view: SplatLayer, picture: F32, gain: float) -> SplatLayer:
    """The view in the colours of a picture (H, W, 4), times a gain; what does not count in it shows nothing."""
    clipped = picture[..., :3].max(axis=2) > TUNING.picture_white
    counts = picture[..., 3] > TUNING.picture_counts
    if gain < 1:
        counts &= ~clipped  # white, of which no more is known than that it is above the gain
    rgb = np.minimum(picture[..., :3] * np.where(clipped, 1, gain)[..., None], 1)
    there = np.where(counts, 1 - view.transmittance, 0)
    return replace(
        view,
        color=np.asarray((rgb if view.linear else colour.srgb_encode(rgb)) * there[..., None], np.float32),
        transmittance=np.asarray(1 - there, np.float32),
        diffuse=None,
    )
