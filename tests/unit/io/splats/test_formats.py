"""Every format against the truth that another tool packed, and against that tool's own reading."""

from __future__ import annotations

import copy
import json
import shutil
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.base import sh
from mirelight.base.conventions import rotation_from_quaternion
from mirelight.base.errors import InputError
from mirelight.io import splats
from mirelight.io.splats.builder import ROWS
from mirelight.io.splats.sog_write import codebook
from mirelight.model import SplatCloud

from . import truth
from .sog_v1 import pack_sog_v1

HALF_TURN_Z = np.diag([-1.0, -1.0, 1.0, 1.0])


def worst(found: SplatCloud, wanted: SplatCloud) -> dict[str, float]:
    """Largest error of each value: position, log scale, opacity, colour of degree 0, other SH, angle."""
    match = truth.nearest(found, wanted)
    n = min(found.sh.shape[1], wanted.sh.shape[1])
    with np.errstate(divide="ignore"):
        logs = np.log(found.scales) - np.log(wanted.scales[match])
    errors = {
        "position": found.means - wanted.means[match],
        "scale": logs,
        "opacity": found.opacities - wanted.opacities[match],
        "colour": (found.sh[:, 0] - wanted.sh[match, 0]) * truth.C0,
        "sh": found.sh[:, 1:n] - wanted.sh[match, 1:n],
        "angle": truth.rotation_angle(found.quats, wanted.quats[match]),
    }
    return {name: float(np.abs(error).max(initial=0)) for name, error in errors.items()}


def assert_within(errors: dict[str, float], **limits: float) -> None:
    over = {name: (errors[name], limit) for name, limit in limits.items() if not errors[name] <= limit}
    assert not over
    assert set(limits) == set(errors)


# Steps of each format, halved: what rounding to nearest may lose. Angles: three components off by half a step each,
# and the fourth one reconstructed.
SPZ_STEPS = {
    "position": 0.5 / 4096 + 1e-7,
    "scale": 0.5 / 16 + 1e-6,
    "opacity": 0.5 / 255 + 1e-6,
    "colour": 0.5 / 255 / 0.15 * truth.C0 + 1e-6,
    "sh": 1 / 16 + 0.5 / 128 + 1e-6,
}


@pytest.mark.parametrize(("name", "angle"), [("cloud_v2.spz", 0.15), ("cloud_v3.spz", 0.005), ("cloud_v4.spz", 0.005)])
def test_spz_of_the_reference_encoder(name: str, angle: float) -> None:
    """Version 2 keeps rotations in 8 bits and derives w, which is poor near half turns; 3 and 4 keep 10 bits."""
    found = splats.read(truth.DATA / name)
    wanted = truth.cloud()
    assert_within(worst(found, wanted), **SPZ_STEPS, angle=angle)
    np.testing.assert_array_less(np.abs(found.means - wanted.means), 1e-3)  # the order is kept, the axes are PLY's
    assert splats.summary(truth.DATA / name).format == f"SPZ v{name[7]}"


def test_spz_of_degree_4_keeps_three() -> None:
    path = truth.DATA / "degree4_antialiased_v4.spz"
    found = splats.read(path)
    assert found.antialiased
    assert found.sh_degree == 3
    assert_within(worst(found, truth.cloud(40)), **SPZ_STEPS, angle=0.005)
    assert splats.summary(path).notes == ("SH of degree 4 is left out",)


def test_spz_version_1_has_half_floats(tmp_path: Path) -> None:
    means = np.array([[1.5, -2.25, 0.125], [1024, -0.5, 3]])
    body = struct.pack("<4sIIBBBB", b"NGSP", 1, 2, 0, 12, 1, 0) + means.astype("<f2").tobytes()
    body += bytes([255, 51]) + bytes([128] * 6) + bytes([160] * 3 + [144] * 3) + bytes([0, 255, 127, 128, 128, 128])
    path = tmp_path / "old.spz"
    packer = zlib.compressobj(wbits=31)
    path.write_bytes(packer.compress(body) + packer.flush())
    found = splats.read(path)
    np.testing.assert_array_equal(found.means, means * (1, -1, -1))
    np.testing.assert_allclose(found.opacities, (1, 0.2), atol=1e-7)
    np.testing.assert_allclose(found.scales, np.exp([[0] * 3, [-1] * 3]), rtol=1e-6)
    assert found.antialiased


