"""What pages wait for: a version that counts up, and the lock of all that they are told."""

from __future__ import annotations

import threading
import time


class News(threading.Condition):
    """A lock with a version; pages wait for a newer one than theirs."""

    def __init__(self) -> None:
        super().__init__()
        self.version = 0

    def changed(self) -> None:
        """There is something new."""
        with self:
            self.version += 1
            self.notify_all()

    def await_newer(self, after: int, seconds: float) -> None:
        """Wait, with the lock held, until the version is newer, or so many seconds have gone."""
        end = time.monotonic() + seconds
        while self.version <= after and (left := end - time.monotonic()) > 0:
            self.wait(left)
