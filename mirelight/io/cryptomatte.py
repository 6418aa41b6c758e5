"""Cryptomatte: which named thing a pixel shows, as the standard lays it out in an EXR file.

Psyop's "Cryptomatte Specification", version 1.2.0. A name is known by a hash (MurmurHash3, x86, 32 bit) whose bits are
stored as a float; a pixel has a list of such floats, each with the share of the pixel that the thing covers, the
largest share first. Two of those pairs fill one RGBA layer: id, share, id, share. The header says what is hashed how,
and which name has which id.
"""

from __future__ import annotations

import json

import numpy as np

from mirelight.model import F32, Matte

# What compositing programs call the layers of these, by the name in `output.aovs`.
LAYERS = {
    "cryptomatte_material": "CryptoMaterial",
    "cryptomatte_node": "CryptoObject",
    "cryptomatte_object": "CryptoAsset",
}


def murmur3(data: bytes, seed: int = 0) -> int:
    """MurmurHash3_x86_32 (Appleby)."""
    h, full = seed, len(data) // 4 * 4
    for block in np.frombuffer(data[:full], dtype="<u4").tolist():
        h = _rotated(h ^ _scattered(block), 13) * 5 + 0xE6546B64 & 0xFFFFFFFF
    h ^= _scattered(int.from_bytes(data[full:], "little")) if full < len(data) else 0
    h ^= len(data)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        h = (h ^ h >> shift) * factor & 0xFFFFFFFF
    return h ^ h >> 16


def _scattered(block: int) -> int:
    return _rotated(block * 0xCC9E2D51 & 0xFFFFFFFF, 15) * 0x1B873593 & 0xFFFFFFFF


def _rotated(value: int, by: int) -> int:
    return (value << by | value >> 32 - by) & 0xFFFFFFFF


def identity(name: str) -> int:
    """The 32 bits that stand for a name: its hash, the exponent kept within 1 to 254, so that as a float they are a
    normal number."""
    value = murmur3(name.encode("utf-8"))
    exponent = min(max(value >> 23 & 255, 1), 254)
    return value & 0x807FFFFF | exponent << 23


def layers(matte: Matte) -> dict[str, F32]:
    """The matte's pictures (H, W, 4) by the name of a file's layer."""
    bits = np.array([0, *(identity(name) for name in matte.names)], dtype=np.uint32)
    ids = bits.view(np.float32)[matte.index + 1]
    name = LAYERS[matte.name]
    pairs = np.stack([ids, matte.share], axis=-1)  # (H, W, ranks, 2)
    return {
        f"{name}{k:02d}": np.ascontiguousarray(pairs[:, :, 2 * k : 2 * k + 2].reshape(*ids.shape[:2], 4))
        for k in range(ids.shape[2] // 2)
    }


def attributes(matte: Matte) -> dict[str, str]:
    """The entries of the file's header."""
    name = LAYERS[matte.name]
    key = f"cryptomatte/{murmur3(name.encode()):08x}"[: len("cryptomatte/") + 7]
    manifest = {one: f"{identity(one):08x}" for one in matte.names}
    return {
        f"{key}/name": name,
        f"{key}/hash": "MurmurHash3_32",
        f"{key}/conversion": "uint32_to_float32",
        f"{key}/manifest": json.dumps(manifest, separators=(",", ":"), ensure_ascii=False),  # Blender reads no escapes
    }
