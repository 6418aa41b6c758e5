"""Finds a sound libLLVM before Dr.Jit is imported, and is the only caller of `mi.set_variant`."""

from __future__ import annotations

from types import ModuleType

from mirelight.model import Variant


def prepare() -> None:
    """Choose the libLLVM that Dr.Jit will load; must run before Dr.Jit is imported. Idempotent."""


def mitsuba(variant: Variant = "llvm_ad_rgb", threads: int | None = None) -> ModuleType:
    """The `mitsuba` module with `variant` active."""
    prepare()
    import mitsuba as mi

    if mi.variant() != variant:
        mi.set_variant(variant)
    return mi  # type: ignore[no-any-return]


def drjit(variant: Variant = "llvm_ad_rgb", threads: int | None = None) -> tuple[ModuleType, ModuleType]:
    """The `drjit` module and its array types without derivatives: `drjit.llvm`, or `drjit.cuda` where asked."""
    prepare()
    import drjit as dr

    if variant == "cuda_ad_rgb":
        import drjit.cuda as types
    else:
        import drjit.llvm as types
    return dr, types
