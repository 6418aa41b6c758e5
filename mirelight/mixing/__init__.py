"""The light mixer: one layer of path-traced light on the splats for each light of a job."""

from mirelight.mixing.layers import Fader, Mixed, MixLayers, check, make

__all__ = ["Fader", "MixLayers", "Mixed", "check", "make"]
