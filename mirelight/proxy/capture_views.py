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
from mirelight.io.cameras.pictures import MOST_VIEWS, view_size
from mirelight.model import F32, Camera, Deferred, SplatCloud, SplatLayer, Variant
from mirelight.model.scene import SOLID
from mirelight.proxy.capture import SURFEL

_SAMPLE = 20_000  # splats that tell their kind
_OPAQUE = 0.9  # alpha of pixels by which a picture's exposure is told
_BRIGHT = 0.7  # quantile of the light from which it is: what is dark shows in composites what lies beside it
_WHITE = 0.98  # display value from which a pixel may have been any brighter
_COUNTS = 0.99  # of a pixel of a picture, from which it is taken
_FEWEST = 100  # pixels
_UNLIKE = 0.35  # log of light by which half of the pixels are off at the least, if a picture is not of the splats
_SAME = 0.02  # log of exposures that are taken as one


def are_discs(splats: SplatCloud) -> bool:
    """Whether splats lie on the surface as thin discs, each with the surface's own colour."""
    solid = np.flatnonzero(splats.opacities >= SOLID)
    shape = np.sort(splats.scales[solid[:: max(len(solid) // _SAMPLE, 1)]].astype(np.float64), axis=1)
    return bool(np.median(shape[:, 0] / np.maximum(shape[:, 1], 1e-30)) < SURFEL) if len(shape) else True


def capture_views(
    splats: SplatCloud,
    cameras: Sequence[Camera],
    pictures: Sequence[Deferred[F32] | None] = (),
    *,
    variant: Variant = "llvm_ad_rgb",
    threads: int | None = None,
    report: Callable[[str], None] | None = None,
) -> tuple[SplatLayer, ...]:
    """What the cameras of the capture see, none of discs.

    Args:
        splats: world space.
        cameras: of the pictures that the splats were made from.
        pictures: those, as `Job.capture_pictures` has them; composites stand for what is not there, cannot be read, or
            shows something else than the splats.
        variant: where they are composited.
        threads: worker threads, process-wide; None: as they are.
        report: gets a line on pictures that are not used.
    """
    if not cameras or are_discs(splats):
        return ()
    from mirelight.compositor import Compositor

    compositor = Compositor(splats, variant=variant, threads=threads)
    step = -(-len(cameras) // MOST_VIEWS)
    taken = pictures[::step] if pictures else [None] * len(cameras[::step])
    views, refused = list[SplatLayer](), list[str]()
    for camera, picture in zip(cameras[::step], taken, strict=True):
        view = compositor.composite(camera.resized(*view_size(camera.width, camera.height)))
        if picture is not None:
            try:
                view = _as_photographed(view, picture.value)
            except InputError as unfit:
                refused.append(str(unfit))
            except ValueError as unlike:
                refused.append(f"that of {camera.name!r} {unlike}")
        views.append(view)
    if refused and report is not None:
        there = sum(x is not None for x in taken)
        report(
            f"{len(refused)} of {there} pictures of the capture are not used, but what its splats show: {refused[0]}"
        )
    return tuple(views)


def _as_photographed(view: SplatLayer, picture: F32) -> SplatLayer:
    """The view in the colours of a picture (H, W, 4), brought to the splats' exposure; what does not count in it shows
    nothing. Raises ValueError: it shows something else."""
    alpha = 1 - view.transmittance
    shown = np.maximum(view.color / np.maximum(alpha, 1e-6)[..., None], 0)
    own = shown if view.linear else colour.srgb_decode(shown)
    light, theirs = colour.luminance(picture[..., :3]), colour.luminance(own)
    white = float(colour.srgb_decode(_WHITE))
    clipped = picture[..., :3].max(axis=2) > white
    counts = picture[..., 3] > _COUNTS
    told = counts & ~clipped & (alpha > _OPAQUE) & (own.max(axis=2) < white) & (light > 0) & (theirs > 0)
    gain = 1.0
    if np.count_nonzero(told) >= _FEWEST:
        ratio = np.log(light[told] / theirs[told])
        bright = theirs[told] > np.quantile(theirs[told], _BRIGHT)
        exposure = float(np.median(ratio[bright]))
        if float(np.median(np.abs(ratio[bright] - exposure))) > _UNLIKE:
            raise ValueError("shows something else than the splats do from there")
        gain = float(np.exp(-exposure)) if abs(exposure) > _SAME else 1.0
    if gain < 1:
        counts = counts & ~clipped
    rgb = np.where(clipped[..., None], picture[..., :3], np.minimum(picture[..., :3] * gain, 1))
    there = np.where(counts, alpha, 0)
    return replace(
        view,
        color=np.asarray((rgb if view.linear else colour.srgb_encode(rgb)) * there[..., None], np.float32),
        transmittance=np.asarray(1 - there, np.float32),
        diffuse=None,
    )
