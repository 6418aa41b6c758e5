"""The light mixer: a capture with one layer of path-traced light for each of its lights, mixed live in a browser."""

from mirelight.mixing.bundle import Exported, export
from mirelight.mixing.layers import Fader, Mixed, MixLayers, make

__all__ = ["Exported", "Fader", "MixLayers", "Mixed", "export", "make"]
