"""Checkpoints of trainings: gsplat's ckpts/ckpt_STEP_rankR.pt and nerfstudio's nerfstudio_models/step-STEP.ckpt.

Both hold the parameters that are optimised, log scales, logit opacities, rotations wxyz of any length and SH
coefficients, N splats each: gsplat's `splats` (examples/simple_trainer.py) as means, scales, quats, opacities, sh0
(N, 1, 3) and shN (N, K, 3); nerfstudio's `pipeline` (splatfacto.py) as `_model.gauss_params.` means, scales, quats,
opacities (N, 1), features_dc (N, 3) and features_rest (N, K, 3), colours as logits where it has no SH. Of several GPUs
each saves its own splats.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mirelight.base.errors import InputError
from mirelight.base.sh import COEFFICIENTS, degree_of
from mirelight.io.splats import torch_file, values
from mirelight.io.splats.builder import ROWS, CloudBuilder, Slot
from mirelight.io.splats.info import SplatFileInfo
from mirelight.io.splats.torch_file import Tensor
from mirelight.io.splats.training import settings_beside, settings_of
from mirelight.model import SplatCloud

_RANKED = re.compile(r"(.*_rank)\d+(\.pt)", re.IGNORECASE)
_ANTIALIASED = re.compile(r"^(antialiased: true| *rasterize_mode: antialiased)", re.MULTILINE)
_NERFSTUDIO = "_model.gauss_params."


@dataclass(frozen=True, slots=True)
class _Parameters:
    """Tensors of one file, of N splats each."""

    trainer: str
    logits: bool  # whether colours are, in place of coefficients
    means: Tensor
    scales: Tensor
    quats: Tensor
    opacities: Tensor
    first: Tensor  # SH coefficients of degree 0
    rest: Tensor  # (N, K, 3) those above

    @property
    def count(self) -> int:
        """Splats."""
        return self.means.shape[0]

    @property
    def kept(self) -> int:
        """Coefficients above degree 0 that are read."""
        return min(self.rest.shape[1], COEFFICIENTS[3] - 1)

    def fill(self, slot: Slot, start: int) -> None:
        """Write the splats from `start` on into a slot."""
        end = start + len(slot.means)
        slot.means[:] = self.means.rows(start, end)
        slot.quats[:] = self.quats.rows(start, end)
        values.exponential(self.scales.rows(start, end), out=slot.scales)
        values.sigmoid(self.opacities.rows(start, end).reshape(-1), out=slot.opacities)
        color = self.first.rows(start, end).reshape(-1, 3)
        if self.logits:
            values.sigmoid(color.copy(), out=color)
            color = values.dc_from_rgb(color)
        slot.sh[:, 0] = color
        slot.sh[:, 1:] = self.rest.rows(start, end)[:, : self.kept]


def summary(path: Path) -> SplatFileInfo:
    """What a checkpoint holds. Raises InputError."""
    found = _all(path)
    notes = [f"{len(found)} files, one of each GPU"] if len(found) > 1 else []
    return SplatFileInfo(
        path=path,
        format=f"checkpoint of {found[0].trainer}",
        count=sum(x.count for x in found),
        sh_degree=degree_of(1 + found[0].kept),
        antialiased=_is_antialiased(path),
        notes=tuple(notes),
    )


def read(path: Path) -> SplatCloud:
    """The splats of a checkpoint and of those beside it that other GPUs saved. Raises InputError."""
    found = _all(path)
    builder = CloudBuilder(path, sum(x.count for x in found), 1 + found[0].kept)
    for one in found:
        for start in range(0, one.count, ROWS):
            slot = builder.slot(min(ROWS, one.count - start))
            one.fill(slot, start)
            builder.commit(slot)
    return builder.cloud(antialiased=_is_antialiased(path))


def files(path: Path) -> list[Path]:
    """A checkpoint with the others that were saved at that step, by their GPUs' numbers, and the settings beside them:
    all that :func:`read` opens."""
    settings = settings_beside(path)
    return _of_step(path) if settings is None else [*_of_step(path), settings]


def _of_step(path: Path) -> list[Path]:
    named = _RANKED.fullmatch(path.name)
    return sorted(path.parent.glob(f"{_literal(named[1])}*{named[2]}"), key=_number) if named else [path]


def _all(path: Path) -> list[_Parameters]:
    found = [_parameters(x) for x in _of_step(path)]
    if any(x.kept != found[0].kept for x in found):
        raise InputError(path, "GPUs that saved SH of different degrees", "keep the files of one training beside it")
    return found


def _literal(name: str) -> str:
    return re.sub(r"([*?[])", r"[\1]", name)


def _number(path: Path) -> int:
    return int(re.findall(r"\d+", path.name)[-1])


def _parameters(path: Path) -> _Parameters:
    saved = torch_file.load(path)
    if isinstance(splats := saved.get("splats"), dict):
        if "features" in splats:
            remedy = "write a PLY as it trains (--save-ply)"
            raise InputError(path, "colours that a network makes (app_opt)", remedy, field="splats.features")
        names = ("means", "scales", "quats", "opacities", "sh0", "shN")
        tensors = [_tensor(path, splats, name, "splats.") for name in names]
        return _checked(path, _Parameters("gsplat", False, *tensors))
    if isinstance(pipeline := saved.get("pipeline"), dict):
        names = ("means", "scales", "quats", "opacities", "features_dc", "features_rest")
        tensors = [_tensor(path, pipeline, _NERFSTUDIO + name, "pipeline.") for name in names]
        bare = len(tensors[5].shape) == 3 and not tensors[5].shape[1]
        return _checked(path, _Parameters("nerfstudio", bare, *tensors))
    raise InputError(path, "no splats in it", "give a checkpoint of gsplat or of nerfstudio's splatfacto, or a PLY")


def _tensor(path: Path, saved: dict[str, Any], name: str, where: str) -> Tensor:
    found = saved.get(name)
    if not isinstance(found, Tensor):
        remedy = "give a checkpoint of gsplat or of nerfstudio's splatfacto, or a PLY"
        raise InputError(path, "no such tensor of numbers", remedy, field=where + name)
    return found


def _checked(path: Path, found: _Parameters) -> _Parameters:
    """Raises InputError: shapes that do not fit each other."""
    count = found.means.shape[0] if found.means.shape else 0
    of_three = (found.means, found.scales, found.first)
    for one, wide in (*((x, 3) for x in of_three), (found.quats, 4), (found.opacities, 1)):
        if one.shape[:1] != (count,) or int(np.prod(one.shape[1:], dtype=object)) != wide:
            raise InputError(path, f"a tensor of shape {one.shape} for {count:,} splats", "the file is damaged")
    shape = found.rest.shape
    if shape[:1] != (count,) or len(shape) != 3 or shape[2] != 3 or 1 + shape[1] not in (1, 4, 9, 16, 25):
        raise InputError(path, f"SH coefficients of shape {shape} for {count:,} splats", "the file is damaged")
    return found


def _is_antialiased(path: Path) -> bool:
    """Whether the settings that a training left say so: gsplat's cfg.yml, nerfstudio's config.yml."""
    return _ANTIALIASED.search(settings_of(path)) is not None
