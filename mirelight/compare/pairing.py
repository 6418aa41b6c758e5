"""Which picture belongs to which: files one by one, or folders of frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mirelight.base.errors import InputError
from mirelight.compare.pictures import DISPLAY, ENGINE_PICTURES, LINEAR, existing
from mirelight.compare.types import Pair, Pairing

_FRAME = ENGINE_PICTURES[0]


def find_pairs(references: Sequence[Path], tests: Sequence[Path], mask: Path | None = None) -> Pairing:
    """Pairs of files: given one by one, or as folders whose frames are matched by name.

    A frame of a folder is a file, named without its extension (an EXR goes before a PNG), or a folder that `mirelight
    realtime` wrote, whose `frame.png` bears the folder's name.

    Args:
        references: files or folders.
        tests: as many, in the same order; where a reference is a folder, so is its test.
        mask: a picture for all pairs, or a folder with a picture for each by name.

    Returns:
        The pairs, and the frames of either side that have no partner.

    Raises:
        InputError: counts differ, a path is missing, or two folders have no frame in common.
    """
    if len(references) != len(tests):
        found = f"{len(references)} references and {len(tests)} tests"
        raise InputError("compare", found, "give as many of one as of the other")
    pairs: list[Pair] = []
    without_test: list[str] = []
    without_reference: list[str] = []
    for reference, test in zip(references, tests, strict=True):
        if not (reference.is_dir() and test.is_dir()):
            a, b = existing(_picture(reference)), existing(_picture(test))
            pairs.append(Pair(name=_name(a), reference=a, test=b, mask=_mask_of(_name(a), mask)))
            continue
        wanted, offered = _frames(reference), _frames(test)
        for folder, frames in ((reference, wanted), (test, offered)):
            if not frames:
                raise InputError(folder, "no EXR, PNG, JPEG or WebP file in this folder")
        common = [name for name in wanted if name in offered]
        if not common:
            named = f"{_few(list(wanted))} there, {_few(list(offered))} here"
            raise InputError(test, f"no frame of {reference} by name ({named})", "name them alike, without extension")
        pairs += [
            Pair(name=name, reference=wanted[name], test=offered[name], mask=_mask_of(name, mask)) for name in common
        ]
        without_test += [f"{name}: no partner in {test}" for name in wanted if name not in offered]
        without_reference += [f"{name}: no partner in {reference}" for name in offered if name not in wanted]
    return Pairing(
        pairs=tuple(_named_apart(pairs)), without_test=tuple(without_test), without_reference=tuple(without_reference)
    )


def _picture(path: Path) -> Path:
    """A file as it is; for a folder that the engine filled, its frame."""
    if not path.is_dir():
        return path
    if not (path / _FRAME).is_file():
        raise InputError(path, "one side is a folder, the other is not", "give two files or two folders")
    return path / _FRAME


def _name(file: Path) -> str:
    return file.parent.name if file.name == _FRAME and (file.parent / "meta.json").is_file() else file.stem


def _frames(folder: Path) -> dict[str, Path]:
    """The pictures of a folder by name, sorted."""
    order = {suffix: k for k, suffix in enumerate(LINEAR + DISPLAY)}
    found: dict[str, Path] = {}
    entries = sorted(entry for entry in folder.iterdir() if not entry.name.startswith("."))
    files = [entry for entry in entries if entry.suffix.lower() in order and entry.is_file()]
    for file in sorted(files, key=lambda f: order[f.suffix.lower()]):
        found.setdefault(file.stem, file)
    for entry in entries:
        if (entry / _FRAME).is_file():
            found.setdefault(entry.name, entry / _FRAME)
    return dict(sorted(found.items()))


def _few(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _mask_of(name: str, mask: Path | None) -> Path | None:
    if mask is None or not mask.is_dir():
        return mask
    masks = _frames(mask)
    if name not in masks:
        raise InputError(mask, f"no mask for {name}", "name masks as the frames")
    return masks[name]


def _named_apart(pairs: list[Pair]) -> list[Pair]:
    """Pairs of the same name from several folders get their folder's name in front."""
    names = [p.name for p in pairs]
    return [
        Pair(name=f"{p.reference.parent.name}/{p.name}", reference=p.reference, test=p.test, mask=p.mask)
        if names.count(p.name) > 1
        else p
        for p in pairs
    ]
