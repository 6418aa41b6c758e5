"""Ways to spoil a file, each drawn from a random generator: bytes, numbers and strings in text, values in JSON."""

from __future__ import annotations

import json
import random
import re
import struct
from typing import Any

NUMBERS: tuple[Any, ...] = (
    *(0, -1, 1, 2, 7, 255, 65536, 2**31 - 1, 2**31, 2**32, 2**53, 2**63, 10**30),
    *(0.5, -0.0, 1e-308, 1e-30, 1e9, 1e12, 1e20, 1e38, 3.5e38, 1e308, -1e308),
    *(5e-324, 1e-300, 1e-160, 1e-45, 1e-20, 1e-9, 1e30, -1e30, 1e77, 1e154, 1.4e154, -1e200, 1e200, 1e300),
)
STRINGS = (
    *("", "a", "../outside/canary.png", "/etc/passwd", "/etc/hostname", "pipe", "folder", "link", "/dev/zero", "/usr"),
    *("\x1b[2J\x1b]0;x\x07", "\u202e\u009b31m", "\ud83d\ude00", "a" * 5000, "a\0b", "C:\\x", "file:///etc/passwd"),
    *("http://example.com/a.bin", "data:;base64,AAAA", "data:", "%2e%2e%2foutside%2fcanary.png", "nan", "inf", "\n"),
)
_NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_STRING = re.compile(rb'"[^"\n]*"')


def bytes_of(data: bytes, rng: random.Random) -> bytes:
    """Cut, flipped, overwritten, doubled or spliced."""
    if not data:
        return bytes(rng.randrange(256) for _ in range(8))
    at = rng.randrange(len(data) if rng.random() < 0.5 else min(len(data), 256))
    match rng.randrange(6):
        case 0:
            return data[:at]
        case 1:
            return data[:at] + bytes((data[at] ^ (1 << rng.randrange(8)),)) + data[at + 1 :]
        case 2:
            return data[:at] + rng.choice((b"\xff", b"\0", b"\x7f")) * 4 + data[at + 4 :]
        case 3:
            extreme = rng.choice((0x7FC00000, 0x7F800000, 0xFF800000, 0x7F7FFFFF, 1, 0x80000000))
            at -= at % 4
            return data[:at] + struct.pack("<I", extreme) + data[at + 4 :]
        case 4:
            return data[:at] + data[at : at + 64] * rng.randrange(2, 50) + data[at:]
        case _:
            return data[:at] + bytes(rng.randrange(256) for _ in range(16)) + data[at + 16 :]


def text_of(data: bytes, rng: random.Random) -> bytes:
    """One number or string replaced, a line doubled, dropped or swapped, or a byte that is not UTF-8."""
    choice = rng.randrange(6)
    if choice < 3 and (found := list(_NUMBER.finditer(data))):
        hit = rng.choice(found)
        new = rng.choice((*map(repr, NUMBERS), "nan", "inf", "-inf", "9" * 5000, "0x" + "f" * 30))
        return data[: hit.start()] + new.encode() + data[hit.end() :]
    if choice == 3 and (found := list(_STRING.finditer(data))):
        hit = rng.choice(found)
        return data[: hit.start()] + json.dumps(rng.choice(STRINGS)).encode() + data[hit.end() :]
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    if choice == 4:
        lines[at : at + 1] = rng.choice(([], [lines[at]] * 3, [rng.choice(lines)], [lines[at][: len(lines[at]) // 2]]))
        return b"\n".join(lines)
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice((b"\xff", b"\x1b[31m", b"\0", b"[" * 500, b"{a=" * 400, b"\xe2\x80\xae")) + data[at:]


def json_of(top: Any, rng: random.Random) -> Any:
    """A copy with one to three values replaced, removed, doubled or wrapped."""
    top = json.loads(json.dumps(top))
    for _ in range(rng.randrange(1, 4)):
        homes = [node for node in _nodes(top) if node]
        if not homes:
            return top
        home = rng.choice(homes)
        key = rng.choice(list(home) if isinstance(home, dict) else range(len(home)))
        match rng.randrange(6):
            case 0:
                del home[key]
            case 1 if isinstance(home, list):
                home += [home[key]] * rng.choice((1, 1000))
            case 2:
                home[key] = [home[key]]
            case 3:
                home[key] = rng.choice((None, True, [], {}, "x"))
            case 4 if isinstance(home[key], str):
                home[key] = rng.choice(STRINGS)
            case _:
                home[key] = rng.choice(NUMBERS)
    return top


def glb_of(data: bytes, rng: random.Random) -> bytes:
    """A GLB whose JSON is spoilt and whose frame is sound."""
    length = struct.unpack_from("<I", data, 12)[0]
    return glb(json_of(json.loads(data[20 : 20 + length]), rng), data[20 + length :])


def glb(top: Any, rest: bytes = b"") -> bytes:
    """A GLB of this JSON, `rest` its other chunks."""
    text = json.dumps(top).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4s4I", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest


def _nodes(top: Any) -> list[Any]:
    found, pending = [], [top]
    while pending:
        node = pending.pop()
        if isinstance(node, dict | list):
            found.append(node)
            pending += node.values() if isinstance(node, dict) else node
    return found
