"""Fewer triangles: edges collapsed by quadric error (Garland and Heckbert, 1997), by the package pyfqmr."""

from __future__ import annotations

import numpy as np

from mirelight import extras
from mirelight.proxy.tidy import compact
from mirelight.proxy.types import Soup


def decimated(soup: Soup, most: int) -> Soup:
    """About `most` triangles, or the mesh itself where it has no more. Rims stay where they are.

    Raises:
        BackendError: pyfqmr is not installed.
    """
    if len(soup.faces) <= most:
        return soup
    try:
        import pyfqmr
    except ImportError:
        raise extras.needed("proxy") from None
    simplifier = pyfqmr.Simplify()
    simplifier.setMesh(soup.vertices, soup.faces.astype(np.int32))
    simplifier.simplify_mesh(target_count=most, aggressiveness=4, preserve_border=True, verbose=False)
    vertices, faces, _ = simplifier.getMesh()
    return compact(Soup(np.asarray(vertices, np.float64), np.asarray(faces, np.int64)))
