"""Planes that nearly stand at right angles, as what people build does, turned until they do.

Where a wall has mouldings, or lies nearer at its foot than above, a plane through all of it leans by a degree or two,
and every shadow on it and from it moves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirelight.model import F64
from mirelight.proxy.tuning import TUNING


def squared(normals: Sequence[F64]) -> list[F64]:
    """Unit normals (3,) of planes, the surest first, turned to right angles with surer ones, or along one, where they
    are within `plane_square` of that.

    The first planes that stand across each other are the axes, up to three; a plane between them stays as it is.
    """
    most = float(np.radians(TUNING.plane_square))
    axes, out = list[F64](), list[F64]()
    for normal in normals:
        along = [axis * np.sign(normal @ axis) for axis in axes if abs(normal @ axis) > np.cos(most)]
        across = [axis for axis in axes if abs(normal @ axis) < np.sin(most)]
        if along:
            turned = along[0]
        else:
            turned = normal - sum(((normal @ axis) * axis for axis in across), np.zeros(3))
            turned /= np.linalg.norm(turned)
            if len(across) == len(axes) < 3:
                axes.append(turned)
        out.append(turned)
    return out
