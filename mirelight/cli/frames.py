"""The files of a job's frames: which exist already, and writing new ones."""

from __future__ import annotations

import tempfile
from pathlib import Path

from mirelight.io import image
from mirelight.io.atomic import output_error
from mirelight.model import DisplaySettings, Frame, OutputSettings
from mirelight.pipeline import FrameTask


class FrameFiles:
    """Reads and writes the frames of one job in its output folder."""

    def __init__(self, output: OutputSettings, display: DisplaySettings) -> None:
        self.folder = output.directory
        self._output = output
        self._display = display
        self.partial: tuple[Path, ...] = ()  # of the frame that an interrupt stopped, where it could be kept

    def prepare(self) -> None:
        """Make the folder, and see that files can be written there before hours of work.

        Raises:
            OutputError: they cannot.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.folder):
                pass
        except OSError as e:
            raise output_error(self.folder, e) from None

    def exist(self, task: FrameTask) -> bool:
        """True where every file of the frame is there and was made from the same inputs."""
        return all(image.read_fingerprint(path) == task.fingerprint for path in self.paths(task))

    def write(self, task: FrameTask, frame: Frame) -> None:
        """Write the frame's files, each whole or not at all, and remove those of an earlier, interrupted try."""
        for path in self.paths(task):
            image.write(frame, path, self._display, self._output)
        for path in self.paths(task, ".partial"):
            if path.exists() and image.read_fingerprint(path) is None:
                path.unlink()

    def write_partial(self, task: FrameTask, frame: Frame) -> None:
        """Write a frame that is not done to files of its own, which :meth:`exist` never takes for the frame."""
        for path in self.paths(task, ".partial"):
            image.write(frame, path, self._display, self._output)
            self.partial = (*self.partial, path)

    def paths(self, task: FrameTask, mark: str = "") -> list[Path]:
        """The files of one frame."""
        suffixes = [suffix for suffix, wanted in ((".exr", self._output.exr), (".png", self._output.png)) if wanted]
        return [self.folder / f"{task.name}{mark}{suffix}" for suffix in suffixes]
