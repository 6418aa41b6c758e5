"""Many processes on one job: worker processes, shards, batch systems and a Dask scheduler.

Whoever makes frames gets the same :class:`~mirelight.batch.order.Order`, plans it by himself, and makes the missing
frames of one camera after the other with `mirelight.batch.executor.attempt`. Nothing large is sent: the folder that
all of them share is where frames come together.
"""

from __future__ import annotations

from mirelight.batch.order import Order, Shard

__all__ = ["Order", "Shard"]
