"""What whoever watches a run hears of its frames, from whichever process makes them."""

from __future__ import annotations

from pathlib import Path

from mirelight.base.errors import MirelightError
from mirelight.batch import messages
from mirelight.batch.executor import Progress, RenderSummary
from mirelight.batch.messages import Word
from mirelight.pipeline.plan import FrameTask, Group
from mirelight.store import Store


class FrameTally:
    """Counts frames, each once however often it is told of, and passes on what is said."""

    def __init__(self, store: Store, progress: Progress) -> None:
        self.store, self.progress = store, progress
        self.done = RenderSummary(rendered=0, skipped=0)
        self._told: set[str] = set()  # frames that were counted
        self._notes: set[str] = set()

    def hear(self, group: Group | None, word: Word) -> FrameTask | None:
        """Take a word of a process that is at a camera; its frame where it is about one's samples.

        Raises:
            MirelightError: the process met what stops everything, in its words.
        """
        values = word.values
        task = _task(group, str(values[0])) if values else None
        match word.kind:
            case messages.SAMPLES if task is not None:
                self.progress.samples(task, int(values[1]), int(values[2]))
                return task
            case messages.FINISHED if task is not None and self._first(task):
                self.progress.finished(task, float(values[1]) if len(values) > 1 else None)
            case messages.FAILED if task is not None and self._first(task):
                self.progress.failed(task, str(values[1]))
            case messages.NOTE if str(values[0]) not in self._notes:  # every process says what it finds of the job
                self._notes.add(str(values[0]))
                self.progress.note(str(values[0]))
            case messages.DONE:
                rendered, skipped, failed = (int(x) for x in values)
                self.done += RenderSummary(rendered=rendered, skipped=skipped, failed=failed)
            case messages.PARTIAL:
                new = (Path(str(x)) for x in values)
                self.store.partial = tuple(dict.fromkeys((*self.store.partial, *new)))
            case messages.FATAL:
                raise MirelightError(str(values[0]))
            case _:
                pass
        return None

    def give_up(self, group: Group, error: str) -> None:
        """What is missing of a camera cannot be made."""
        self.store.refresh()
        failed = [task for task in group.tasks if group.layers or not self.store.has(task)]
        for task in failed:
            self.store.put_failed(task, error)
            if self._first(task):
                self.progress.failed(task, error)
        there = len(group.tasks) - len(failed)
        self.done += RenderSummary(rendered=there, skipped=0, failed=len(failed))

    def _first(self, task: FrameTask) -> bool:
        """Whether a frame is heard of for the first time: a camera may be given out again."""
        new = task.name not in self._told
        self._told.add(task.name)
        return new


def _task(group: Group | None, name: str) -> FrameTask | None:
    return next((task for task in group.tasks if task.name == name), None) if group is not None else None
