"""Where a capture was taken from is guessed once for all tests of the same splats, in whatever process: it takes most
of what a first job and the proxy of a toy cost."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

from mirelight.model import Camera, SplatCloud, digest
from mirelight.pipeline.codecs import cameras_named
from mirelight.proxy import ProxySettings
from mirelight.proxy.guessed import NAME, taken_from

from .oracle.shelf import Shelf

WHO_ASK = ("proxy.make", "proxy.capture_views", "apps.first_job.view", "pipeline.guesses")


def guess_once(patch: pytest.MonkeyPatch, folder: Path) -> None:
    """While patched, guesses are kept in a folder. `mirelight.proxy.guessed` itself, which is tested, guesses anew."""
    guessing = importlib.import_module("mirelight.proxy.guessed")
    shelf, codec = Shelf(), cameras_named(NAME)
    shelf.folder = folder

    def kept(splats: SplatCloud, settings: ProxySettings) -> tuple[Camera, ...]:
        key = digest("guess", splats, settings.variant, settings.threads, guessing.TUNING)
        found = shelf.get(key, codec)
        if found is None:
            found = taken_from(splats, settings)
            shelf.put(key, found, codec)
        return found

    for name in WHO_ASK:
        patch.setattr(importlib.import_module(f"mirelight.{name}"), "taken_from", kept)
