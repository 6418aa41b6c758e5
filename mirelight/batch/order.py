"""What to render, as text: it can be sent to another process or machine, which makes the same plan of it."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from mirelight.base.errors import InputError
from mirelight.io import job
from mirelight.io.job.overrides import Override, parse
from mirelight.model import Job, digest
from mirelight.pipeline.plan import Group, Plan, plan

_DENOISE = {"--denoise": True, "--no-denoise": False}


@dataclass(frozen=True, slots=True)
class Shard:
    """A part of a job's cameras: of every `count` of them the one at `index`, whatever exists already."""

    index: int  # 1 to count
    count: int

    @staticmethod
    def parse(text: str) -> Shard:
        """The shard that a text such as "2/8" names.

        Raises:
            InputError: it is not of that form.
        """
        found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text.strip())
        if found is None or not 1 <= int(found[1]) <= int(found[2]):
            raise InputError(f"--shard {text}", "not a part of a whole", "write 1/8 for the first of eight parts")
        return Shard(int(found[1]), int(found[2]))

    def of(self, whole: Plan) -> Plan:
        """The part of a plan. All parts together are the plan, and no two share a camera."""
        return replace(whole, groups=whole.groups[self.index - 1 :: self.count])


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """A render command, as the user gave it."""

    job: str  # path of the job file
    settings: tuple[str, ...] = ()  # "key=value" each
    spp: str | None = None
    denoise: bool | None = None
    variant: str | None = None
    threads: str | None = None
    out: str | None = None  # folder; None: the job's
    cameras: tuple[str, ...] | None = None  # names and patterns; None: all
    lightings: tuple[str, ...] | None = None

    def text(self) -> str:
        """The order as JSON text, which :meth:`read` takes."""
        return json.dumps(asdict(self))

    @staticmethod
    def read(text: str) -> Order:
        """The order that :meth:`text` has written."""
        entry = json.loads(text)
        values: dict[str, Any] = {name: tuple(x) if isinstance(x, list) else x for name, x in entry.items()}
        return Order(**values)

    def anywhere(self) -> Order:
        """The same order with absolute paths, for a process in another folder."""
        out = None if self.out is None else str(Path(self.out).absolute())
        return replace(self, job=str(Path(self.job).absolute()), out=out)

    def load(self) -> Job:
        """The job with all that was laid over it.

        Raises:
            InputError, ManyInputsError: see `mirelight.load`.
        """
        work = job.load(self.job, self.overrides())
        if self.out is None:
            return work
        return replace(work, output=replace(work.output, directory=Path(self.out).absolute()))

    def plan(self, work: Job) -> Plan:
        """The chosen frames of the loaded job.

        Raises:
            InputError: see `mirelight.pipeline.plan.plan`.
        """
        return plan(
            work,
            cameras=named(self.cameras, [x.name for x in work.cameras]),
            lightings=named(self.lightings, [x.name for x in work.lightings]),
        )

    def arguments(self) -> list[str]:
        """What to write behind `mirelight render` for this order."""
        options = [("--set", x) for x in self.settings]
        options += [("--spp", self.spp)] if self.spp is not None else []
        options += [("--variant", self.variant)] if self.variant is not None else []
        options += [("--threads", self.threads)] if self.threads is not None else []
        options += [("--out", self.out)] if self.out is not None else []
        options += [("--camera", x) for x in self.cameras or ()]
        options += [("--lighting", x) for x in self.lightings or ()]
        switches = [] if self.denoise is None else ["--denoise" if self.denoise else "--no-denoise"]
        return [self.job, *switches, *(f"{name}={value}" for name, value in options)]

    @staticmethod
    def of(job: str, arguments: Sequence[str]) -> Order:
        """Back from :meth:`arguments`, the job's path apart; what is none of them is left out."""
        found: dict[str, list[str]] = {}
        for text in arguments:
            option, _, value = text.partition("=")
            found.setdefault(option, []).append(value)

        def last(option: str) -> str | None:
            return found.get(option, [None])[-1]

        return Order(
            job=job,
            settings=tuple(found.get("--set", ())),
            spp=last("--spp"),
            denoise=next((wanted for name, wanted in _DENOISE.items() if name in found), None),
            variant=last("--variant"),
            threads=last("--threads"),
            out=last("--out"),
            cameras=tuple(found["--camera"]) if "--camera" in found else None,
            lightings=tuple(found["--lighting"]) if "--lighting" in found else None,
        )

    def overrides(self) -> list[Override]:
        """What is laid over the job file, in order."""
        found = [parse(text) for text in self.settings]
        if self.spp is not None:
            found.append(replace(parse(f"render.spp={self.spp}"), source=f"--spp {self.spp}"))
        if self.denoise is not None:
            source = "--denoise" if self.denoise else "--no-denoise"
            found.append(Override(source, ("render", "denoise"), self.denoise))
        if self.variant is not None:
            found.append(Override(f"--variant {self.variant}", ("render", "variant"), self.variant))
        if self.threads is not None:
            source = f"--threads {self.threads}"
            found.append(replace(parse(f"render.threads={self.threads}"), source=source))
        return found


def fingerprint(group: Group) -> str:
    """One digest over the names and keys of a camera's frames: who plans the same gets the same."""
    return digest(
        "group", group.name, [(task.name, sorted(task.files.items())) for task in group.tasks], sorted(group.layers)
    )


def named(wanted: Sequence[str] | None, names: Sequence[str]) -> list[str] | None:
    """The names that are meant: by name, by pattern, or all frames of a sequence (orbit: orbit.0001, …).

    What fits nothing is left as it is, for `plan` to refuse.
    """
    if wanted is None:
        return None
    found: list[str] = []
    for name in wanted:
        sequence = re.compile(re.escape(name) + r"\.\d{4,}")
        fits = [x for x in names if x == name or fnmatchcase(x, name) or sequence.fullmatch(x)]
        found += fits or [name]
    return found
