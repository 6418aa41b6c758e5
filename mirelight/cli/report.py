"""The facts of a file, and what a look at a job found, as text and JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from mirelight.apps.inspect.facts import (
    Bounds,
    CameraFacts,
    Facts,
    JobFacts,
    LightFacts,
    LightingFacts,
    MeshFacts,
    ObjectFacts,
    PictureFacts,
    SplatFacts,
)
from mirelight.base.errors import printable

if TYPE_CHECKING:
    from mirelight.pipeline.job_diagnostics import Check
    from mirelight.proxy import ProxyQuality

_MOST = 20  # lights or cameras that are listed


def lines(facts: Facts) -> Iterator[str]:
    """The facts as text, a line each."""
    yield printable(facts.path)
    match facts:
        case SplatFacts():
            rows = _splats(facts)
        case MeshFacts():
            rows = _mesh(facts)
        case PictureFacts():
            rows = _picture(facts)
        case JobFacts():
            rows = _job(facts)
    for name, value in rows:
        yield f"  {name:<12} {printable(value)}"


def fit_lines(found: Check) -> Iterator[str]:
    """How the proxy of a job fits its splats, and what is wrong, a line each."""
    quality = found.quality
    if quality is not None:
        looked = quality.views
        through = f"{looked} of {found.cameras} cameras" if looked < found.cameras else f"its {found.cameras} cameras"
        yield (
            f"  fit          through {through if found.cameras > 1 else 'its camera'}: the proxy leaves "
            f"{quality.uncovered:.1%} of the splats' pixels off (right ones up to 13 %)"
        )
        if quality.gap_median == quality.gap_median:
            share = quality.gap_median / quality.size
            yield f"               and lies {quality.gap_median:.3g} units from them, median ({share:.2%} of the size)"
        if quality.wavy == quality.wavy:
            yield f"               on large planes {quality.wavy:.1f}° off, median, and {quality.wavy_90:.1f}° at 90 %"
        if quality.pictures.apart == quality.pictures.apart:
            yield f"               {pictures_line(quality)}"
    for finding in found.findings:
        yield f"  ! {printable(str(finding))}"


def pictures_line(quality: ProxyQuality) -> str:
    """Where the capture's pictures agree."""
    apart, own = quality.pictures.apart / quality.size, quality.pictures.splats_apart / quality.size
    return f"pictures agree best {apart:.2%} of the size off it ({own:.2%} off the splats' own surface)"


def fit_json(found: Check) -> dict[str, object]:
    """The same as JSON values."""
    fit = None
    if found.quality is not None:
        views = [
            {"name": x.camera, "shown": x.shown, "uncovered": x.uncovered, "gap": x.gap_median}
            for x in found.quality.by_view
        ]
        fit = {**quality_json(found.quality), "cameras": views}
    findings = [{"kind": x.kind, "text": x.text, "remedy": x.remedy} for x in found.findings]
    return {"fit": fit, "findings": findings}


def quality_json(quality: ProxyQuality) -> dict[str, object]:
    """How well a mesh fits splats, as JSON values."""
    return {
        "uncovered": quality.uncovered,
        "gap": quality.gap_median,
        "gap_95": quality.gap_95,
        "size": quality.size,
        "leaks": quality.leaks,
        "waves": quality.wavy,
        "waves_90": quality.wavy_90,
        "pictures": asdict(quality.pictures),
    }


Rows = Iterator[tuple[str, str]]


def _splats(facts: SplatFacts) -> Rows:
    yield "kind", f"splats, {facts.format}"
    yield "splats", f"{facts.splats:,}{_dropped(facts)}"
    yield "SH degree", f"{facts.sh_degree}"
    if facts.color_space != "srgb_rec709_display":
        yield "colours", f"{facts.color_space} (what splats blend in)"
    if facts.antialiased:
        yield "trained", "antialiased (opacity compensation)"
    if facts.levels:
        yield "levels", ", ".join(f"{count:,.0f}" for count in facts.levels) + " splats, the finest first"
    yield from _box(facts.bounds)
    if facts.median_scale is not None and facts.mean_opacity is not None:
        yield "typical", f"scale {facts.median_scale:g} (median), opacity {facts.mean_opacity:.2f} (mean)"
    yield "memory", size(facts.memory)
    for note in facts.notes:
        yield "note", note


def _dropped(facts: SplatFacts | JobFacts) -> str:
    return f" ({facts.dropped:,} more with NaN, infinite or absurd values are left out)" if facts.dropped else ""


def _mesh(facts: MeshFacts) -> Rows:
    if facts.triangles or not (facts.lights or facts.cameras):
        yield from _triangles(facts)
    else:
        yield "kind", "lights and cameras without a mesh"
    yield from _many("light", [_light(x) for x in facts.lights])
    yield from _many("camera", [_camera(x) for x in facts.cameras])
    for note in facts.notes:
        yield "note", note


def _triangles(facts: MeshFacts) -> Rows:
    yield "kind", "mesh"
    yield "triangles", f"{facts.triangles:,} ({facts.vertices:,} vertices)"
    present = {"normals": facts.normals, "uvs": facts.uvs, "vertex colours": facts.vertex_colors}
    yield "has", ", ".join(name for name, there in present.items() if there) or "positions alone"
    if facts.materials:
        yield "materials", _listed(facts.materials)
    yield from _box(facts.bounds)
    yield "memory", size(facts.memory)


