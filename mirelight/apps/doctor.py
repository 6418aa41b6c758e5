"""`mirelight doctor`: what this machine has, what mirelight uses of it, and whether a small render passes."""

from __future__ import annotations

import os
import platform
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import get_args

from mirelight.base import backend, extras
from mirelight.base.errors import BackendError
from mirelight.base.machine import cores, memory
from mirelight.base.version import __version__
from mirelight.model import Variant

_SECONDS = 300  # a cold kernel compile takes under one; a machine under load takes longer


@dataclass(frozen=True, slots=True)
class Findings:
    """What is found on this machine."""

    version: str
    python: str
    platform: str
    cores: str
    memory: str
    llvm: tuple[str, ...]  # a line for each library
    variants: dict[str, str | None]  # what is wrong with each; None: it renders
    tools: dict[str, str]  # of some commands, and where they are
    extras: dict[str, str]  # of the installation, and whether they are there

    @property
    def code(self) -> int:
        """Exit code: 0 where the default variant renders, else 2."""
        return 0 if self.variants["llvm_ad_rgb"] is None else 2

    def lines(self) -> Iterator[str]:
        """The findings as lines for people."""
        yield f"mirelight {self.version}, Python {self.python}, {self.platform}"
        yield f"cores   {self.cores}"
        yield f"memory  {self.memory}"
        yield from self.llvm
        for variant, problem in self.variants.items():
            yield f"{variant:<12} {'renders' if problem is None else problem}"
        for name, state in self.tools.items():
            yield f"{name:<12} {state}"
        for name, state in self.extras.items():
            yield f"extra {name:<8} {state}"


def look() -> Findings:
    """Look at the machine, and render something small by each variant, in processes of their own."""
    return Findings(
        version=__version__,
        python=platform.python_version(),
        platform=platform.platform(),
        cores=f"{cores()} usable of {os.cpu_count()}",
        memory=_memory(),
        llvm=tuple(_llvm()),
        variants={variant: _check(variant) for variant in get_args(Variant)},
        tools=dict(_optional()),
        extras=dict(_extras()),
    )


def _memory() -> str:
    found = memory()
    within = "" if found.limit is None else f", limited to {found.limit / 2**30:.1f} GiB by the control group"
    return f"{found.free / 2**30:.1f} GiB available of {found.total / 2**30:.1f} GiB{within}"


def _llvm() -> list[str]:
    found = backend.libraries()
    used = backend.choose()
    lines = []
    for library in found:
        mark = "used" if used and library.path == used.path else "    "
        lines.append(f"libLLVM {mark} {library.path} ({library.where}): {library.verdict}")
    if used is None:
        lines.append(f"libLLVM      none that is sound; to install it: {backend.install_command()}")
    return lines


def _check(variant: Variant) -> str | None:
    """Render in a child process, so that a bad library cannot take this one down; None where it passed."""
    command = [sys.executable, "-m", "mirelight.apps.doctor", variant]
    try:
        child = subprocess.run(command, capture_output=True, text=True, check=False, timeout=_SECONDS)
    except subprocess.TimeoutExpired:
        return f"FAILED: nothing after {_SECONDS} s"
    if child.returncode == 0:
        return None
    if child.returncode < 0:
        return f"FAILED: the process was ended by {signal.Signals(-child.returncode).name}"
    said = (child.stdout.strip() or child.stderr.strip() or "no message").splitlines()[-1]
    return f"not usable: {said}"


def small_render(variant: Variant) -> None:
    """A white sphere in a white furnace (whose mean must be 1) and one Dr.Jit kernel.

    Raises:
        BackendError: the variant cannot run, or its result is wrong.
    """
    mi = backend.mitsuba(variant)
    import numpy as np

    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": -1, "rr_depth": 1000},
            "light": {"type": "constant", "radiance": 1.0},
            "shape": {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}},
            "sensor": {
                "type": "perspective",
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 16, "height": 16},
            },
        }
    )
    mean = float(np.array(mi.render(scene, spp=16, seed=0))[..., :3].mean())
    if not abs(mean - 1) < 0.03:  # six standard errors
        raise BackendError(f"a furnace whose mean must be 1 has {mean:.4f}")
    dr, types = backend.drjit(variant)
    total = dr.sum(dr.sqrt(dr.arange(types.Float, 10001) * dr.arange(types.Float, 10001)))
    if abs(float(total[0]) - 50005000) > 500:
        raise BackendError(f"a sum that must be 50005000 is {float(total[0]):.0f}")


def _optional() -> list[tuple[str, str]]:
    """What only some commands need, and what it is for."""
    from mirelight.apps.realtime import browser, engine

    try:
        chromium = browser.find_browser()
    except BackendError as error:
        chromium = f"not usable: {error}"
    playcanvas = engine.installed()
    npm = shutil.which("npm")
    fetched = (
        "not fetched yet (mirelight realtime does it)"
        if npm
        else "not fetched, and npm is missing: apt-get install npm"
    )
    converter = shutil.which("splat-transform")
    return [
        ("Chromium", chromium),
        ("PlayCanvas", str(playcanvas) if playcanvas else fetched),
        ("splat-transform", converter or "not found (LCC): npm install -g @playcanvas/splat-transform"),
    ]


def _extras() -> Iterator[tuple[str, str]]:
    """Of each extra what it unlocks, and how to get it."""
    for extra in extras.EXTRAS:
        lacks = extras.missing(extra.name)
        state = f"missing ({', '.join(lacks)}): {extras.install(extra.name)}" if lacks else "installed"
        yield extra.name, f"{state}; for {extra.unlocks}"


def _child(variant: str) -> int:
    try:
        small_render(next(v for v in get_args(Variant) if v == variant))
    except BackendError as error:
        print(error)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(_child(sys.argv[1]))
