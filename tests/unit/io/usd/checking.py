"""What USD's own checker (usdchecker's validators) says of a stage."""

from __future__ import annotations

from pathlib import Path


def faults(path: Path) -> list[str]:
    """A line for each; empty where all is sound."""
    from pxr import Usd, UsdValidation

    checks = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    return [one.GetMessage() for one in checks.Validate(Usd.Stage.Open(str(path)))]
