"""Stages are read by children that are forked."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.usd_readers import fork_readers


@pytest.fixture(scope="session", autouse=True)
def _readers() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        readers = fork_readers(patch)
        yield
        readers.close()
