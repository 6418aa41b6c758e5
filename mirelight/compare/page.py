"""What the self-contained HTML reports share: the files they carry inside, and how a page begins."""

from __future__ import annotations

from importlib.resources import files

# Nothing is loaded from outside: a report must open from disk, and must not tell anyone that it was opened.
HEAD = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'">
<title>{title}</title>
<style>{slider_css}</style>
<style>{css}</style>
"""


def static(name: str) -> str:
    """The text of a file under `compare/static`."""
    return files("mirelight.compare").joinpath("static", name).read_text(encoding="utf-8").strip()
