"""Exit codes of every command."""

from __future__ import annotations

DONE = 0
FOUND = 1  # what was looked at is not as it should be
BAD = 2  # expected trouble: bad input, no backend, a full disk
RUNNING = 3  # somebody is at work
INTERRUPTED = 130  # 128 + SIGINT, as shells have it
TERMINATED = 143  # 128 + SIGTERM

EVERY = (
    "Exit codes: 0 done; 1 not as it should be (compare: a requirement is unmet; status: frames are missing; verify: "
    "something is wrong); 2 bad input or no way to go on (one line says why); 3 status: somebody is at work; "
    "130 interrupted; 143 ended by SIGTERM."
)
