"""The path tracer's device code. Its modules import Mitsuba and Dr.Jit as they load, so only `mirelight.lighting.trace`
imports them, and only once `mirelight.base.backend` has activated a variant."""
