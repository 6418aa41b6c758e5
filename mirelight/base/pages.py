"""Where the documentation stands that messages, help and written jobs point to: what a wheel's user can open."""

from __future__ import annotations

SITE = "https://mirelight.github.io/mirelight"  # as in pyproject.toml; a test holds them together

# Pages by what they are about: files of docs/ without their ending, as the site has them.
PAGES = {
    "baking": "guides/bake",
    "cameras": "guides/cameras",
    "captured light": "guides/captured-light",
    "command line": "reference/command-line",
    "comparing": "guides/compare",
    "data sets": "guides/datasets",
    "explaining": "guides/explain",
    "farm": "guides/farm",
    "first capture": "tutorials/first-capture",
    "install": "guides/install",
    "job file": "reference/job-file",
    "match": "guides/match",
    "mixer": "guides/mixer",
    "proxy": "guides/proxy",
    "real time": "guides/realtime",
    "showing": "guides/showing",
    "studio": "guides/studio",
}


def page(about: str) -> str:
    """The address of a page, by what it is about."""
    return f"{SITE}/{PAGES[about]}.html"
