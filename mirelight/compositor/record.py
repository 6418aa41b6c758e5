"""What later stages read of a projected splat: 16 floats, a cache line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight.compositor.device import Array

RECORD = 16  # floats; 64 bytes, a cache line
VALUE_ROW = 8  # floats a splat that can be blended beside its colour; a whole packet
# A record's slots. With (dx, dy) the offset from the centre in px and u = S11 dx + S12 dy, v = S22 dy, a fragment's
# alpha is SCALE 2^e - OFFSET with OCTAVE e = REACH - u² - v². It is clipped where e <= 0: a record of zeros always is.
# EDGE is that of a half quad (see `engine`), and 0 for whole splats.
X, Y, S11, S12, S22, REACH, RED, GREEN, BLUE, DEPTH, SCALE, OFFSET, HALF_HEIGHT, TURN, EDGE_X, EDGE_Y = range(16)

HALF_LOG2E = float(0.5 / np.log(2))  # exp(-½ d²) = 2^(-HALF_LOG2E d²)
OCTAVE = 2.0**23  # exponents count steps of a float's bits: adding OCTAVE to the bits doubles the number
SLACK = 1e-3  # px, added to footprints so that rounding drops no fragment that the blend would keep


@dataclass(frozen=True, slots=True, eq=False)
class Covariance:
    """Projected covariances with the low-pass, px², y down."""

    xx: Array
    xy: Array
    yy: Array
    determinant: Array
    share: Array  # determinant without the low-pass over that with it
