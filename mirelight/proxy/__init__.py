"""Proxy meshes from splats alone, and how well a mesh fits its splats. docs/guides/proxy.md has what was measured."""

from __future__ import annotations

from mirelight.proxy.judge import judge
from mirelight.proxy.make import make
from mirelight.proxy.recipe import mesh_of
from mirelight.proxy.register import register
from mirelight.proxy.types import MadeProxy, ProxyQuality, ProxySettings

__all__ = ["MadeProxy", "ProxyQuality", "ProxySettings", "judge", "make", "mesh_of", "register"]
