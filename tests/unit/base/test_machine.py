"""Free memory by the system's and the control group's word, and work that signals wait for."""

from __future__ import annotations

import signal
import threading
from pathlib import Path

import pytest

from mirelight.base import machine
from mirelight.base.machine import memory, uninterrupted


def groups(folder: Path, monkeypatch: pytest.MonkeyPatch, files: dict[str, str]) -> None:
    """A control group of these files."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(machine, "_GROUPS", folder)


def test_memory_without_a_control_group_is_the_machine_s(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    groups(tmp_path, monkeypatch, {})
    found = memory()
    assert found.limit is None and 0 < found.free <= found.total < 1 << 50


@pytest.mark.parametrize(
    "names", [("memory.max", "memory.current", "memory.stat"), ("limit_in_bytes", "usage_in_bytes", "stat")]
)
def test_the_control_group_s_limit_counts_and_cached_files_give_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: tuple[str, str, str]
) -> None:
    prefix, word = ("", "") if names[0] == "memory.max" else ("memory/memory.", "total_")
    values = "50000000", "40000000", f"anon 1\n{word}inactive_file 1000000\n"
    groups(tmp_path, monkeypatch, {prefix + n: v for n, v in zip(names, values, strict=True)})
    found = memory()
    assert found.limit == 50_000_000 and found.free == 11_000_000


def test_a_control_group_without_a_limit_takes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    groups(tmp_path, monkeypatch, {"memory.max": "max\n", "memory.current": "1", "memory.stat": "inactive_file 0"})
    assert memory().limit is None


def test_a_signal_waits_for_the_end_of_the_block() -> None:
    done = False
    with pytest.raises(KeyboardInterrupt), uninterrupted():
        signal.raise_signal(signal.SIGINT)
        done = True
    assert done
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_other_threads_hold_nothing_back() -> None:
    seen = []

    def work() -> None:
        with uninterrupted():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]
