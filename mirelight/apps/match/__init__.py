"""Lights found from a picture: intensities and colours with which a job's frame comes closest to it."""

from __future__ import annotations

from mirelight.apps.match.fit import LayerMatch, Match, match
from mirelight.apps.match.target import Target, read_target

__all__ = ["LayerMatch", "Match", "Target", "match", "read_target"]
