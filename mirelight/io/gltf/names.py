"""Names for things that a job refers to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from mirelight.base.errors import printable
from mirelight.base.names import FreeNames


def unique_names(candidates: Sequence[tuple[str, ...]]) -> list[str]:
    """One name for each thing, all different.

    Each thing brings candidates, best first (its own name, its node's, its kind). It gets the first that no other
    thing shares; failing that its best one with a number: "lamp", "lamp 2", "lamp 3", in order. Characters that are not
    printable are escaped: the names go to terminals, files and layers.
    """
    candidates = [tuple(printable(name) for name in row) for row in candidates]
    chosen: list[str] = []
    shared = Counter(name for row in candidates for name in set(row) if name)
    free = FreeNames(separator=" ")
    for row in candidates:
        given = [name.strip() for name in row if name.strip()]
        chosen.append(free.take(next((x for x in given[:-1] if shared[x] == 1 and x not in free), given[0])))
    return chosen