@pytest.mark.parametrize("system", range(1, 9))
@pytest.mark.parametrize("version", [3, 4])
def test_spz_axes_by_extension(tmp_path: Path, system: int, version: int) -> None:
    """The extension's number counts left-down-back first; bit 0 is right, bit 1 up, bit 2 front. Reading the same bytes
    as stored in other axes flips the shape and the light of every splat, nothing else."""
    plain = truth.DATA / f"cloud_v{version}.spz"
    path = tmp_path / "axes.spz"
    path.write_bytes(with_extensions(plain.read_bytes(), struct.pack("<IIIII", 0x12340001, 0, 0xADBE0003, 4, system)))
    found, stored = splats.read(path), splats.read(plain)
    bits = (system - 1) ^ 0b011  # against right-up-back
    flip = np.array([-1.0 if bits >> i & 1 else 1.0 for i in range(3)])
    np.testing.assert_allclose(found.means, stored.means * flip, atol=1e-6)
    np.testing.assert_allclose(covariances(found), covariances(stored) * np.outer(flip, flip), atol=1e-6)
    directions = np.random.default_rng(1).normal(size=(5, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(colours(found, directions), colours(stored, directions * flip), atol=1e-5)


def test_spz_rotated_axes_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "axes.spz"
    data = (truth.DATA / "cloud_v4.spz").read_bytes()
    path.write_bytes(with_extensions(data, struct.pack("<III", 0xADBE0003, 4, 12)))
    with pytest.raises(InputError, match="SPZ_ADOBE_coordinate_system"):
        splats.read(path)


def test_compressed_ply_of_splat_transform() -> None:
    """11-10-11 bits over the bounds of a chunk; the largest chunk is as wide as the cloud."""
    path = truth.DATA / "cloud.compressed.ply"
    found = splats.read(path)
    limits = {
        "position": 4 / 1023 / 2,
        "scale": 4 / 1023 / 2 + 1e-5,
        "opacity": 0.5 / 255 + 1e-6,
        "colour": 0.5 / 255 + 1e-6,
        "sh": 8 / 256 / 2 + 1e-6,
    }
    assert_within(worst(found, truth.cloud()), **limits, angle=0.004)
    info = splats.summary(path)
    assert (info.format, info.count, info.sh_degree) == ("compressed PLY", 300, 3)


def test_compressed_ply_without_colour_bounds(tmp_path: Path) -> None:
    """Older files: colours are bytes over 0..1."""
    head = "ply\nformat binary_little_endian 1.0\nelement chunk 1\n"
    head += "".join(f"property float {b}_{a}\n" for b in ("min", "max") for a in "xyz")
    head += "".join(f"property float {b}_scale_{a}\n" for b in ("min", "max") for a in "xyz")
    head += "element vertex 1\n" + "".join(f"property uint packed_{x}\n" for x in ("position", "rotation", "scale"))
    head += "property uint packed_color\nend_header\n"
    bounds = np.array([-1, -2, -3, 1, 2, 3, -4, -4, -4, -2, -2, -2], dtype="<f4")
    words = np.array([2047 << 21 | 0 << 11 | 2047, 0, 0, 0xFF00337F], dtype="<u4")
    path = tmp_path / "old.compressed.ply"
    path.write_bytes(head.encode() + bounds.tobytes() + words.tobytes())
    found = splats.read(path)
    np.testing.assert_allclose(found.means, [[1, -2, 3]])
    np.testing.assert_allclose(found.scales, np.exp([[-4.0] * 3]), rtol=1e-6)
    np.testing.assert_allclose(found.sh[0, 0] * truth.C0 + 0.5, (1, 0, 0.2), atol=1e-6)
    np.testing.assert_allclose(found.opacities, 127 / 255, rtol=1e-6)


SOG_STEPS = {"position": 2e-4, "scale": 0.01, "opacity": 1 / 255 + 1e-6, "colour": 1.0, "sh": 1.0, "angle": 0.025}


def test_sog_of_splat_transform() -> None:
    """Rotations 8 bits rounded down, opacity too. Colours come from a codebook of 60 splats: most fit."""
    found = splats.read(truth.DATA / "small.sog")
    wanted = truth.cloud(60)
    assert_within(worst(found, wanted), **SOG_STEPS)
    match = truth.nearest(found, wanted)
    assert np.median(np.abs(found.sh[:, 0] - wanted.sh[match, 0])) * truth.C0 < 0.003
    info = splats.summary(truth.DATA / "small.sog")
    assert (info.format, info.count, info.sh_degree) == ("SOG v2", 60, 3)


@pytest.mark.parametrize(
    ("ours", "theirs"), [("small.sog", "small_from_sog.ply"), ("small.splat", "small_from_splat.ply")]
)
def test_same_as_splat_transform_reads_it(ours: str, theirs: str) -> None:
    found, wanted = splats.read(truth.DATA / ours), splats.read(truth.DATA / theirs)
    np.testing.assert_allclose(found.means, wanted.means, atol=2e-6)
    np.testing.assert_allclose(found.scales, wanted.scales, rtol=2e-6)
    np.testing.assert_allclose(found.opacities, wanted.opacities, atol=2e-6)
    np.testing.assert_allclose(found.sh, wanted.sh, atol=2e-6)
    # .splat: that tool centres rotation bytes on 127.5, the format's own writer on 128
    assert truth.rotation_angle(found.quats, wanted.quats).max() < (0.03 if ours.endswith(".splat") else 0.001)


def test_sog_as_folder_and_as_meta_json(tmp_path: Path) -> None:
    with zipfile.ZipFile(truth.DATA / "small.sog") as archive:
        archive.extractall(tmp_path)
    bundle = splats.read(truth.DATA / "small.sog")
    for path in (tmp_path, tmp_path / "meta.json"):
        found = splats.read(path)
        np.testing.assert_array_equal(found.means, bundle.means)
        np.testing.assert_array_equal(found.sh, bundle.sh)
        assert splats.summary(path).count == 60


def test_sog_says_that_it_is_antialiased(tmp_path: Path) -> None:
    with zipfile.ZipFile(truth.DATA / "small.sog") as archive:
        archive.extractall(tmp_path)
    meta = json.loads((tmp_path / "meta.json").read_text())
    assert not splats.read(tmp_path).antialiased
    for key, value in (("antialias", True), ("model", "antialiased")):
        (tmp_path / "meta.json").write_text(json.dumps(meta | {key: value}))
        assert splats.read(tmp_path).antialiased


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_sog_version_1(tmp_path: Path, degree: int) -> None:
    """Packed here as the old encoder did: bytes between bounds for each channel, opacity as a logit."""
    wanted = truth.cloud(60, degree)
    path = pack_sog_v1(wanted, tmp_path)
    found = splats.read(path)
    o = wanted.opacities[2:]  # the first two have logits that stretch the bounds
    assert_within(worst(found, wanted), **(SOG_STEPS | {"opacity": 0.03, "colour": 0.003, "sh": 0.003}))
    np.testing.assert_allclose(found.opacities[2:], o, atol=0.03)
    info = splats.summary(path)
    assert (info.format, info.sh_degree) == ("SOG v1", degree)


def test_splat() -> None:
    found = splats.read(truth.DATA / "small.splat")
    limits = {"position": 0.0, "scale": 1e-6, "opacity": 0.5 / 255 + 1e-6, "colour": 0.5 / 255 + 1e-6, "sh": 0.0}
    assert_within(worst(found, truth.cloud(60, 0)), **limits, angle=0.02)


def test_splat_of_zero_rotation_is_the_identity(tmp_path: Path) -> None:
    row = struct.pack("<6f", 1, 2, 3, 0.1, 0.2, 0.3) + bytes([255, 0, 128, 255, 128, 128, 128, 128])
    path = tmp_path / "a.splat"
    path.write_bytes(row)
    np.testing.assert_array_equal(splats.read(path).quats, [[1, 0, 0, 0]])


def test_glb_of_splat_transform() -> None:
    """glTF is Y up; PLY is turned by 180 degrees about Z to get there. Values are floats."""
    found = splats.read(truth.DATA / "small.glb")
    turned = splats.transform(truth.cloud(60), HALF_TURN_Z)
    limits = {"position": 1e-6, "scale": 1e-5, "opacity": 1e-7, "colour": 1e-6, "sh": 1e-6, "angle": 0.001}
    assert_within(worst(found, turned), **limits)
    assert splats.summary(truth.DATA / "small.glb").sh_degree == 3


def test_glb_nodes_move_splats(tmp_path: Path) -> None:
    nodes = [
        {"children": [1], "rotation": [0.5, 0.5, 0.5, 0.5], "translation": [1, 2, 3]},
        {"mesh": 0, "scale": [2, 2, 2]},
        {"mesh": 0},
    ]
    found = splats.read(patched_glb(tmp_path, lambda gltf: gltf.update(nodes=nodes, scenes=[{"nodes": [0, 2]}])))
    once = splats.read(truth.DATA / "small.glb")
    cycle = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # that quaternion takes x to y, y to z, z to x
    np.testing.assert_allclose(found.means[:60], 2 * once.means @ cycle.T + (1, 2, 3), atol=1e-5)
    np.testing.assert_allclose(found.scales[:60], 2 * once.scales, rtol=1e-6)
    np.testing.assert_array_equal(found.means[60:], once.means)
    np.testing.assert_array_equal(found.sh[60:], once.sh)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"kernel": "beta"}, "kernel: 'beta'; read is 'ellipse'"),
        ({"colorSpace": "lin_p3d65"}, "read is 'srgb_rec709_display' or 'lin_rec709_display'"),
        ({"projection": "fisheye"}, "read is 'perspective'"),
        ({"sortingMethod": "zDepth"}, "read is 'cameraDistance'"),
    ],
)
def test_glb_of_other_kinds_is_refused_by_name(tmp_path: Path, change: dict[str, str], said: str) -> None:
    def edit(gltf: dict[str, list[dict[str, list[dict[str, dict[str, dict[str, str]]]]]]]) -> None:
        gltf["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"].update(change)

    with pytest.raises(InputError, match=said):
        splats.read(patched_glb(tmp_path, edit))


