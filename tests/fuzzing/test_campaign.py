"""Part of the campaign `python -m tests.fuzzing`: nothing is read but what it should be, and nothing ends but well."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from mirelight.cli import make_parser
from tests.fuzzing import campaign
from tests.fuzzing.campaign import BAD, run
from tests.fuzzing.case import of_files
from tests.fuzzing.cases import cases

QUICK = "inspect", "schema", "submit", "export", "status", "verify", "sheet", "film"
WITHOUT = {"doctor", "watch"}  # one takes nothing, the other ends when it is told to


def test_hostile_input_is_read_or_refused() -> None:
    """Of the first four hundred cases those of commands that trace nothing."""

    verdicts = list(run(case for case in cases(400) if case.arguments[0] in QUICK))
    assert len(verdicts) > 150
    assert [x for x in verdicts if x.kind in BAD] == []
    assert any(x.kind == "ok" for x in verdicts)


def test_every_command_has_cases() -> None:

    (commands,) = (x for x in make_parser()._actions if isinstance(x, argparse._SubParsersAction))
    assert {case.arguments[0] for case in cases(500)} == set(commands.choices) - WITHOUT


def test_the_judge_sees_what_it_looks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker that misbehaves in each way is found out."""

    def replies(answer: dict[str, object], out: bytes = b"", error: bytes = b"") -> str:
        def run(self: object, case: object, folder: Path, said: Path) -> tuple[dict[str, object], str, float, int]:
            (said / "stdout").write_bytes(out)
            (said / "stderr").write_bytes(error)
            return {"code": 0, "raised": "", "opened": [], **answer}, "", 0.0, 0

        monkeypatch.setattr(campaign.Worker, "run", run)
        (verdict,) = campaign.run([of_files("x", ("inspect", "a.ply"), {"a.ply": b"1"})])
        return verdict.kind

    assert replies({}) == "ok"
    assert replies({"code": 2}, error=b"mirelight: a.ply: bad\n") == "refused"
    assert replies({"code": 2}, error=b"mirelight: the system: bad\n") == "unclear"
    assert replies({"code": 2}) == "unclear"
    assert replies({"code": 2}, error=b"[1/2] a.ply: made\nmirelight: a: failed twice: KeyError: 1\n") == "unclear"
    assert replies({"code": 2}, error=b"a.ply: (EXR_ERR_CORRUPT) bad\nmirelight: a.ply: bad\n") == "unclear"
    assert replies({"code": 2}, error=b"usage: mirelight\nmirelight: a.ply: bad\n") == "unclear"
    assert replies({"raised": "KeyError"}) == "traceback"
    assert replies({"code": 1}) == "crash"
    assert replies({}, error=b"Traceback (most recent call last)\n") == "traceback"
    assert replies({}, error=b"x.py:1: RuntimeWarning: overflow\n") == "noisy"
    assert replies({}, out=b"\x1b[2J") == "control"
    assert replies({"opened": ["../outside/canary.png"]}) == "escape"
    assert replies({"opened": ["/etc/passwd"]}) == "escape"
    assert replies({"opened": ["a.ply", "/usr/lib/x.so"]}) == "ok"
