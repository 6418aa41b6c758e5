"""The recorded session of docs/tutorials/first-capture.md.

Runs its commands on the shipped stage's splats alone, writes what they say into the page, without durations, and the
picture that comes out beside the gallery's.

    python scripts/session.py

Works in out/session, where nothing lies beside the capture, as with one that somebody downloaded. Takes some minutes: a
proxy mesh is made.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from page_pictures import ROOT, picture, written

from mirelight.io.atomic import atomic_path

PAGE = ROOT / "docs" / "tutorials" / "first-capture.md"
PICTURE = ROOT / "docs" / "gallery" / "first.jpg"
CAPTURE = ROOT / "scenes" / "stage" / "splats.compressed.ply"
COMMANDS = (
    "mirelight new stage.compressed.ply -o first.toml",
    "mirelight inspect first.toml",
    "mirelight render first.toml --set render.spp=16 --set display.exposure=0.5",
)
BEGIN, END = "<!-- recorded by scripts/session.py -->\n", "<!-- end of the recording -->\n"


def said(command: str, folder: Path) -> str:
    """What a command prints, both streams in their order, without the folder's own path."""
    program = [sys.executable, "-m", "mirelight", *shlex.split(command)[1:]]
    done = subprocess.run(program, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=True)
    return re.sub(r"(made in|frame in out;) .*", r"\1 …", done.stdout.replace(f"{folder}/", ""))


def with_session(page: str, session: str) -> str:
    """The page with the session between its marks."""
    before, _, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        raise ValueError(f"{PAGE.name} lost its marks: {BEGIN.strip()} … {END.strip()}")
    return f"{before}{BEGIN}\n```\n{session}```\n\n{end}{after}"


def main() -> int:
    folder = ROOT / "out" / "session"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    shutil.copy(CAPTURE, folder / "stage.compressed.ply")
    session = ""
    for command in COMMANDS:
        text = re.sub(r"[ \t]+$", "", said(command, folder), flags=re.MULTILINE)
        session += f"$ {command}\n{text}\n"
        print(f"$ {command}\n{text}", flush=True)
    written(picture(folder / "out" / "first.sun.png"), PICTURE)
    page = with_session(PAGE.read_text(encoding="utf-8"), session.rstrip("\n") + "\n")
    with atomic_path(PAGE) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
