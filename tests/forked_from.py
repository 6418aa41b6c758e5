"""What the process holds that `tests.forked` forks commands from: modules, and Mitsuba with its variant.

No kernel has run there, so Dr.Jit's pool has no threads yet: each child starts its own. The one thread that Dr.Jit
starts with its import hands back NumPy arrays that the pool is done with; children do without it and keep those arrays
until they end, which has to be by `os._exit`, as multiprocessing ends them: `exit` waits for that thread.
"""

from __future__ import annotations

import gc
from importlib import import_module
from pkgutil import walk_packages

from mirelight import compositor, io, lighting, pipeline, proxy, relighting
from mirelight.base import backend

backend.mitsuba()
for room in (compositor, io, lighting, pipeline, proxy, relighting):
    for found in walk_packages(room.__path__, f"{room.__name__}."):
        import_module(found.name)
OTHERS = ("mirelight.apps.inspect.inspect", "mirelight.cli.render", "OpenEXR", "scipy.ndimage", "scipy.spatial")
for name in (*OTHERS, "tests.forked"):
    import_module(name)
gc.freeze()  # what is here is no child's garbage: it is not looked through there, nor copied for that
