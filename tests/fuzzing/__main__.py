"""Throws seeded hostile input at every command and format, and says what became of it.

    python -m tests.fuzzing --n 1000 [--seed 1] [--json FILE] [--only TEXT] [--show]

Exit code 1 where a case ends in anything but success or a clear refusal: a traceback, a crash, a hang, gigabytes, a
file outside its folder, a frame that is silently NaN or black, control characters on the terminal, noise, or a message
that names nothing. Linux only (memory is read from /proc).
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from tests.fuzzing.campaign import BAD, run
from tests.fuzzing.cases import cases


def main() -> int:
    """Run the campaign; a line for each bad case, and a table."""
    parser = argparse.ArgumentParser(description="A seeded campaign of hostile input.")
    parser.add_argument("--n", type=int, default=1000, help="cases (1000)")
    parser.add_argument("--seed", type=int, default=1, help="other cases of the same kinds (1)")
    parser.add_argument("--json", metavar="FILE", help="write every verdict")
    parser.add_argument("--only", metavar="TEXT", default="", help="only cases whose name holds this")
    parser.add_argument("--show", action="store_true", help="print every verdict")
    args = parser.parse_args()
    verdicts = []
    for verdict in run(x for x in cases(args.n, args.seed) if args.only in x.name):
        verdicts.append(verdict)
        if args.show or verdict.kind in BAD:
            told = verdict.detail.strip().splitlines() or [""]
            cost = f"{verdict.seconds:5.1f} s {verdict.memory >> 20:5} MiB"
            print(f"{verdict.kind:<10} {verdict.case:<50} {cost}  {told[-1][:200]}", flush=True)
    counts = Counter(x.kind for x in verdicts)
    print(", ".join(f"{count} {kind}" for kind, count in counts.most_common()) + f"; {len(verdicts)} cases")
    if args.json:
        Path(args.json).write_text(json.dumps([asdict(x) for x in verdicts], indent=1) + "\n", encoding="utf-8")
    return int(any(x.kind in BAD for x in verdicts))


if __name__ == "__main__":
    sys.exit(main())
