"""What lights a proxy in each profile: paths in `physical`, the real-time engine's own light model in `playcanvas`."""

from __future__ import annotations

from mirelight.lighting.engine import EngineTracer
from mirelight.lighting.sunsky import resolved
from mirelight.lighting.trace import Tracer
from mirelight.model import Camera, Lighting, LightingBuffer, ProxyMesh, RenderSettings, rules_of


def tracer(
    proxy: ProxyMesh, settings: RenderSettings, *, layers: bool = True, aovs: bool = True
) -> Tracer | EngineTracer:
    """What lights a proxy in the settings' profile; arguments as for :class:`Tracer`.

    Raises:
        BackendError: the variant cannot be used on this machine.
    """
    if not rules_of(settings.profile).path_traced:
        return EngineTracer(proxy, settings, layers=layers)
    return Tracer(proxy, settings, layers=layers, aovs=aovs)


def trace(proxy: ProxyMesh, lighting: Lighting, camera: Camera, settings: RenderSettings) -> LightingBuffer:
    """Light a proxy once, by any lighting; what :func:`tracer` gives and :func:`finished` do the same for many frames
    of one proxy under lightings whose skies are resolved.

    Raises:
        BackendError: the variant cannot be used on this machine, or the denoiser is asked for and not installed.
        RenderError: the frame's film does not fit in memory.
    """
    made, cache = tracer(proxy, settings), None
    lighting = resolved(lighting, settings.variant)
    if isinstance(made, Tracer) and made.reads_surface:
        cache = made.fill(made.cells(), lighting)
    buffer = made.trace(lighting, camera, cache=cache) if isinstance(made, Tracer) else made.trace(lighting, camera)
    return finished(buffer, settings)


def finished(buffer: LightingBuffer, settings: RenderSettings, *, layers: bool = True) -> LightingBuffer:
    """A traced buffer, mixed or not, as it is shown: denoised where the settings ask for it, each layer or the sum.

    Raises:
        BackendError: the optional package `pyoidn` is not installed.
    """
    if not settings.denoise or not rules_of(settings.profile).path_traced:  # the engine's light has no noise
        return buffer
    from mirelight.lighting.denoise import denoise

    return denoise(buffer, layers=layers)