def _picture(facts: PictureFacts) -> Rows:
    yield "kind", "image"
    yield "size", f"{facts.width} x {facts.height} px"
    yield "channels", _listed(facts.channels)
    yield "colours", facts.color_space
    if facts.mean is not None and facts.brightest is not None:
        yield "linear", f"mean {_vector(facts.mean)}, brightest {facts.brightest:g}"
    if facts.not_finite:
        yield "!", f"{facts.not_finite:,} pixels are NaN or infinite: no environment as it is; repair it"
    yield "memory", size(facts.memory)
    if facts.fingerprint:
        yield "fingerprint", facts.fingerprint


def _job(facts: JobFacts) -> Rows:
    yield "kind", f"job, profile {facts.profile}, mode {facts.mode}"
    yield "inputs", _listed(facts.inputs)
    if facts.sh_degree is not None:
        yield "splats", f"{facts.splats:,}, SH degree {facts.sh_degree}{_dropped(facts)}"
    made = "made from the splats when something is rendered" if facts.proxy_to_make else "none"
    yield "proxy", f"{facts.triangles:,} triangles" if facts.triangles else made
    yield from _box(facts.bounds)
    for lighting in facts.lightings:
        yield from _lighting("lighting", lighting)
    if facts.captured is not None:
        yield from _lighting("captured", facts.captured)
    yield from _many("object", [_object(x) for x in facts.objects])
    yield from _many("camera", [_camera(x) for x in facts.cameras])
    yield "frames", f"{facts.frames}, written to {facts.output}"
    yield "memory", f"about {size(facts.memory)} while rendering"
    for note in facts.notes:
        yield "note", note


def _lighting(title: str, facts: LightingFacts) -> Rows:
    yield title, facts.name
    yield from _many("  light", [_light(x, unknown=facts.estimated) for x in facts.lights])
    if facts.estimated:
        yield "  sun and sky", "estimated from the splats when something is rendered"
    if facts.sky is not None:
        yield "  sun and sky", f"{facts.sky.elevation:g}° above the horizon, turbidity {facts.sky.turbidity:g}"
    if facts.environment is not None:
        sky = facts.environment
        what = "constant" if (sky.width, sky.height) == (1, 1) else f"{sky.width} x {sky.height} px"
        yield (
            "  sky",
            f"{what}, mean radiance {_vector(sky.mean)}, brightest {sky.brightest:g}, turned {sky.rotation:g}°",
        )


def _symbol(kind: str) -> str:
    """Of the unit of a light's intensity."""
    from mirelight.model.light_classes import kind_named

    known = kind_named(kind)
    return "" if known is None else known.unit.symbol


def _light(facts: LightFacts, *, unknown: bool = False) -> str:
    """`unknown`: how strong it is, is still to be found."""
    strength = [f"{facts.intensity:g} {_symbol(facts.type)}", f"color {_vector(facts.color)}"]
    parts = [f"{facts.name}: {facts.type}", *(["as strong as the splats tell"] if unknown else strength)]
    if facts.shape is not None and facts.size is not None:
        parts.insert(1, f"{facts.shape} {_vector(facts.size)}")
    parts[1:1] = [f"{x.name} {x.value:.4g}" for x in facts.own]
    if facts.position is not None:
        parts.append(f"at {_vector(facts.position)}")
    if facts.direction is not None:
        parts.append(f"along {_vector(facts.direction)}")
    if facts.outer_cone_angle is not None:
        law = "" if facts.cone is None else f" ({facts.cone})"
        parts.append(f"cone {facts.inner_cone_angle:g}° to {facts.outer_cone_angle:g}°{law}")
    if facts.ies is not None:
        parts.append(f"measured, {facts.ies:.4g} lm")
    if facts.angular_diameter is not None:
        parts.append(f"{facts.angular_diameter:g}° wide")
    parts += [f"{name} {value:g}" for name, value in (("range", facts.range), ("radius", facts.radius)) if value]
    return ", ".join([*parts, "animated"] if facts.animated else parts)


def _camera(facts: CameraFacts) -> str:
    parts = [f"{facts.name}: {facts.type}", f"at {_vector(facts.position)}"]
    parts += [f"yfov {facts.yfov:g}°"] if facts.yfov is not None else [f"ymag {facts.ymag:g}"]
    if facts.width is not None:
        parts.append(f"{facts.width} x {facts.height} px")
    if facts.aspect is not None:
        parts.append(f"aspect {facts.aspect:g}")
    if facts.exposure is not None:
        parts.append(facts.exposure)
    return ", ".join([*parts, "animated"] if facts.animated else parts)


def _object(facts: ObjectFacts) -> str:
    parts = [f"{facts.name}: {facts.triangles:,} triangles", *(row for _, row in _box(facts.bounds))]
    return ", ".join([*parts, "to be set down on the proxy"] if facts.to_drop else parts)


def _box(bounds: Bounds | None) -> Rows:
    if bounds is not None:
        yield "bounds", f"{_vector(bounds.low)} to {_vector(bounds.high)}"


def _many(name: str, entries: Sequence[str]) -> Rows:
    for entry in entries[:_MOST]:
        yield name, entry
    if len(entries) > _MOST:
        yield name, f"… and {len(entries) - _MOST} more"


def _listed(names: Sequence[str]) -> str:
    more = f", … ({len(names)} in all)" if len(names) > _MOST else ""
    return ", ".join(names[:_MOST]) + more


def _vector(values: Sequence[float]) -> str:
    return "(" + ", ".join(f"{v:.4g}" for v in values) + ")"


def size(count: int) -> str:
    """A number of bytes with its unit, for people."""
    value = float(count)
    for unit in ("B", "KiB", "MiB"):
        if value < 1024:
            return f"{value:.0f} {unit}" if unit == "B" else f"{value:.1f} {unit}"
        value /= 1024
    return f"{value:.2f} GiB"
