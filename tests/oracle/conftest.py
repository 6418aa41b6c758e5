"""What all of these tests share."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from .shelf import SHIPPED


@pytest.fixture(scope="session", autouse=True)
def _shelf(tmp_path_factory: pytest.TempPathFactory) -> None:
    """What one process finds of the shipped scenes, those beside it take."""
    own = tmp_path_factory.getbasetemp()
    SHIPPED.folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "shelf"


@pytest.fixture(scope="module")
def toys() -> Iterator[None]:
    """Estimates are cut down for toys."""
    from .toy_estimate import of_toys

    with pytest.MonkeyPatch.context() as patch:
        of_toys(patch)
        yield
