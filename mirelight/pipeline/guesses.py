"""Where a capture without cameras was taken from: guessed once in the splats' own axes, and kept for all that is made
of it, wherever jobs place it: its proxy, its colours, the light that it was captured in, its first picture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

from mirelight.model import Camera, Deferred, OwnSplats, SplatCloud, SplatFile, digest
from mirelight.pipeline.cache import UserCache
from mirelight.pipeline.codecs import Codec, cameras_named
from mirelight.pipeline.scene_keys import device
from mirelight.proxy import ProxySettings
from mirelight.proxy.guessed import NAME, taken_from
from mirelight.proxy.views import placed

Cameras: TypeAlias = tuple[Camera, ...]
Find: TypeAlias = Callable[[str, Codec[Cameras]], Cameras | None]
Keep: TypeAlias = Callable[[str, Cameras, Codec[Cameras]], None]


def guessed(own: OwnSplats, settings: ProxySettings, find: Find, keep: Keep) -> Cameras:
    """Cameras in world space; none where splats do not tell.

    Args:
        own: the splats.
        settings: of these the variant and its threads.
        find: gives what is kept under a key.
        keep: keeps it.
    """
    key, codec = digest("guess", own.splats.digest, device(settings.variant)), cameras_named(NAME)
    found = find(key, codec)
    if found is None:
        found = taken_from(own.splats.value, settings)
        keep(key, found, codec)
    return tuple(placed(camera, own.world_from_own) for camera in found)


def guessed_of_file(path: Path, read: Callable[[], SplatCloud]) -> Cameras:
    """:func:`guessed` of a splat file, in its own axes, kept where jobs of it find it.

    Args:
        path: the file.
        read: gives the splats as it has them, where nothing is kept.
    """
    from mirelight.io.job.hashing import digest as digest_of_file
    from mirelight.io.job.hashing import digest_of_splats

    known = digest_of_splats([(digest_of_file(path), SplatFile(path=path))])
    kept = UserCache()
    return guessed(OwnSplats.of_world(Deferred(known, read)), ProxySettings(), kept.get, kept.put)
