"""Checkpoints that torch itself saved, and pickles that would do more than hold numbers."""

from __future__ import annotations

import io
import os
import pickle
import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io import splats
from mirelight.io.job.hashing import digest
from mirelight.io.splats import torch_file
from mirelight.io.splats.training import data_of, resolved
from mirelight.model import SplatCloud

from .truth import DATA, cloud

GSPLAT = DATA / "ckpts/ckpt_29999_rank0.pt"
NERFSTUDIO = DATA / "nerfstudio_models/step-000029999.ckpt"


def assert_alike(found: SplatCloud, wanted: SplatCloud) -> None:
    for name in ("means", "quats", "scales", "opacities", "sh"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), rtol=2e-6, atol=2e-7)


def test_gsplat_s_of_both_gpus() -> None:
    assert_alike(splats.read(GSPLAT), cloud(60, 3))
    head = splats.summary(GSPLAT)
    assert (head.format, head.count, head.sh_degree) == ("checkpoint of gsplat", 60, 3)
    assert head.notes == ("2 files, one of each GPU",)


def test_nerfstudio_s() -> None:
    assert_alike(splats.read(NERFSTUDIO), cloud(60, 3))
    assert splats.summary(NERFSTUDIO).format == "checkpoint of nerfstudio"


def test_one_gpu_s_alone(tmp_path: Path) -> None:
    shutil.copy(GSPLAT, tmp_path / "ckpt_6999_rank0.pt")
    assert len(splats.read(tmp_path / "ckpt_6999_rank0.pt")) == 25


def test_a_key_of_it_holds_all_that_is_read(tmp_path: Path) -> None:
    """Another GPU's splats, and settings that say how it was trained."""
    folder = shutil.copytree(GSPLAT.parent, tmp_path / "results/ckpts")
    path, known = folder / GSPLAT.name, []
    for change in (
        lambda: None,
        lambda: (folder / "ckpt_29999_rank1.pt").unlink(),
        lambda: (tmp_path / "results/cfg.yml").write_text("antialiased: true\n", "utf-8"),
    ):
        change()
        known.append(digest(path))
    assert len(set(known)) == 3


def test_settings_say_that_it_is_antialiased(tmp_path: Path) -> None:
    for made, name, said in (
        (GSPLAT, "cfg.yml", "antialiased: true\n"),
        (NERFSTUDIO, "config.yml", "pipeline:\n  model:\n    rasterize_mode: antialiased\n"),
    ):
        path = tmp_path / made.parent.name / made.name
        path.parent.mkdir()
        shutil.copy(made, path)
        assert not splats.read(path).antialiased
        (tmp_path / name).write_text(said, "utf-8")
        assert splats.read(path).antialiased and splats.summary(path).antialiased
        (tmp_path / name).unlink()


def test_a_training_s_folder_is_read_and_its_project_found(tmp_path: Path) -> None:
    for name, settings, project in (
        ("results", ("cfg.yml", "ckpt: null\ndata_dir: data/hall\n"), "data/hall"),
        (
            "outputs/hall/splatfacto/2026-11-30",
            ("config.yml", "data: &id001 !!python/object/apply:pathlib.PosixPath\n- data\n- 'h l'\nx: 1\n"),
            "data/h l",
        ),
    ):
        made = GSPLAT if name == "results" else NERFSTUDIO
        folder = tmp_path / name / made.parent.name
        folder.mkdir(parents=True)
        shutil.copy(made, folder)
        capture = resolved(tmp_path / name)
        assert capture == folder / made.name
        (tmp_path / name / settings[0]).write_text(settings[1], "utf-8")
        assert data_of(capture) is None  # gone
        (tmp_path / project).mkdir(parents=True)
        assert data_of(capture) == tmp_path / project
        (tmp_path / name / settings[0]).write_text(f"data_dir: {'x' * 5000}\n", "utf-8")
        assert data_of(capture) is None
    assert data_of(tmp_path / "elsewhere.ply") is None


# --- hostile ---------------------------------------------------------------------------------------------------------


