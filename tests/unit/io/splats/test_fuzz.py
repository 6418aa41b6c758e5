"""Random damage to small files of every format: an InputError in one line or a sound cloud, never anything else."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mirelight.base.errors import InputError
from mirelight.io import splats
from mirelight.model import SplatCloud

from . import ksplat_file, truth

Change = Callable[[bytes], bytes]
INTERESTING = [0, 1, 0x7F, 0x80, 0xFE, 0xFF]


@st.composite
def changes(draw: st.DrawFn) -> Change:
    """Cut the end off, change bytes, drop or repeat a stretch; places are shares of the file, heads preferred."""
    kind = draw(st.sampled_from(["cut", "bytes", "bytes", "bytes", "drop", "repeat"]))
    share = st.floats(0, 1) | st.floats(0, 0.02)
    start, end = sorted((draw(share), draw(share)))
    edits = draw(st.lists(st.tuples(share, st.sampled_from(INTERESTING) | st.integers(0, 255)), min_size=1, max_size=8))

    def change(data: bytes) -> bytes:
        a, b = int(start * len(data)), int(end * len(data))
        if kind == "cut":
            return data[:a]
        if kind == "drop":
            return data[:a] + data[b:]
        if kind == "repeat":
            return data[:b] + data[a:]
        damaged = bytearray(data)
        for where, value in edits:
            damaged[min(int(where * len(data)), len(data) - 1)] = value
        return bytes(damaged)

    return change


def assert_sound(cloud: SplatCloud) -> None:
    assert len(cloud) > 0
    for name in ("means", "quats", "scales", "opacities", "sh"):
        assert np.isfinite(getattr(cloud, name)).all()
    assert cloud.scales.min() >= 0
    assert cloud.opacities.min() >= 0
    assert cloud.opacities.max() <= 1
    np.testing.assert_allclose(np.linalg.norm(cloud.quats.astype(np.float64), axis=1), 1, atol=1e-3)


def read_or_refuse(path: Path) -> None:
    for call in (splats.summary, splats.read):
        try:
            found = call(path)
        except InputError as error:
            assert "\n" not in str(error)
        else:
            if isinstance(found, SplatCloud):
                assert_sound(found)


@cache
def originals() -> dict[str, bytes]:
    """Small files of each single-file format, by name."""
    found = {name: (truth.DATA / name).read_bytes() for name in ("small.sog", "small.splat", "small.glb")}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path in ("a.ply", "b.compressed.ply", "c.spz"):
            splats.write(truth.cloud(20, 1), folder / path)
            found[path] = (folder / path).read_bytes()
    for level in range(3):
        found[f"{level}.ksplat"] = ksplat_file.packed(
            [truth.cloud(20, level), truth.cloud(9, 2)], level, block=1.5, each=4
        )
    found["g.pt"] = (truth.DATA / "ckpts/ckpt_29999_rank0.pt").read_bytes()
    found["d.spz"] = (truth.DATA / "degree4_antialiased_v4.spz").read_bytes()
    return found


def fuzz(name: str, change: Change) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(change(originals()[name]))
        read_or_refuse(path)


quiet = settings(max_examples=150, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])


@quiet
@given(changes())
def test_ply(change: Change) -> None:
    fuzz("a.ply", change)


@quiet
@given(changes(), st.integers(0, 2))
def test_ksplat(change: Change, level: int) -> None:
    """The file, and what of it are no zeros: its heads are nearly empty."""

    def inside(data: bytes) -> bytes:
        return change(data[:48]) + data[48:4096] + change(data[4096:4144]) + data[4144:]

    fuzz(f"{level}.ksplat", change)
    fuzz(f"{level}.ksplat", inside)


@quiet
@given(changes())
def test_ply_header(change: Change) -> None:
    """The header is a tenth of the file; all the damage goes there."""

    def inside(data: bytes) -> bytes:
        at = data.index(b"end_header\n") + 11
        return change(data[:at]) + data[at:]

    fuzz("a.ply", inside)
    fuzz("b.compressed.ply", inside)


@quiet
@given(changes())
def test_compressed_ply(change: Change) -> None:
    fuzz("b.compressed.ply", change)


@quiet
@given(changes())
def test_spz(change: Change) -> None:
    """Damage to the packed file, and damage under a gzip that is whole."""

    def inside(data: bytes) -> bytes:
        packer = zlib.compressobj(1, wbits=31)
        return packer.compress(change(zlib.decompress(data, 31))) + packer.flush()

    fuzz("c.spz", change)
    fuzz("c.spz", inside)


@quiet
@given(changes())
def test_spz_of_version_4(change: Change) -> None:
    fuzz("d.spz", change)


@quiet
@given(changes())
def test_sog(change: Change) -> None:
    fuzz("small.sog", change)


@quiet
@given(changes(), st.sampled_from(["meta.json", "means_l.webp", "quats.webp", "sh0.webp", "shN_centroids.webp"]))
def test_sog_folder(change: Change, member: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        with zipfile.ZipFile(truth.DATA / "small.sog") as archive:
            archive.extractall(folder)
        path = Path(folder) / member
        path.write_bytes(change(path.read_bytes()))
        read_or_refuse(Path(folder))


@quiet
@given(changes(), st.sampled_from(["lod-meta.json", "0_0/meta.json", "env/meta.json"]))
def test_streamed_sog(change: Change, member: str) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "streamed"
        shutil.copytree(truth.DATA / "streamed", folder)
        (folder / member).write_bytes(change((folder / member).read_bytes()))
        read_or_refuse(folder)


@quiet
@given(changes())
def test_splat(change: Change) -> None:
    fuzz("small.splat", change)


@quiet
@given(changes())
def test_checkpoint(change: Change) -> None:
    """Damage to the file, and to the pickle in an archive that is whole."""
    fuzz("g.pt", change)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "g.pt"
        with zipfile.ZipFile(truth.DATA / "ckpts/ckpt_29999_rank0.pt") as before, zipfile.ZipFile(path, "w") as after:
            for member in before.infolist():
                data = before.read(member)
                after.writestr(member.filename, change(data) if member.filename.endswith("data.pkl") else data)
        read_or_refuse(path)


@quiet
@given(changes())
def test_glb(change: Change) -> None:
    fuzz("small.glb", change)
