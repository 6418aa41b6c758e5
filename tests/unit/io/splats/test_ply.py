"""INRIA PLY: every layout that trainers write, the values that break readers, and the writer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io import splats
from mirelight.io.splats.builder import ROWS
from mirelight.model import SplatCloud

from . import truth


def write_ply(folder: Path, cloud: SplatCloud, kind: str = "float", order: str = "<", extra: str = "") -> Path:
    path = folder / "cloud.ply"
    path.write_bytes(truth.ply_bytes(*truth.inria_rows(cloud), kind, order, extra))
    return path


def assert_same(found: SplatCloud, wanted: SplatCloud, tolerance: float = 1e-6) -> None:
    np.testing.assert_array_equal(found.means, wanted.means)
    np.testing.assert_allclose(found.scales, wanted.scales, rtol=2e-6)
    np.testing.assert_allclose(found.opacities, wanted.opacities, atol=1e-7)
    np.testing.assert_allclose(found.sh, wanted.sh, atol=tolerance)
    np.testing.assert_allclose(found.quats, wanted.quats, atol=1e-6)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_every_degree(tmp_path: Path, degree: int) -> None:
    wanted = truth.cloud(50, degree)
    path = write_ply(tmp_path, wanted)
    found = splats.read(path)
    assert found.sh_degree == degree
    assert_same(found, wanted)
    info = splats.summary(path)
    assert (info.format, info.count, info.sh_degree) == ("INRIA PLY", 50, degree)
    assert info.memory == sum(getattr(found, name).nbytes for name in ("means", "quats", "scales", "opacities", "sh"))


def test_coefficients_are_stored_channel_by_channel(tmp_path: Path) -> None:
    names, rows = truth.inria_rows(truth.cloud(1, 3))
    for i in range(45):
        rows[0, names.index(f"f_rest_{i}")] = i
    path = tmp_path / "a.ply"
    path.write_bytes(truth.ply_bytes(names, rows))
    np.testing.assert_array_equal(splats.read(path).sh[0, 1:], np.arange(45).reshape(3, 15).T)


@pytest.mark.parametrize("kind", ["float", "float32", "double", "float64"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_number_types_and_byte_orders(tmp_path: Path, kind: str, order: str) -> None:
    wanted = truth.cloud(20, 1)
    assert_same(splats.read(write_ply(tmp_path, wanted, kind=kind, order=order)), wanted)


def test_any_property_order_and_unknown_properties(tmp_path: Path) -> None:
    wanted = truth.cloud(40, 2)
    names, rows = truth.inria_rows(wanted)
    names, rows = [*names, "confidence", "id"], np.concatenate([rows, np.full((40, 2), 7.0)], axis=1)
    shuffle = np.random.default_rng(3).permutation(len(names))
    path = tmp_path / "shuffled.ply"
    path.write_bytes(truth.ply_bytes([names[i] for i in shuffle], rows[:, shuffle]))
    assert_same(splats.read(path), wanted)


def test_elements_before_and_after_the_splats(tmp_path: Path) -> None:
    wanted = truth.cloud(5, 0)
    body = truth.ply_bytes(
        *truth.inria_rows(wanted), extra="element camera 2\nproperty double fov\nproperty uchar kind\n"
    )
    at = body.index(b"end_header\n") + len(b"end_header\n")
    after = b"element face 1\nproperty list uchar int vertex_indices\n"
    path = tmp_path / "more.ply"
    path.write_bytes(body[: at - 11] + after + b"end_header\n" + bytes(18) + body[at:] + bytes(13))
    assert_same(splats.read(path), wanted)


def test_windows_line_ends(tmp_path: Path) -> None:
    wanted = truth.cloud(5, 1)
    body = truth.ply_bytes(*truth.inria_rows(wanted))
    at = body.index(b"end_header\n") + len(b"end_header\n")
    path = tmp_path / "crlf.ply"
    path.write_bytes(body[:at].replace(b"\n", b"\r\n") + body[at:])
    assert_same(splats.read(path), wanted)


def test_degree_four_keeps_the_first_three(tmp_path: Path) -> None:
    wanted = truth.cloud(8, 3)
    names, rows = truth.inria_rows(wanted)
    first = names.index("f_rest_0")
    rest = rows[:, first : first + 45].reshape(8, 3, 15)
    wide = np.concatenate([rest, np.full((8, 3, 9), 0.5)], axis=2).reshape(8, 72)
    names = names[:first] + [f"f_rest_{i}" for i in range(72)] + names[first + 45 :]
    path = tmp_path / "degree4.ply"
    path.write_bytes(truth.ply_bytes(names, np.concatenate([rows[:, :first], wide, rows[:, first + 45 :]], axis=1)))
    assert_same(splats.read(path), wanted)
    assert splats.summary(path).notes == ("SH above degree 3 is left out",)


def test_2d_gaussians_are_flat(tmp_path: Path) -> None:
    wanted = truth.cloud(8, 0)
    names, rows = truth.inria_rows(wanted)
    drop = names.index("scale_2")
    path = tmp_path / "flat.ply"
    path.write_bytes(truth.ply_bytes(names[:drop] + names[drop + 1 :], np.delete(rows, drop, axis=1)))
    found = splats.read(path)
    np.testing.assert_array_equal(found.scales[:, 2], 0)
    np.testing.assert_allclose(found.scales[:, :2], wanted.scales[:, :2], rtol=2e-6)
    np.testing.assert_allclose(found.quats, wanted.quats, atol=1e-6)


def test_mip_splatting_filter(tmp_path: Path) -> None:
    """Covariance plus filter² on the diagonal, opacity times sqrt(det before / det after)."""
    cloud = truth.cloud(30, 0)
    names, rows = truth.inria_rows(cloud)
    width = np.linspace(0, 0.3, 30)
    path = tmp_path / "mip.ply"
    path.write_bytes(truth.ply_bytes([*names, "filter_3D"], np.concatenate([rows, width[:, None]], axis=1)))
    found = splats.read(path)
    square = cloud.scales.astype(np.float64) ** 2
    after = square + width[:, None] ** 2
    np.testing.assert_allclose(found.scales, np.sqrt(after), rtol=3e-6)
    factor = np.sqrt(square.prod(axis=1) / after.prod(axis=1))
    np.testing.assert_allclose(found.opacities, cloud.opacities * factor, rtol=1e-5, atol=1e-8)
    assert found.antialiased


@pytest.mark.parametrize(
    ("comments", "wanted"),
    [
        ("", False),
        ("comment SplatRenderMode: mip\n", True),
        ("comment SplatRenderMode: default\n", False),
        ("comment antialiased 1\n", True),
        ("comment antialiased 0\n", False),
        ("comment Generated by a tool\ncomment\n", False),
    ],
)
def test_antialiasing_comments(tmp_path: Path, comments: str, wanted: bool) -> None:
    path = write_ply(tmp_path, truth.cloud(3, 0), extra=comments)
    assert splats.read(path).antialiased is wanted
    assert splats.summary(path).antialiased is wanted


def test_activation_at_the_limits(tmp_path: Path) -> None:
    names, rows = truth.inria_rows(truth.cloud(6, 0))
    rows[:, names.index("opacity")] = (np.inf, -np.inf, 200, -200, 0, 20)
    rows[5, names.index("scale_1")] = -np.inf
    path = tmp_path / "limits.ply"
    path.write_bytes(truth.ply_bytes(names, rows))
    found = splats.read(path)
    assert found.dropped == 0
    np.testing.assert_array_equal(found.opacities, np.array([1, 0, 1, 0, 0.5, 1], dtype=np.float32))
    assert found.scales[5, 1] == 0


def test_nan_and_infinite_splats_are_dropped_and_counted(tmp_path: Path) -> None:
    """Over block borders too: the survivors keep their order."""
    count = 2 * ROWS + 10
    wanted = truth.cloud(count, 1)
    names, rows = truth.inria_rows(wanted)
    bad = {0: "x", 5: "f_rest_8", ROWS - 1: "opacity", ROWS: "scale_2", ROWS + 1: "rot_0", count - 1: "f_dc_1"}
    for row, name in bad.items():
        rows[row, names.index(name)] = np.nan
    rows[7, names.index("y")] = np.inf
    rows[8, names.index("scale_0")] = 1000  # exp overflows
    rows[9, names.index("rot_2")] = -np.inf
    path = tmp_path / "nan.ply"
    path.write_bytes(truth.ply_bytes(names, rows))
    found = splats.read(path)
    gone = [*bad, 7, 8, 9]
    assert found.dropped == len(gone)
    keep = np.setdiff1d(np.arange(count), gone)
    np.testing.assert_array_equal(found.means, wanted.means[keep])
    np.testing.assert_allclose(found.sh, wanted.sh[keep], atol=1e-6)
    np.testing.assert_allclose(found.opacities, wanted.opacities[keep], atol=1e-7)


@pytest.mark.parametrize(("column", "most"), [("x", 1e9), ("f_dc_1", 1e4), ("scale_2", np.log(1e9))])
def test_values_beyond_bounds_are_left_out(tmp_path: Path, column: str, most: float) -> None:
    """Squares of such positions, colours and sizes have no place in single precision. Within bounds all is kept."""
    names, rows = truth.inria_rows(truth.cloud(4, 0))
    rows[:, names.index(column)] = np.array([0.999, 1.01, 0.5, 0.999]) * most
    path = tmp_path / "large.ply"
    path.write_bytes(truth.ply_bytes(names, rows))
    found = splats.read(path)
    assert (len(found), found.dropped) == (3, 1)


@pytest.mark.parametrize(("logit", "shows"), [(-np.inf, False), (-15.0, False), (-8.0, True)])
def test_a_capture_that_does_not_show(tmp_path: Path, logit: float, shows: bool) -> None:
    names, rows = truth.inria_rows(truth.cloud(4, 0))
    rows[:, names.index("opacity")] = logit
    path = tmp_path / "clear.ply"
    path.write_bytes(truth.ply_bytes(names, rows))
    if shows:
        assert len(splats.read(path)) == 4
        return
    with pytest.raises(InputError, match=r"no splat shows: every opacity is below 0\.0001; check the file"):
        splats.read(path)


def test_rotations_of_any_length(tmp_path: Path) -> None:
    wanted = truth.cloud(6, 0)
    names, rows = truth.inria_rows(wanted)
    first = names.index("rot_0")
    rows[:, first:] *= np.array([1, 1e-20, 1e25, 3.7, 0, -2])[:, None]
    path = tmp_path / "lengths.ply"
    path.write_bytes(truth.ply_bytes(names, rows))
    found = splats.read(path)
    assert found.dropped == 0
    np.testing.assert_allclose(np.linalg.norm(found.quats, axis=1), 1, atol=1e-6)
    assert truth.rotation_angle(found.quats, wanted.quats)[[0, 1, 2, 3, 5]].max() < 2e-3
    np.testing.assert_array_equal(found.quats[4], (1, 0, 0, 0))


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_writing_and_reading_again(tmp_path: Path, degree: int) -> None:
    wanted = truth.cloud(100, degree, antialiased=degree == 2)
    splats.write(wanted, tmp_path / "again.ply")
    found = splats.read(tmp_path / "again.ply")
    assert found.antialiased == wanted.antialiased
    assert_same(found, wanted)


def test_written_files_are_what_the_format_says(tmp_path: Path) -> None:
    """Byte for byte the layout that INRIA's own reader takes, except logits and logs that are kept finite."""
    cloud = truth.cloud(12, 3)
    splats.write(cloud, tmp_path / "a.ply")
    names, rows = truth.inria_rows(cloud)
    body = truth.ply_bytes(names, rows)
    written = (tmp_path / "a.ply").read_bytes()
    assert len(written) == len(body)
    assert written[: written.index(b"end_header")] == body[: body.index(b"end_header")]
    table = np.frombuffer(written[-rows.size * 4 :], dtype="<f4").reshape(rows.shape)
    assert np.isfinite(table).all()
    finite = np.isfinite(rows)
    np.testing.assert_allclose(table[finite], rows[finite], rtol=2e-6, atol=2e-6)


