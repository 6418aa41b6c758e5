"""Fixtures that every test folder may use."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import pytest

from tests.guesses import guess_once
from tests.threads import BESIDE, share_cores

ROOT = Path(__file__).resolve().parents[1]


def pytest_configure() -> None:
    """Ctrl-C as Python has it: a shell that runs the tests in the background has it ignored. And bytecode is kept: else
    each of the hundreds of processes that tests start compiles the package."""
    if BESIDE > 1:  # for what each process starts, too
        os.environ.setdefault("OPENBLAS_NUM_THREADS", str(max((os.cpu_count() or 1) // BESIDE, 1)))
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def _share_of_the_cores() -> Iterator[None]:
    """Of several processes that run tests, each begins with its own cores' worth of threads."""
    with pytest.MonkeyPatch.context() as patch:
        share_cores(patch)
        yield


@pytest.fixture(scope="session", autouse=True)
def _cache_of_all() -> Iterator[None]:
    """What is made for every command goes to a folder of the tests, also by fixtures that many share."""
    with tempfile.TemporaryDirectory(prefix="mirelight-cache-") as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("MIRELIGHT_CACHE_DIR", folder)
        yield


@pytest.fixture(scope="session", autouse=True)
def _guesses_of_all(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Where the same splats were taken from is guessed once, by whichever process is first."""
    own = tmp_path_factory.getbasetemp()
    with pytest.MonkeyPatch.context() as patch:
        guess_once(patch, (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "guesses")
        yield


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Each test's own folder of what is made for every command; empty, and not there yet."""
    folder = tmp_path_factory.getbasetemp() / "caches" / uuid4().hex
    monkeypatch.setenv("MIRELIGHT_CACHE_DIR", str(folder))
    return folder


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
