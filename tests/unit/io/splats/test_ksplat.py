"""KSPLAT against a cloud that is known, packed by the letter of the format; and files that are broken."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io import splats

from . import ksplat_file, truth

BLOCK, SH = 1.5, 0.5


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("level", [0, 1, 2])
def test_it_is_the_cloud_within_half_a_step(level: int, degree: int, tmp_path: Path) -> None:
    """Of buckets that are full and others, in sections of other degrees and sizes."""
    wanted, lesser = truth.cloud(300, degree), truth.cloud(40, 0)
    path = tmp_path / "a.ksplat"
    path.write_bytes(ksplat_file.packed([wanted, lesser], level, block=BLOCK, each=7, sh=SH))
    told, whole = splats.summary(path), splats.read(path)
    assert (told.format, told.count, told.sh_degree) == (f"KSPLAT, level {level}", 340, degree)
    assert len(whole) == 340 and whole.sh.shape[1] == (degree + 1) ** 2 and not whole.dropped
    assert not whole.sh[300:, 1:].any()
    for found, true, first in ((whole, wanted, 0), (whole, lesser, 300)):
        means = found.means[first : first + len(true)]
        at = first + np.argmin(np.linalg.norm(true.means[:, None] - means[None], axis=-1), axis=1)
        assert sorted(at) == list(range(first, first + len(true)))
        place = 1e-6 if level == 0 else BLOCK / 2 / ksplat_file.HALF_RANGE / 2 + 1e-6
        np.testing.assert_allclose(found.means[at], true.means, atol=place)
        half = 1e-6 if level == 0 else 2**-11
        np.testing.assert_allclose(found.scales[at], true.scales, rtol=half)
        assert truth.rotation_angle(found.quats[at], true.quats).max() < (1e-3 if level == 0 else 4e-3)
        np.testing.assert_allclose(found.opacities[at], true.opacities, atol=0.51 / 255)
        np.testing.assert_allclose(found.sh[at, 0], true.sh[:, 0], atol=0.51 / 255 / truth.C0)
        rest = found.sh[at, 1 : true.sh.shape[1]]
        step = {0: 1e-6, 1: 2**-11, 2: 2 * SH / 255 + 1e-6}[level]  # the format takes the lower edge of a step
        np.testing.assert_allclose(rest, true.sh[:, 1:], atol=step)


def test_ranges_that_the_file_leaves_out_are_the_format_s(tmp_path: Path) -> None:
    cloud = truth.cloud(30, 2)
    data = bytearray(ksplat_file.packed([cloud], 2, sh=1.5))
    struct.pack_into("<2f", data, 36, 0, 0)
    struct.pack_into("<I", data, 4096 + 24, 0)
    (tmp_path / "whole.ksplat").write_bytes(ksplat_file.packed([cloud], 2, sh=1.5))
    (tmp_path / "less.ksplat").write_bytes(data)
    whole, less = (splats.read(tmp_path / f"{x}.ksplat") for x in ("whole", "less"))
    np.testing.assert_array_equal(less.means, whole.means)
    np.testing.assert_array_equal(less.sh, whole.sh)


@pytest.mark.parametrize(
    ("offset", "form", "value", "said"),
    [
        (0, "<BB", (0, 0), "no .ksplat file of version 0.1"),
        (0, "<BB", (1, 0), "no .ksplat file of version 0.1"),
        (4, "<I", (0,), "0 sections in"),
        (4, "<I", (2**31,), "2,147,483,648 sections in"),
        (20, "<H", (3,), "compression level 3, and there are 0, 1 and 2"),
        (4096 + 4, "<I", (2**32 - 1,), "a section of 4,294,967,295 splats that ends"),
        (4096 + 4, "<I", (21,), "a section of 21 splats that ends 24 bytes past its end"),
        (4096 + 8, "<I", (0,), "buckets that do not hold its splats"),
        (4096 + 20, "<H", (16,), "buckets of 16 bytes, and they have 12"),
        (4096 + 32, "<I", (2**32 - 1,), "buckets of which"),
        (4096 + 40, "<H", (3,), "SH of degree 3, and there are at most 2"),
    ],
)
def test_one_line_says_what_is_broken(
    offset: int, form: str, value: tuple[int, ...], said: str, tmp_path: Path
) -> None:
    data = bytearray(ksplat_file.packed([truth.cloud(20, 0)], 1, block=BLOCK, each=1))
    struct.pack_into(form, data, offset, *value)
    path = tmp_path / "a.ksplat"
    path.write_bytes(data)
    with pytest.raises(InputError, match=said) as error:
        splats.read(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("size", [1, 4095, 4096, 5119, 5120, 5300])
def test_a_part_of_a_file_is_refused(size: int, tmp_path: Path) -> None:
    path = tmp_path / "a.ksplat"
    path.write_bytes(ksplat_file.packed([truth.cloud(20, 0)], 1)[:size])
    with pytest.raises(InputError, match=r"no \.ksplat file of version|sections in|past its end"):
        splats.read(path)
