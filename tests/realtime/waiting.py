"""Waits for what a page shows: for conditions, as a busy machine keeps no time."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from playwright.sync_api import Locator, Page

LIMIT = 120_000  # milliseconds
PAUSE = 250


def settled(page: Page, what: Page | Locator, *, other_than: bytes = b"") -> bytes:
    """A PNG of `what`, once four pictures in a row are the same, and not `other_than`."""
    before, same = b"", 0
    for _ in range(LIMIT // PAUSE):
        page.wait_for_timeout(PAUSE)
        now: bytes = what.screenshot()
        same = same + 1 if now == before and now != other_than else 0
        before = now
        if same == 3:
            return now
    raise AssertionError("the picture never came to rest" if before != other_than else "the picture never changed")


def until(page: Page, holds: Callable[[], bool]) -> None:
    """Comes back once a condition holds, or after the limit: the test's own assertions tell what is missing."""
    for _ in range(LIMIT // PAUSE):
        if holds():
            return
        page.wait_for_timeout(PAUSE)
