"""What all of these tests share."""

from __future__ import annotations

import os

import pytest

from .shelf import SHIPPED


@pytest.fixture(scope="session", autouse=True)
def _shelf(tmp_path_factory: pytest.TempPathFactory) -> None:
    """What one process finds of the shipped scenes, those beside it take."""
    own = tmp_path_factory.getbasetemp()
    SHIPPED.folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "shelf"
