"""Signals wait for the end of a step, unless they come twice; what came of one is known as one."""

from __future__ import annotations

import gc
import os
import signal
from types import FrameType

import pytest

from mirelight.cli import main
from mirelight.cli.progress import Tally
from mirelight.cli.stop import Watched, exit_code


class Noted(Tally):
    """Remembers that it was told to stop."""

    told = False

    def stopping(self) -> None:
        self.told = True


@pytest.mark.parametrize(("number", "error"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)])
def test_the_first_signal_waits_for_the_next_call(number: signal.Signals, error: type[BaseException]) -> None:
    tally = Noted()
    before = signal.getsignal(number)
    reached = False
    with pytest.raises(error), Watched(tally) as watched:
        watched.started([])
        os.kill(os.getpid(), number)
        reached = True
        watched.started([])
    assert reached and tally.told
    assert signal.getsignal(number) is before


def test_a_signal_ends_what_all_frames_share_between_two_steps() -> None:
    reached = False
    with pytest.raises(KeyboardInterrupt), Watched(Tally()) as watched:
        watched.making("taking depth maps", 0.1)
        os.kill(os.getpid(), signal.SIGINT)
        reached = True
        watched.making("taking depth maps", 0.2)
    assert reached


def test_the_second_signal_does_not_wait() -> None:
    reached = False
    with pytest.raises(KeyboardInterrupt), Watched(Tally()):
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        reached = True
    assert not reached


def test_an_interrupt_behind_another_error_is_one() -> None:
    def wrapped(first: BaseException) -> BaseException:
        try:
            try:
                raise first
            except BaseException as e:
                raise RuntimeError("the kernel could not be recorded") from e
        except RuntimeError as e:
            return e

    assert exit_code(wrapped(KeyboardInterrupt())) == 130
    assert exit_code(wrapped(SystemExit(143))) == 143
    assert exit_code(wrapped(ValueError())) is None


def test_a_command_called_from_python_leaves_the_process_as_it_was(capsys: pytest.CaptureFixture[str]) -> None:
    def own(number: int, frame: FrameType | None) -> None:
        raise AssertionError

    before, thresholds = signal.signal(signal.SIGTERM, own), gc.get_threshold()
    try:
        assert main(["schema"]) == 0
        assert main(["inspect", "no-such.toml"]) == 2
        assert signal.getsignal(signal.SIGTERM) is own
        assert gc.get_threshold() == thresholds
    finally:
        signal.signal(signal.SIGTERM, before)
