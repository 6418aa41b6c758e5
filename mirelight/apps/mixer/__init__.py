"""The light mixer: a capture with one layer of path-traced light for each of its lights, mixed live in a browser."""

from mirelight.apps.mixer.bundle import Exported, export
from mirelight.apps.mixer.layers import Fader, Mixed, MixLayers, make

__all__ = ["Exported", "Fader", "MixLayers", "Mixed", "export", "make"]
