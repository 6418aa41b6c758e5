"""Writers of moving pictures: H.264 by PyAV or by ffmpeg, GIF and animated WebP by Pillow."""

from __future__ import annotations

import itertools
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mirelight.apps.show import yuv
from mirelight.base import extras
from mirelight.base.errors import InputError, OutputError
from mirelight.io.safety import require_memory
from mirelight.io.sheet import spread

SUFFIXES = (".mp4", ".gif", ".webp")

_QUALITY = "16"  # x264's constant rate factor: differences from the frames are hard to see
_THREADS = "4"  # a fixed number: x264's bits depend on how many there are, not on what else runs
_FASTEST_GIF = 50  # pictures a second; browsers slow down what is faster
_PALETTE_PICTURES = 12  # whose colours a GIF's palette is made of
_OPTIONS = {"crf": _QUALITY, "preset": "medium", "threads": _THREADS, "profile": "high"}


class Frames(Protocol):
    """Pictures of one size, made one by one."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""

    def __len__(self) -> int: ...

    def __getitem__(self, i: int) -> NDArray[np.uint8]: ...


Write = Callable[[Frames, Path, Fraction], None]  # pictures, where to, pictures a second


def encoder_of(path: Path, rate: Fraction) -> Write:
    """What writes the file that a suffix asks for; looks for its tool now, before any picture is made.

    Raises:
        OutputError: another suffix. InputError: no such tool here, or a rate that the format cannot have.
    """
    suffix = path.suffix.lower()
    if suffix == ".gif" and rate > _FASTEST_GIF:
        raise InputError("--fps", str(rate), f"a GIF shows at most {_FASTEST_GIF} pictures a second")
    if suffix in (".gif", ".webp"):
        return _gif if suffix == ".gif" else _webp
    if suffix != ".mp4":
        found = path.suffix or "without a suffix"
        raise OutputError(f"{path}: a film is written as .mp4, .gif or .webp, not {found}")
    if _has_pyav():
        return _pyav
    if shutil.which("ffmpeg"):
        return _ffmpeg
    raise InputError(
        path,
        "nothing here writes H.264",
        extras.remedy("film"),
    )


def _has_pyav() -> bool:
    if extras.missing("film"):
        return False
    import av

    try:
        av.codec.Codec("libx264", "w")
    except Exception:  # PyAV's own error for a library built without it
        return False
    return True


# --- H.264 -----------------------------------------------------------------------------------------------------------


def _pyav(frames: Frames, path: Path, rate: Fraction) -> None:
    import av

    width, height = (x + x % 2 for x in frames.size)
    with av.open(str(path), "w", format="mp4", options={"movflags": "+faststart", "fflags": "+bitexact"}) as film:
        stream: Any = film.add_stream("libx264", rate=rate, options=_OPTIONS)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        context = stream.codec_context
        context.color_primaries = context.color_trc = context.colorspace = context.color_range = 1  # BT.709, limited
        for i in range(len(frames)):
            stacked = np.concatenate([x.reshape(-1) for x in _even_planes(frames[i])])
            frame = av.VideoFrame.from_ndarray(stacked.reshape(-1, width), format="yuv420p")
            frame.pts = i
            film.mux(stream.encode(frame))
        film.mux(stream.encode(None))


def _ffmpeg(frames: Frames, path: Path, rate: Fraction) -> None:
    width, height = (x + x % 2 for x in frames.size)
    tags = [x for name in ("primaries", "trc") for x in (f"-color_{name}", "bt709")]
    tags += ["-colorspace", "bt709", "-color_range", "tv"]
    command = ["ffmpeg", "-v", "error", "-nostdin", "-y", "-f", "rawvideo", "-pix_fmt", "yuv420p"]
    command += ["-s", f"{width}x{height}", "-r", str(rate), *tags, "-i", "pipe:0", "-c:v", "libx264"]
    command += [x for name, value in _OPTIONS.items() for x in (f"-{name}:v", value)]
    command += ["-pix_fmt", "yuv420p", *tags, "-movflags", "+faststart", "-fflags", "+bitexact", "-f", "mp4", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        try:
            for i in range(len(frames)):
                for plane in _even_planes(frames[i]):
                    process.stdin.write(plane.tobytes())
            _, said = process.communicate()
        except BrokenPipeError:
            process.wait()
            said = process.stderr.read() if process.stderr is not None else b""
        except BaseException:
            process.kill()
            raise
    if process.returncode != 0:
        lines = said.decode(errors="replace").strip().splitlines() or ["no reason given"]
        raise OutputError(f"{path}: ffmpeg could not write it ({lines[-1]})")


def _even_planes(pixels: NDArray[np.uint8]) -> yuv.Planes:
    return yuv.planes(yuv.even(pixels))


# --- Pillow ----------------------------------------------------------------------------------------------------------


def _gif(frames: Frames, path: Path, rate: Fraction) -> None:
    from PIL import Image

    width, height = frames.size
    require_memory(path, len(frames) * width * height * 2, "a GIF of so many pictures")
    some = [frames[i][::2, ::2] for i in spread(len(frames), _PALETTE_PICTURES)]
    colors = np.concatenate([x.reshape(-1, 3) for x in some])[None]
    palette = Image.fromarray(colors).quantize(255, method=Image.Quantize.MEDIANCUT)
    pictures = (Image.fromarray(frames[i]).quantize(palette=palette) for i in range(len(frames)))
    _animate(pictures, path, "GIF", [10 * x for x in durations(len(frames), rate, 100)], {"optimize": False})


def _webp(frames: Frames, path: Path, rate: Fraction) -> None:
    from PIL import Image

    pictures = (Image.fromarray(frames[i]) for i in range(len(frames)))
    _animate(pictures, path, "WEBP", durations(len(frames), rate, 1000), {"quality": 85, "method": 4})


def _animate(pictures: Iterator[Any], path: Path, kind: str, lasting: Sequence[int], options: dict[str, Any]) -> None:
    first = next(pictures)
    with path.open("wb") as stream:
        first.save(
            stream, format=kind, save_all=True, append_images=pictures, duration=list(lasting), loop=0, **options
        )


def durations(count: int, rate: Fraction, ticks: int) -> list[int]:
    """How long each of `count` pictures is shown, in ticks, `ticks` to the second: no rounding adds up."""
    ends = [round(i * ticks / rate) for i in range(count + 1)]
    return [max(1, b - a) for a, b in itertools.pairwise(ends)]
