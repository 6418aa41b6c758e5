"""SOG version 1, which no current tool writes: an encoder for small clouds, from the format's description."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mirelight.model import SplatCloud


def pack_sog_v1(cloud: SplatCloud, folder: Path) -> Path:
    """A version 1 SOG folder of 60 splats, written out from the format's description."""

    def image(name: str, pixels: NDArray[np.uint8], width: int = 8) -> str:
        rows = -(-len(pixels) // width)
        padded = np.zeros((rows * width, 4), dtype=np.uint8)
        padded[: len(pixels), : pixels.shape[1]] = pixels
        if pixels.shape[1] < 4:
            padded[:, 3] = 255
        Image.fromarray(padded.reshape(rows, width, 4)).save(folder / name, lossless=True, exact=True)
        return name

    def between(value: NDArray[np.float64], top: int) -> tuple[NDArray[np.int64], list[float], list[float]]:
        low, high = value.min(axis=0), value.max(axis=0)
        return np.round((value - low) / (high - low) * top).astype(int), low.tolist(), high.tolist()

    means = cloud.means.astype(np.float64)
    code, low, high = between(np.sign(means) * np.log1p(np.abs(means)), 65535)
    meta: dict[str, dict[str, object]] = {
        "means": {"shape": [len(cloud), 3], "mins": low, "maxs": high, "files": ["means_l.webp", "means_u.webp"]}
    }
    image("means_l.webp", (code & 255).astype(np.uint8))
    image("means_u.webp", (code >> 8).astype(np.uint8))
    code, low, high = between(np.log(cloud.scales.astype(np.float64)), 255)
    meta["scales"] = {"mins": low, "maxs": high, "files": [image("scales.webp", code.astype(np.uint8))]}
    q = cloud.quats.astype(np.float64)
    largest = np.abs(q).argmax(axis=1)
    q *= np.sign(q[np.arange(len(q)), largest])[:, None]
    three = np.array([np.delete(row, i) for row, i in zip(q, largest, strict=True)])
    packed = np.concatenate([np.round((three * np.sqrt(2) * 0.5 + 0.5) * 255), 252 + largest[:, None]], axis=1)
    meta["quats"] = {"files": [image("quats.webp", packed.astype(np.uint8))]}
    o = np.clip(cloud.opacities.astype(np.float64), 0.01, 0.99)
    code, low, high = between(np.concatenate([cloud.sh[:, 0], np.log(o / (1 - o))[:, None]], axis=1), 255)
    meta["sh0"] = {"mins": low, "maxs": high, "files": [image("sh0.webp", code.astype(np.uint8))]}
    rest = cloud.sh.shape[1] - 1
    if rest:
        code, low_, high_ = between(cloud.sh[:, 1:].reshape(-1, 1).astype(np.float64), 255)
        palette = np.zeros((64, rest, 3), dtype=np.uint8)
        palette[: len(cloud)] = code.reshape(-1, rest, 3)
        labels = np.stack([np.arange(len(cloud)), np.zeros(len(cloud))], axis=1).astype(np.uint8)
        files = [image("c.webp", palette.reshape(-1, 3), 64 * rest), image("l.webp", labels)]
        meta["shN"] = {"mins": low_[0], "maxs": high_[0], "files": files}
    (folder / "meta.json").write_text(json.dumps(meta))
    return folder / "meta.json"