def test_degenerate_values_survive_writing(tmp_path: Path) -> None:
    base = truth.cloud(3, 0)
    cloud = SplatCloud(
        means=base.means,
        quats=base.quats,
        scales=np.zeros((3, 3), dtype=np.float32),
        opacities=np.array([0, 1, 0.5], dtype=np.float32),
        sh=base.sh,
    )
    splats.write(cloud, tmp_path / "a.ply")
    found = splats.read(tmp_path / "a.ply")
    np.testing.assert_allclose(found.scales, 0, atol=1e-29)
    np.testing.assert_allclose(found.opacities, (0, 1, 0.5), atol=3e-9)


def test_reading_leaves_no_writeable_array(tmp_path: Path) -> None:
    found = splats.read(write_ply(tmp_path, truth.cloud(3, 1)))
    for name in ("means", "quats", "scales", "opacities", "sh"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(found, name)[0] = 0


HEADERS = {
    "text": ("format binary_little_endian", "format ascii", "format ascii"),
    "no count": ("element vertex 5", "element vertex many", "not understood"),
    "huge count": ("element vertex 5", "element vertex 99999999999999", "truncated"),
    "no splats": ("element vertex 5", "element vertex 0", "no splats"),
    "no opacity": ("property float opacity", "property float opaque", "'opacity'"),
    "twice": ("property float opacity", "property float opacity\nproperty float x", "twice"),
    "odd type": ("property float nx", "property string nx", "not understood"),
    "a list": ("property float nx", "property list uchar float nx", "no element 'vertex'"),
    "odd count of f_rest": ("property float nx", "property float f_rest_99", "f_rest"),
    "two tables": ("element vertex", "element vertex 1\nelement vertex", "two elements"),
    "no end": ("end_header", "end_footer", "end_header"),
    "no format": ("format binary_little_endian 1.0\n", "", "no format"),
}


@pytest.mark.parametrize("name", HEADERS)
def test_bad_headers_are_named(tmp_path: Path, name: str) -> None:
    old, new, said = HEADERS[name]
    body = truth.ply_bytes(*truth.inria_rows(truth.cloud(5, 1)))
    path = tmp_path / "bad.ply"
    path.write_bytes(body.replace(old.encode(), new.encode(), 1))
    with pytest.raises(InputError, match=said) as raised:
        splats.read(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_mesh_as_text_has_no_splats(tmp_path: Path) -> None:
    """What to do is not to save it as binary."""
    path = tmp_path / "mesh.ply"
    path.write_text("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n")
    with pytest.raises(InputError, match="a mesh or point cloud has no splats"):
        splats.read(path)


def test_truncated_and_empty_files(tmp_path: Path) -> None:
    body = truth.ply_bytes(*truth.inria_rows(truth.cloud(5, 1)))
    path = tmp_path / "cut.ply"
    path.write_bytes(body[:-1])
    with pytest.raises(InputError, match="truncated"):
        splats.read(path)
    path.write_bytes(b"")
    with pytest.raises(InputError, match="empty"):
        splats.read(path)


def test_all_splats_bad(tmp_path: Path) -> None:
    names, rows = truth.inria_rows(truth.cloud(5, 0))
    path = tmp_path / "nan.ply"
    path.write_bytes(truth.ply_bytes(names, rows * np.nan))
    with pytest.raises(InputError, match="all 5 splats"):
        splats.read(path)


def test_a_mesh_is_not_a_splat_file(tmp_path: Path) -> None:
    path = tmp_path / "mesh.ply"
    path.write_bytes(truth.ply_bytes(["x", "y", "z"], np.zeros((3, 3))))
    with pytest.raises(InputError, match="mesh or point cloud"):
        splats.summary(path)