def packed(path: Path, data: bytes, storages: dict[str, bytes] | None = None, *, how: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", how) as archive:
        archive.writestr("archive/data.pkl", data)
        for key, numbers in (storages or {}).items():
            archive.writestr(f"archive/data/{key}", numbers)
    return path


class Runs:
    """What a pickle would call."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.marker),)


def test_nothing_that_a_pickle_names_is_called(tmp_path: Path) -> None:
    marker = tmp_path / "called"
    path = packed(tmp_path / "a.pt", pickle.dumps({"splats": {"means": Runs(marker)}, "step": 3}, protocol=2))
    assert torch_file.load(path)["step"] == 3
    with pytest.raises(InputError, match=r"splats\.means: no such tensor of numbers"):
        splats.read(path)
    assert not marker.exists()
    pickle.loads(pickle.dumps(Runs(marker), protocol=2))
    assert marker.exists()  # anybody else's reader calls it


def renamed(path: Path, out: Path, change: dict[bytes, bytes]) -> Path:
    """A checkpoint with bytes of its pickle replaced."""
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(out, "w") as other:
        for member in archive.infolist():
            data = archive.read(member)
            if member.filename.endswith("data.pkl"):
                for before, after in change.items():
                    assert before in data
                    data = data.replace(before, after)
            other.writestr(member.filename, data)
    return out


def test_what_is_wrong_is_one_line(tmp_path: Path) -> None:
    whole = NERFSTUDIO.read_bytes()
    for name, data, said in (
        ("cut.ckpt", whole[: len(whole) // 2], "not a readable checkpoint"),
        ("text.ckpt", b"PK\3\4" + bytes(50), "not a readable checkpoint"),
        ("old.pt", b"\x80\x02" + bytes(50), "not a splat file that is known"),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(InputError, match=said):
            splats.read(tmp_path / name)
    cases: list[tuple[Any, str]] = [
        ([1, 2], "no dictionary was saved in it"),
        ({"step": 1}, "no splats in it"),
        ({"splats": {"features": 1}}, r"splats\.features: colours that a network makes"),
        ({"pipeline": {}}, r"pipeline\._model\.gauss_params\.means: no such tensor of numbers"),
    ]
    for value, said in cases:
        with pytest.raises(InputError, match=said):
            splats.read(packed(tmp_path / "wrong.pt", pickle.dumps(value, protocol=2)))
    memo = b"\x80\x02}r\xff\xff\xff\x7f."
    with pytest.raises(InputError, match="asks for too much memory"):
        splats.read(packed(tmp_path / "memo.pt", memo))
    with pytest.raises(InputError, match=r"no data\.pkl in it"):
        zipfile.ZipFile(tmp_path / "empty.pt", "w").writestr("a", b"")
        splats.read(tmp_path / "empty.pt")


def test_tensors_past_their_numbers_or_of_other_shapes_are_refused(tmp_path: Path) -> None:
    shape = pickle.dumps((25, 3), protocol=2)[2:-1].replace(b"q\x00", b"")
    for there, said in ((b"K\xffK\x03\x86", "a tensor past the end"), (b"K\x0aK\x03\x86", "of shape")):
        path = renamed(GSPLAT, tmp_path / f"{there[1]}.pt", {shape: there})
        with pytest.raises(InputError, match=said):
            splats.read(path)
    with zipfile.ZipFile(GSPLAT) as archive:
        members = {x.filename: archive.read(x) for x in archive.infolist()}
    with zipfile.ZipFile(tmp_path / "small.pt", "w", zipfile.ZIP_DEFLATED) as other:
        for name, data in members.items():
            other.writestr(name, data)
    with pytest.raises(InputError, match="a compressed archive"):
        splats.read(tmp_path / "small.pt")


def test_storages_start_where_zip_says(tmp_path: Path) -> None:
    """torch aligns them by what it puts between a member's name and its data."""
    with zipfile.ZipFile(io.BytesIO(GSPLAT.read_bytes())) as archive:
        starts = {
            torch_file._Reader(GSPLAT, {}, "", b"")._start(x) for x in archive.infolist() if "/data/" in x.filename
        }
    assert len(starts) > 3 and all(start % 64 == 0 for start in starts)
