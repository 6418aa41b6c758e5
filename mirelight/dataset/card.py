"""The page of a data set: what there is, and how to load it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mirelight.dataset import contact
from mirelight.dataset.layouts import WRITERS, Files, Shared
from mirelight.dataset.layouts.pictures import Part
from mirelight.dataset.view import DataSet
from mirelight.model import DatasetSettings, Layout

_SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))


@dataclass(frozen=True, slots=True)
class Facts:
    """Counts of a data set, for its README."""

    cameras: int
    lightings: tuple[str, ...]  # file names
    training: str  # the one to train on where a loader takes one
    parts: Mapping[Part, int]  # frames


def write(files: Files, data: DataSet, layout: Layout, settings: DatasetSettings, facts: Facts, shared: Shared) -> None:
    """README.md. Raises OutputError: it cannot be written."""
    files.text("README.md", _text(data, layout, settings, facts, shared))


def _text(data: DataSet, layout: Layout, settings: DatasetSettings, facts: Facts, shared: Shared) -> str:
    display = data.index.display
    count = facts.cameras * len(facts.lightings)
    listed = ", ".join(facts.lightings[:8]) + (", …" if len(facts.lightings) > 8 else "")
    size = next((name for most, name in _SIZES if count < most), "n>1M")
    loading = WRITERS[layout].loading.replace("{lighting}", facts.training).replace("{set}", shared.name)
    near, far = shared.near_far or (0.0, 0.0)
    notes = WRITERS[layout].notes.format(lighting=facts.training, near=near, far=far)
    tone = "" if display.tone == "none" else f", tone curve {display.tone}"
    encoding = "sRGB" if display.view is None else f"view {display.view.view!r} on {display.view.display!r}"
    range_of = ""
    if shared.near_far is not None:
        range_of = f" Cameras see depths from {shared.near_far[0]:.3g} to {shared.near_far[1]:.3g}."
    head = [
        f"license: {settings.license}" if settings.license else "",
        f"pretty_name: {shared.name}",
        f"size_categories: [{size}]",
        f"tags: [relighting, {layout}]",
        *WRITERS[layout].configs(facts.parts),
    ]
    front = "\n".join(line for line in head if line)
    return f"""---
{front}
---

# {Path(data.index.job).stem}

{count} frames: {facts.cameras} cameras under {len(facts.lightings)} lightings ({listed}), layout `{layout}`.
License: {settings.license or "none given"}.

![Cameras by lightings, evenly chosen, exposure {display.exposure:g} stops]({contact.FILE})

- Pictures: PNG, 8-bit {encoding}, exposure {display.exposure:g} stops for all{tone}. Linear pictures, where there are
  any, hold the scene's own light, without that exposure.
{_split(settings, facts)}
- World: Z up, {shared.scale:.6g} times the job's lengths.{range_of} `lights.json` has the lights in it.
{notes}
```python
{loading}
```
"""


def _split(settings: DatasetSettings, facts: Facts) -> str:
    """What is held out, in a sentence."""
    if facts.parts["seen"] == sum(facts.parts.values()):
        return "- All frames are to train on: none is held out."
    parts = ", ".join(f"{name} {number}" for name, number in facts.parts.items())
    return (
        f"- Frames by what was seen in training: {parts}.\n"
        f"  {settings.held_out:g} of the names of {_HELD[settings.split]} are held out, by a hash with seed "
        f"{settings.seed};\n  `splits.json` has the list."
    )


_HELD = {"camera": "cameras", "lighting": "lightings", "both": "cameras and of lightings"}
