"""The position index against tomllib: what it says stands at a place is what tomllib reads there."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from mirelight.io.job.positions import Path, index

# --- random documents ------------------------------------------------------------------------------------------------

CHARACTERS = st.characters(exclude_categories=("Cs", "Cc"), exclude_characters="\x7f")
PLAIN = st.text(CHARACTERS, max_size=12)
BARE_KEYS = st.text("abcXYZ019_-", min_size=1, max_size=6)
BLANKS = st.sampled_from(["", " ", "\t ", "  "])
GAPS = st.sampled_from(["", " ", "\n", "\n  # a comment, with ] } \" ' and = in it\n\t"])
COMMENTS = st.sampled_from(["", " # c = [1]", "\t#"])

EDGE_STRINGS = st.sampled_from(
    [
        '""""a""""',
        "''''b''''",
        '"""\nx\\"""" y"""',
        "'''\n'''",
        '"a \\" # b"',
        "'C:\\dir'",
        '"""\\\n   next"""',
        '""',
        "''",
    ]
)
STRINGS = st.one_of(
    PLAIN.map(lambda s: json.dumps(s, ensure_ascii=False)),
    PLAIN.filter(lambda s: "'" not in s).map(lambda s: f"'{s}'"),
    PLAIN.map(lambda s: '"""\n' + s.replace("\\", "\\\\").replace('"', '\\"') + '\n"quoted" # no comment\n"""'),
    PLAIN.filter(lambda s: "'" not in s).map(lambda s: f"'''{s}\n[not.a.header]\n'''"),
    EDGE_STRINGS,
)
SCALARS = st.one_of(
    st.integers(-(2**40), 2**40).map(str),
    st.floats(allow_nan=False).map(
        lambda x: repr(x) if "e" in repr(x) or "." in repr(x) or "inf" in repr(x) else f"{x}.0"
    ),
    st.sampled_from(["true", "false", "0xFF", "1_000", "+3", "6.6e-34", "-inf", "1979-05-27", "07:32:00"]),
    st.sampled_from(["1979-05-27 07:32:00", "1979-05-27T07:32:00Z"]),
    STRINGS,
)


def key_texts() -> st.SearchStrategy[str]:
    return st.one_of(BARE_KEYS, PLAIN.map(lambda s: json.dumps(s, ensure_ascii=False)), EMPTY_OR_ODD_KEYS)


EMPTY_OR_ODD_KEYS = st.sampled_from(['""', "'a.b'", "'[x]'", '"q\\u0041"', "'# no comment'"])


@st.composite
def arrays(draw: st.DrawFn, inner: st.SearchStrategy[str]) -> str:
    items = [draw(GAPS) + draw(inner) + draw(GAPS) for _ in range(draw(st.integers(0, 3)))]
    trailing = "," if draw(st.booleans()) and items else ""
    return "[" + ",".join(items) + trailing + draw(GAPS) + "]"


@st.composite
def inline_tables(draw: st.DrawFn, inner: st.SearchStrategy[str]) -> str:
    keys = draw(st.lists(key_texts(), max_size=3, unique_by=lambda k: next(iter(tomllib.loads(k + "=0")))))
    pairs = [f"{draw(BLANKS)}{k}{draw(BLANKS)}={draw(BLANKS)}{draw(inner)}{draw(BLANKS)}" for k in keys]
    return "{" + ",".join(pairs) + "}"


VALUES = st.recursive(SCALARS, lambda inner: st.one_of(arrays(inner), inline_tables(inner)), max_leaves=6)


@st.composite
def documents(draw: st.DrawFn) -> str:
    """Lines in random order; those that would break the document's rules (a key twice) are left out."""
    text = ""
    for _ in range(draw(st.integers(0, 8))):
        names = [f"{draw(BLANKS)}{part}{draw(BLANKS)}" for part in draw(st.lists(key_texts(), min_size=1, max_size=3))]
        dotted = ".".join(names)
        line = draw(
            st.sampled_from(
                [f"{dotted}={draw(BLANKS)}{draw(VALUES)}", f"[{dotted}]", f"[[{dotted}]]", f"[[{dotted}]]", ""]
            )
        )
        more = text + draw(BLANKS) + line + draw(COMMENTS) + "\n"
        try:
            tomllib.loads(more)
        except tomllib.TOMLDecodeError:
            continue
        text = more
    return text[:-1] if draw(st.booleans()) else text


def paths(node: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    if path:
        yield path, node
    if isinstance(node, dict):
        for key, value in node.items():
            yield from paths(value, (*path, key))
    elif isinstance(node, list):
        for i, value in enumerate(node):
            yield from paths(value, (*path, i))


# --- tests -----------------------------------------------------------------------------------------------------------


@settings(max_examples=200, deadline=None)
@given(documents())
def test_what_stands_at_a_place_is_the_value_that_tomllib_reads(text: str) -> None:
    data = tomllib.loads(text)
    found = index(text)
    expected = dict(paths(data))
    assert set(found.values) == set(expected)
    assert set(found.keys) == {path for path in expected if isinstance(path[-1], str)}
    for path, place in [*found.values.items(), *found.keys.items()]:
        assert place.line == text.count("\n", 0, place.start) + 1
        assert place.column == place.start - text.rfind("\n", 0, place.start), path
    for path, place in found.keys.items():
        assert tomllib.loads(text[place.start : place.end] + " = 0") == {path[-1]: 0}
    for path, place in found.values.items():
        written = text[place.start : place.end]
        made_by_header = written.startswith("[") and text[: place.start].rpartition("\n")[2].strip() == ""
        named_by_key = found.keys.get(path) == place
        if not made_by_header and not named_by_key:
            assert tomllib.loads(f"x = {written}") == {"x": expected[path]}


def test_positions_of_a_job() -> None:
    text = (
        'splats = "a.ply"\n'  # 1
        "proxy = { path = 'b.glb', albedo = [0.1, 2, 0.3] }\n"  # 2
        "\n"
        "[[lights]]\n"  # 4
        'type = "spot"\n'
        "  range = -1 # metres\n"  # 6
        "[[lights]]\n"
        "[lights.extra]\n"  # 8
        'a."b c".d = 1\n'
        "[render]\n"  # 10
        "spp=0\n"
    )
    found = index(text)

    def at(path: Path) -> tuple[int, int]:
        place = found.value(path)
        assert place is not None
        return place.line, place.column

    assert at(("splats",)) == (1, 10)
    assert at(("proxy", "albedo", 1)) == (2, 42)
    assert at(("lights", 0)) == (4, 1)
    assert at(("lights", 0, "range")) == (6, 11)
    assert at(("lights", 1)) == (7, 1)
    assert at(("lights", 1, "extra")) == (8, 1)
    assert at(("lights", 1, "extra", "a", "b c", "d")) == (9, 13)
    assert at(("render", "spp")) == (11, 5)
    key = found.key(("lights", 0, "range"))
    assert key is not None and (key.line, key.column) == (6, 3)


def test_what_is_not_in_the_text_has_the_place_around_it() -> None:
    found = index("[[lights]]\ntype = 'point'\n")
    around = found.value(("lights", 0, "position", 2))
    assert around is not None and (around.line, around.column) == (1, 1)
    assert found.value(("render",)) is None
    assert found.key(("render", "spp")) is None
