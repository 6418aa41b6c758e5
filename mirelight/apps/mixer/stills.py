"""Stills: the view rendered as `mirelight render` does it, under coarse light first, then samples as they come."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from mirelight.base.png import png_bytes
from mirelight.base.progress import CountProgress
from mirelight.batch.preview import quick_scene
from mirelight.io.png import encode_display
from mirelight.model import Camera, Frame, Job, LayerFactor, Lighting
from mirelight.pipeline import stages
from mirelight.pipeline.artefact_cache import MemoryCache
from mirelight.pipeline.scene import Scene, prepare

_MEMORY = 512 * 2**20  # bytes of light that other mixes of the same view are made from
_COARSE = 0.25  # pixels of the quick picture's light for each of the splats' own, along each axis
_EVERY = 2.0  # seconds between two pictures of samples so far, at least
_SHARE = 20  # and so many times what making one takes


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The view that a still is asked for."""

    number: int  # the page's own
    camera: Camera
    lighting: str | None  # name; None: as captured
    factors: tuple[LayerFactor, ...]  # of its layers, in place of the job's
    exposure: float  # stops


@dataclass(frozen=True, slots=True, eq=False)
class Still:
    """What there is of it."""

    number: int  # of the view
    done: float  # share of the samples
    state: str  # waiting, tracing, done
    png: bytes = b""
    version: int = 0  # of the picture


class Stills:
    """Renders stills of a view.

    Args:
        scene: the prepared job; what it has ready is shared.
        job: gives the job with its lights where they are now.
    """

    def __init__(self, scene: Scene, job: Callable[[], Job]) -> None:
        self._job = job
        output = replace(scene.job.output, exr=False, png=True, store="both")  # nothing but the picture
        plain = replace(scene.job, output=output)
        self._scene = prepare(plain, MemoryCache(scene.kept, _MEMORY), like=scene.ready(lit=True))
        coarse = replace(plain.relight, texture_scale=min(plain.relight.texture_scale, _COARSE))
        self._quick = quick_scene(prepare(replace(plain, relight=coarse), self._scene.kept, like=self._scene))

    def make(self, view: View, show: Callable[[bytes, bool], None], progress: CountProgress) -> None:
        """A still of a view.

        Args:
            view: what is asked for.
            show: called with a PNG file, and whether it is the whole still; the pictures before it have few samples.
            progress: called with samples done and in all; what it raises ends the work.
        """
        lighting = self._lighting(view)
        if lighting is None:
            show(self._png(stages.frame(self._scene, view.camera, None), view), True)
            return
        splats = stages.composite(self._scene, view.camera)
        quick = stages.light(self._quick, view.camera, lighting)
        show(self._png(stages.relit(self._quick, splats, quick, unfinished=True), view), False)
        progress(0, 1)
        due = time.monotonic() + _EVERY

        def look(so_far: Callable[[], stages.Lit]) -> None:
            nonlocal due
            began = time.monotonic()
            if began >= due:
                show(self._png(stages.relit(self._scene, splats, so_far(), unfinished=True), view), False)
                ended = time.monotonic()
                due = ended + max(_EVERY, _SHARE * (ended - began))

        lit = stages.light(self._scene, view.camera, lighting, progress=progress, look=look)
        show(self._png(stages.relight(self._scene, splats, lit), view), True)

    def _lighting(self, view: View) -> Lighting | None:
        """The view's light, with lamps where they are now."""
        found = next((x for x in self._job().lightings if x.name == view.lighting), None)
        return None if found is None else replace(found, mix=view.factors)

    def _png(self, frame: Frame, view: View) -> bytes:
        display = replace(self._scene.job.display, exposure=view.exposure)
        whole = frame.splats is not None and frame.splats.linear
        return png_bytes(encode_display(frame.rgba, display, frame.profile, whole=whole, behind=frame.background), {})
