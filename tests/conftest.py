"""Fixtures that every test folder may use."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def pytest_configure() -> None:
    """Ctrl-C as Python has it: a shell that runs the tests in the background has it ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def shared() -> Path:
    """The optional sibling folder with the engine's frames; a clone without it skips what reads it."""
    folder = ROOT.parent / "shared"
    if not (folder / "realtime").is_dir():
        pytest.skip("the reference frames are not beside this clone (../shared)")
    return folder


@pytest.fixture(scope="session")
def data() -> Path:
    """tests/data: small inputs and references that are part of the project."""
    return ROOT / "tests" / "data"
