"""PlayCanvas from its npm package: one pinned version, fetched by npm, checked, kept in the user's cache."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tarfile
import tempfile
from collections.abc import Iterable
from importlib import resources
from pathlib import Path

from mirelight.base.errors import BackendError, OutputError
from mirelight.io.atomic import atomic_path, write_file
from mirelight.io.folders import NewFolders

VERSION = "2.23.3"  # script and engine come from the same package: uniform names changed between 2.22 and 2.23
SHA512 = (
    "8630dda39c85b55aff5a60e1e7da51ad3d4b0be45fa6ae155c1f17b7700c07c1"
    "9f5978fd27338cab7c7edc54e6abfd8bda0377eeaf55d4b31968bb98b21ccc5d"
)
FILES = {  # in the package -> in the folder that pages import from
    "package/build/playcanvas.mjs": "playcanvas.mjs",
    "package/scripts/esm/gsplat/gsplat-relighting.mjs": "gsplat-relighting.mjs",
    "package/scripts/esm/camera-controls.mjs": "camera-controls.mjs",
    "package/LICENSE": "LICENSE",
}
_FILE_LIMIT = 64 << 20
_SECONDS = 600


def cache_folder() -> Path:
    """Where fetched files are kept: $MIRELIGHT_CACHE, else the user's cache folder."""
    named = os.environ.get("MIRELIGHT_CACHE")
    if named:
        return Path(named)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "mirelight"


def installed() -> Path | None:
    """The folder with the engine's files; None where they were not fetched yet."""
    folder = cache_folder() / f"playcanvas-{VERSION}"
    return folder if all((folder / name).is_file() for name in FILES.values()) else None


def install() -> Path:
    """The folder with the engine's files, fetched with npm where they are not there yet.

    Raises:
        BackendError: npm is missing or cannot fetch the package, or the package is not the pinned one.
    """
    folder = installed()
    if folder is not None:
        return folder
    npm = shutil.which("npm")
    if npm is None:
        raise BackendError(f"PlayCanvas {VERSION} is fetched with npm, which was not found: apt-get install npm")
    base = cache_folder()
    try:
        base.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=base) as temporary:
            unpacked = _unpack(_fetch(npm, Path(temporary)), Path(temporary) / "engine")
            folder = base / f"playcanvas-{VERSION}"
            if folder.exists():  # incomplete: installed() said so
                shutil.rmtree(folder)
            unpacked.rename(folder)
    except OSError as error:
        if (raced := installed()) is not None:  # another process was faster
            return raced
        raise BackendError(f"PlayCanvas {VERSION} cannot be kept in {base}: {error.strerror or error}") from error
    return folder


def _fetch(npm: str, folder: Path) -> Path:
    """The package's archive, verified."""
    command = [npm, "pack", "--silent", "--ignore-scripts", "--pack-destination", str(folder), f"playcanvas@{VERSION}"]
    try:
        child = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=_SECONDS)
    except subprocess.TimeoutExpired:
        raise BackendError(f"npm did not deliver PlayCanvas {VERSION} within {_SECONDS} s; try again") from None
    archive = folder / f"playcanvas-{VERSION}.tgz"
    if child.returncode != 0 or not archive.is_file():
        said = (child.stderr.strip() or child.stdout.strip() or "no message").splitlines()[-1]
        raise BackendError(f"npm could not fetch PlayCanvas {VERSION}: {said}")
    if hashlib.sha512(archive.read_bytes()).hexdigest() != SHA512:
        raise BackendError(f"npm delivered another package as PlayCanvas {VERSION} than the pinned one; it is not used")
    return archive


def _unpack(archive: Path, folder: Path) -> Path:
    """Unpacks the wanted files alone of the engine's archive."""
    folder.mkdir()
    with tarfile.open(archive) as tar:
        for member in tar:
            if member.name in FILES and member.isfile() and member.size <= _FILE_LIMIT:
                source = tar.extractfile(member)
                assert source is not None
                (folder / FILES[member.name]).write_bytes(source.read())
    missing = sorted(set(FILES.values()) - {p.name for p in folder.iterdir()})
    if missing:
        raise BackendError(f"PlayCanvas {VERSION} lacks {', '.join(missing)}")
    return folder


def page_file(app: str, name: str) -> bytes:
    """One of the files that ship with an app's page."""
    return resources.files(f"mirelight.apps.{app}").joinpath("page", name).read_bytes()


def copy_page(folder: Path, app: str, page: Iterable[str], like: Path | None = None) -> None:
    """Put an app's page and the engine into a folder, made where it is missing.

    Args:
        folder: of the page; files that are there are replaced.
        app: whose page it is.
        page: names of its files.
        like: another page's folder of the engine, whose files are taken as hard links where the disk can.

    Raises:
        BackendError: the engine is not installed and cannot be fetched.
        OutputError: the folder cannot be written.
    """
    own = folder / "engine"
    source = like or install()
    NewFolders(folder, own).make()
    for name in FILES.values():
        if not linked(like, name, own):
            with atomic_path(own / name) as temporary:
                shutil.copyfile(source / name, temporary)
    for name in page:
        write_file(folder / name, page_file(app, name))


def linked(source: Path | None, name: str, folder: Path) -> bool:
    """Make a hard link to a file of another folder; False where there is none, or the disk knows no links."""
    if source is None or not (source / name).is_file():
        return False
    target = folder / name
    try:
        if target.exists() and target.samefile(source / name):
            return True
        with atomic_path(target) as temporary:
            temporary.unlink(missing_ok=True)
            os.link(source / name, temporary)
    except (OSError, OutputError):
        return False
    return True
