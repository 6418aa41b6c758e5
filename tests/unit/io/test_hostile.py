"""Pictures that mean harm: broken profiles, light without bounds, terabytes of nothing, pipes."""

from __future__ import annotations

import os
import struct
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirelight.apps.inspect.facts import PictureFacts
from mirelight.apps.inspect.inspect import inspect
from mirelight.base.errors import InputError
from mirelight.compare.pictures import read_picture
from mirelight.io.display import read_display
from mirelight.io.environment import read_environment
from mirelight.io.exr import write_exr
from mirelight.io.hdr import write_hdr
from mirelight.io.safety import existing, open_binary


def with_chunk(png: bytes, kind: bytes, body: bytes) -> bytes:
    """The file with one more chunk behind its header."""
    chunk = struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    return png[:33] + chunk + png[33:]


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        (b"iCCP", b"p\0\0" + b"no zlib stream"),
        (b"iCCP", b"p\0\0" + zlib.compress(b"\0" * 10)),
        (b"iCCP", b"p\0\0" + zlib.compress(b"\0" * 2**26)),
        (b"iCCP", b"p\0\x07"),
        (b"iCCP", b"p"),
        (b"gAMA", b"\0"),
        (b"cHRM", b"\0\0\0"),
        (b"sRGB", b""),
        (b"tRNS", b"\0"),
        (b"pHYs", b"\0"),
        (b"zTXt", b"x\0\0no zlib"),
        (b"iTXt", b"x\0\1\0\0\0no zlib"),
        (b"eXIf", b"MM\0\x2a\xff\xff\xff\xff"),
    ],
)
def test_broken_chunks_of_a_png(tmp_path: Path, kind: bytes, body: bytes) -> None:
    """The pixels are read, or the file is refused in one line; never anything else."""
    path = tmp_path / "a.png"
    Image.fromarray(np.full((4, 4, 3), 255, dtype=np.uint8)).save(path)
    path.write_bytes(with_chunk(path.read_bytes(), kind, body))
    try:
        assert np.array_equal(read_environment(path), np.ones((4, 4, 3)))
    except InputError as e:
        assert "an image that cannot be decoded" in str(e)


@pytest.mark.parametrize("body", [b"", b"p\0", b"p\0\7"])
def test_a_broken_chunk_behind_the_pixels(tmp_path: Path, body: bytes) -> None:
    """Pillow comes to it only when it decodes, and is not ready for it there."""
    path = tmp_path / "a.png"
    Image.fromarray(np.full((4, 4, 3), 255, dtype=np.uint8)).save(path)
    data = path.read_bytes()
    chunk = with_chunk(data[:33], b"iCCP", body)[33:]
    path.write_bytes(data[:-12] + chunk + data[-12:])
    for read in (read_environment, read_display, read_picture):
        with pytest.raises(InputError, match=r"a\.png: an image that cannot be decoded"):
            read(path)


def test_a_large_picture_of_few_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes its pixels and what Pillow holds, and is refused before that where they do not fit."""
    path = tmp_path / "a.png"
    Image.new("RGB", (2048, 2048)).save(path)
    assert path.stat().st_size < 20_000
    tracemalloc.start()
    pixels = read_environment(path)
    assert tracemalloc.get_traced_memory()[1] < 1.6 * pixels.nbytes  # Pillow's own picture is not counted
    tracemalloc.stop()
    monkeypatch.setattr("mirelight.io.safety.free_memory", lambda: 2048 * 2048 * 15)
    with pytest.raises(InputError, match=r"a\.png: 2048 x 2048 pixels take 0\.1 GiB"):
        read_environment(path)


def test_light_without_bounds(tmp_path: Path) -> None:
    for write, name in ((write_hdr, "a.hdr"), (lambda path, x: write_exr(path, {"": x}), "a.exr")):
        path = tmp_path / name
        radiance = np.ones((4, 8, 3), dtype=np.float32)
        write(path, radiance)
        assert read_environment(path).max() == 1
        radiance[1, 2] = 1e30
        write(path, radiance)
        with pytest.raises(InputError, match=r"3 values above 1e\+12"):
            read_environment(path)


@pytest.mark.parametrize("head", [b"#?RADIANCE\n", b"\x89PNG\r\n\x1a\n", b"\x76\x2f\x31\x01", b"\xff\xd8\xff"])
def test_terabytes_of_nothing(tmp_path: Path, head: bytes) -> None:
    path = tmp_path / "sky"
    with path.open("wb") as file:
        file.write(head)
        file.truncate(2**42)
    with pytest.raises(InputError):
        read_environment(path)


def test_pipes_and_devices_are_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path):
        with pytest.raises(InputError, match="not a file"):
            open_binary(path)
    with pytest.raises(InputError, match="neither a file nor a folder"):
        existing(tmp_path / "pipe")


@pytest.mark.filterwarnings("error")
def test_both_infinities_in_a_picture_are_counted_quietly(tmp_path: Path) -> None:
    pixels = np.ones((4, 4, 3), np.float32)
    pixels[0, :2, 1] = np.inf, -np.inf
    write_exr(tmp_path / "a.exr", {"": pixels})
    facts = inspect(tmp_path / "a.exr")
    assert isinstance(facts, PictureFacts) and facts.mean is not None
    assert facts.mean == (1, 1, 1) and facts.brightest == 1  # of the others
    assert facts.not_finite == 2