def test_glb_says_how_its_splats_are_drawn(tmp_path: Path) -> None:
    def linear(gltf: dict[str, Any]) -> None:
        gltf["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["colorSpace"] = "lin_rec709_display"

    path = patched_glb(tmp_path, linear)
    info = splats.summary(path)
    assert (info.color_space, info.sort, info.cutoff) == ("lin_rec709_display", "radial", 3.0)
    assert splats.read(path).color_space == "lin_rec709_display"
    splats.write(splats.read(path), tmp_path / "again.glb")
    again = splats.read(tmp_path / "again.glb")
    assert again.color_space == "lin_rec709_display" and np.array_equal(again.sh, splats.read(path).sh)
    assert splats.summary(truth.DATA / "small.glb").color_space == "srgb_rec709_display"
    with pytest.raises(InputError, match="some blend in linear light"):
        splats.merge([again, splats.read(truth.DATA / "small.glb")])


def test_glb_of_two_colour_spaces_or_half_a_degree_is_refused(tmp_path: Path) -> None:
    def two(gltf: dict[str, Any]) -> None:
        other = copy.deepcopy(gltf["meshes"][0]["primitives"][0])
        other["extensions"]["KHR_gaussian_splatting"]["colorSpace"] = "lin_rec709_display"
        gltf["meshes"][0]["primitives"].append(other)

    def half(gltf: dict[str, Any]) -> None:
        del gltf["meshes"][0]["primitives"][0]["attributes"]["KHR_gaussian_splatting:SH_DEGREE_2_COEF_3"]

    def triangles(gltf: dict[str, Any]) -> None:
        del gltf["meshes"][0]["primitives"][0]["mode"]

    for edit, said in (
        (two, "splats in lin_rec709_display beside others in srgb_rec709_display"),
        (half, "SH of degree 3 with coefficients missing"),
        (triangles, "mode: 4; splats are points, mode 0"),
    ):
        with pytest.raises(InputError, match=said):
            splats.summary(patched_glb(tmp_path, edit))


def test_glb_instances_beyond_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a kilobyte of accessor makes 5,000 copies; the sum is refused before the first is made."""
    monkeypatch.setattr("mirelight.io.safety.free_memory", lambda: 1 << 26)

    def edit(gltf: dict[str, list[dict[str, object]]]) -> None:
        gltf["accessors"].append({"componentType": 5126, "count": 5_000, "type": "VEC3"})
        attributes = {"TRANSLATION": len(gltf["accessors"]) - 1}
        gltf["nodes"] = [{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}]

    with pytest.raises(InputError, match=r"300,000 splats take 0\.1 GiB"):
        splats.read(patched_glb(tmp_path, edit))


def test_glb_scaled_unevenly_is_refused_by_name(tmp_path: Path) -> None:
    nodes = [{"mesh": 0, "scale": [1, 2, 1]}]
    with pytest.raises(InputError, match=r"nodes\[0\]: splats can only be scaled evenly"):
        splats.read(patched_glb(tmp_path, lambda gltf: gltf.update(nodes=nodes)))


def test_streamed_sog_levels() -> None:
    folder = truth.DATA / "streamed"
    environment = truth.cloud(12, 0)
    for lod, count in ((None, 60), (0, 60), (1, 20)):
        found = splats.read(folder / "lod-meta.json", lod=lod)
        wanted = splats.merge([truth.cloud(count, 1), environment])
        # a level's splats that coincide with the environment's are told apart by their place in the file
        assert len(found) == count + 12
        for part, whole in ((slice(0, count), truth.cloud(count, 1)), (slice(count, None), environment)):
            means = found.means[part].astype(np.float64)
            distance = np.linalg.norm(means[:, None] - whole.means[None], axis=-1)
            assert distance.min(axis=1).max() < 1e-3
            assert len(set(distance.argmin(axis=1))) == len(whole)
        assert found.sh_degree == wanted.sh_degree == 1
        np.testing.assert_array_equal(found.sh[count:, 1:], 0)
        info = splats.summary(folder, lod=lod)
        assert (info.count, info.sh_degree, info.levels) == (count + 12, 1, (60, 20))


def test_null_is_none(tmp_path: Path) -> None:
    """As PlayCanvas' own samples have it where there is no sky, and no harmonics."""
    folder = tmp_path / "streamed"
    shutil.copytree(truth.DATA / "streamed", folder)
    meta = json.loads((folder / "lod-meta.json").read_text())
    (folder / "lod-meta.json").write_text(json.dumps({**meta, "environment": None}))
    assert len(splats.read(folder / "lod-meta.json")) == splats.summary(folder).count == 60
    parts = [x for x in folder.rglob("meta.json") if x.parent != folder]
    for part in parts:
        own = json.loads(part.read_text())
        part.write_text(json.dumps({**own, "shN": None}))
    assert splats.read(folder).sh_degree == 0


def test_levels_that_are_not_there() -> None:
    with pytest.raises(InputError, match=r"no level of detail 2; 0 \(finest\) to 1"):
        splats.read(truth.DATA / "streamed", lod=2)
    with pytest.raises(InputError, match="one level"):
        splats.read(truth.DATA / "small.splat", lod=1)


def test_streamed_sog_with_a_missing_part(tmp_path: Path) -> None:
    folder = tmp_path / "streamed"
    shutil.copytree(truth.DATA / "streamed", folder)
    (folder / "0_0" / "quats.webp").unlink()
    with pytest.raises(InputError, match=r"quats\.webp"):
        splats.read(folder)
    shutil.rmtree(folder / "0_0")
    with pytest.raises(InputError, match=r"0_0/meta\.json"):
        splats.summary(folder)
    assert len(splats.read(folder, lod=1)) == 32


# --- writers ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("count", [1, 255, 257, ROWS + 3])
def test_writing_compressed_ply(tmp_path: Path, degree: int, count: int) -> None:
    wanted = truth.cloud(count, degree, antialiased=degree == 1)
    path = tmp_path / "a.compressed.ply"
    splats.write(wanted, path)
    found = splats.read(path)
    assert (len(found), found.sh_degree, found.antialiased) == (count, degree, degree == 1)
    if count <= 300:
        limits = {"position": 0.002, "scale": 0.0021, "opacity": 0.002, "colour": 0.002, "sh": 0.0157, "angle": 0.004}
        assert_within(worst(found, wanted), **limits)
    else:
        assert abs(found.means.mean(axis=0) - wanted.means.mean(axis=0)).max() < 1e-4


@pytest.mark.parametrize("degree", [0, 3])
def test_writing_spz(tmp_path: Path, degree: int) -> None:
    wanted = truth.cloud(100, degree, antialiased=True)
    splats.write(wanted, tmp_path / "a.spz")
    found = splats.read(tmp_path / "a.spz")
    assert found.antialiased
    assert_within(worst(found, wanted), **SPZ_STEPS, angle=0.005)


def test_our_spz_is_the_reference_encoders(tmp_path: Path) -> None:
    """Same bytes after inflating, but for ties that float32 and float64 round differently."""
    splats.write(truth.cloud(), tmp_path / "a.spz")
    ours, theirs = (zlib.decompress(p.read_bytes(), 31) for p in (tmp_path / "a.spz", truth.DATA / "cloud_v3.spz"))
    assert ours[:16] == theirs[:16]
    a, b = (np.frombuffer(data, dtype=np.uint8).astype(int) for data in (ours, theirs))
    assert np.count_nonzero(a != b) <= len(a) // 1000


def test_writing_spz_of_a_wide_scene(tmp_path: Path) -> None:
    base = truth.cloud(10, 0)
    wide = splats.transform(base, np.diag([5000.0, 5000, 5000, 1]))
    splats.write(wide, tmp_path / "a.spz")
    np.testing.assert_allclose(splats.read(tmp_path / "a.spz").means, wide.means, atol=0.5 / 512 + 1e-3)
    with pytest.raises(ValueError, match="8 million"):
        splats.write(splats.transform(base, np.diag([1e7, 1e7, 1e7, 1])), tmp_path / "b.spz")


@pytest.mark.parametrize(("count", "degree"), [(1, 0), (2, 3), (300, 0), (300, 2), (300, 3)])
def test_writing_sog(tmp_path: Path, count: int, degree: int) -> None:
    wanted = truth.cloud(count, degree, antialiased=degree == 2)
    splats.write(wanted, tmp_path / "a.sog")
    found = splats.read(tmp_path / "a.sog")
    assert (found.sh_degree, found.antialiased, splats.summary(tmp_path / "a.sog").format) == (
        degree,
        degree == 2,
        "SOG v2",
    )
    limits = {"position": 2e-4, "scale": 0.02, "opacity": 0.002, "colour": 0.01, "sh": 0.005, "angle": 0.012}
    assert_within(worst(found, wanted), **limits)


def test_a_sog_of_more_harmonics_than_its_palette_holds(tmp_path: Path) -> None:
    """Splats of 70,000 different colours share 65,536 entries, and each is near its own."""
    count = 70_000
    u = np.random.default_rng(2).uniform(-0.5, 0.5, (count, 2)).astype(np.float32)
    sh = np.zeros((count, 4, 3), np.float32)
    sh[:, 1:, 0], sh[:, 1:, 1] = u[:, :1], u[:, 1:]
    many = SplatCloud(
        means=np.arange(count, dtype=np.float32)[:, None] * np.array([1e-3, 0, 0], np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.full((count, 3), 0.1, np.float32),
        opacities=np.full(count, 0.5, np.float32),
        sh=sh,
    )
    splats.write(many, tmp_path / "a.sog")
    found = splats.read(tmp_path / "a.sog")
    place = np.argsort(np.argsort(found.means[:, 0], kind="stable"), kind="stable")  # in Morton order: along x
    error = found.sh[:, 1] - sh[place, 1]
    assert np.sqrt((error**2).mean()) < 0.005  # one part in two hundred of what they span


def test_a_codebook_is_near_the_least_error() -> None:
    """Of evenly spread numbers the best 256 are evenly spread: errors of a width / sqrt(12); few numbers are kept."""
    even = np.random.default_rng(3).uniform(-2, 5, 100_000)
    book = codebook(even)
    nearest = book[np.abs(even[:2000, None] - book).argmin(axis=1)]
    assert np.sqrt(((even[:2000] - nearest) ** 2).mean()) < 1.25 * 7 / 256 / np.sqrt(12)
    few = np.repeat([-1.0, 0.25, 7.0], [1, 1000, 1])
    assert np.isin(few, codebook(few)).all()


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_writing_glb(tmp_path: Path, degree: int) -> None:
    """Bit for bit, in the order given."""
    wanted = truth.cloud(70, degree)
    splats.write(wanted, tmp_path / "a.glb")
    found = splats.read(tmp_path / "a.glb")
    for name in ("means", "scales", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
    np.testing.assert_allclose(found.quats, wanted.quats, atol=1e-6)
    data = (tmp_path / "a.glb").read_bytes()
    size = int.from_bytes(data[12:16], "little")
    primitive = json.loads(data[20 : 20 + size])["meshes"][0]["primitives"][0]
    assert primitive["mode"] == 0 and primitive["attributes"]["COLOR_0"] == 1
    assert primitive["extensions"]["KHR_gaussian_splatting"]["colorSpace"] == "srgb_rec709_display"


def test_formats_that_cannot_hold_no_splats_say_so(tmp_path: Path) -> None:
    for name in ("a.sog", "a.glb"):
        with pytest.raises(ValueError, match="no splats"):
            splats.write(truth.cloud(0, 0), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_the_same_cloud_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.ply", "a.compressed.ply", "a.splat", "a.spz", "a.sog", "a.glb"):
        splats.write(truth.cloud(50), tmp_path / name)
        first = (tmp_path / name).read_bytes()
        splats.write(truth.cloud(50), tmp_path / name)
        assert (tmp_path / name).read_bytes() == first
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "a.compressed.ply",
        "a.glb",
        "a.ply",
        "a.sog",
        "a.splat",
        "a.spz",
    ]


def test_writing_to_an_unknown_suffix(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="splats are written as"):
        splats.write(truth.cloud(2), tmp_path / "a.obj")


# --- helpers ---------------------------------------------------------------------------------------------------------


def covariances(cloud: SplatCloud) -> NDArray[np.float64]:
    axes = rotation_from_quaternion(cloud.quats) * cloud.scales[:, None]
    return np.asarray(axes @ axes.transpose(0, 2, 1))


def colours(cloud: SplatCloud, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(splats, directions, 3)"""
    return np.asarray(np.einsum("dk,nkc->ndc", sh.basis(directions, cloud.sh_degree), cloud.sh))


def with_extensions(data: bytes, records: bytes) -> bytes:
    """An SPZ file with extension records put in: after the attributes, or between header and table in version 4."""
    if data[:4] == b"NGSP":
        head = bytearray(data[:32])
        head[14] |= 2
        head[16:20] = struct.pack("<I", struct.unpack_from("<I", data, 16)[0] + len(records))
        return bytes(head) + records + data[32:]
    body = bytearray(zlib.decompress(data, 31))
    body[14] |= 2
    packer = zlib.compressobj(wbits=31)
    return packer.compress(bytes(body) + records) + packer.flush()


def patched_glb(folder: Path, edit: object) -> Path:
    """The test GLB with its JSON changed in place."""
    data = (truth.DATA / "small.glb").read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    gltf = json.loads(data[20 : 20 + length])
    assert callable(edit)
    edit(gltf)
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    path = folder / "patched.glb"
    path.write_bytes(struct.pack("<4s4I", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest)
    return path
