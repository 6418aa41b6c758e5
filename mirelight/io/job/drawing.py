"""How splats are drawn, by what the job says, or else by what their files say; and how pictures are shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from mirelight.io import views
from mirelight.io.job.background_tables import ENVIRONMENT, TRANSPARENT, BackgroundTable
from mirelight.io.job.hashing import file_digest
from mirelight.io.job.mistakes import Mistake
from mirelight.io.job.settings_tables import DisplayTable
from mirelight.io.job.source import Source
from mirelight.io.job.tables import JobTable
from mirelight.io.splats.info import SplatFileInfo
from mirelight.io.suffixes import SCENES
from mirelight.model import (
    Backdrop,
    CompositorSettings,
    DisplaySettings,
    Ground,
    SplatColorSpace,
    SplatFile,
    rules_of,
)
from mirelight.model.scene import holds_light

_DEFAULT = CompositorSettings()
_T = TypeVar("_T")


def compositor(table: JobTable, files: Sequence[SplatFile], wrong: list[Mistake]) -> CompositorSettings:
    """The settings, with what files decide filled in: the colour space, the order, and where splats end.

    Raises:
        InputError: a file cannot be used, as far as its head shows it.
    """
    said = [_said(file) for file in files]
    chosen = table.compositor.model_dump()
    chosen["sort"] = chosen["sort"] or _common([x.sort if x else None for x in said]) or _DEFAULT.sort
    return CompositorSettings(
        profile=table.profile,
        color_space=_color_space(table, files, said, wrong),
        cutoff=_common([x.cutoff if x else None for x in said]),
        **chosen,
    )


def display(source: Source, table: DisplayTable, used: Callable[[str], Path]) -> DisplaySettings:
    """How PNGs are made; a view is looked up in its config now.

    Args:
        source: the job file.
        table: its table.
        used: hears of a file, by the name that the job gives it, and says where it is.

    Raises:
        BackendError: a view without OpenColorIO.
        InputError: the config cannot be used, or does not have the view; the background's picture cannot be read.
    """
    chosen = table.model_dump(exclude={"config", "display", "background"}) | _background(table.background, used)
    if table.view is not None:
        folder, config = source.folder, table.config
        chosen["view"] = views.resolve(source.shown, table.view, config=config, display=table.display, folder=folder)
        if config is not None and not config.startswith(views.BUILT_IN):
            used(config)
    return DisplaySettings(**chosen)


def _background(table: BackgroundTable, used: Callable[[str], Path]) -> dict[str, Any]:
    """What lies behind the splats, as fields of the settings."""
    if table.color is not None:
        return {"background": tuple(table.color)}
    if table.path == TRANSPARENT:
        return {"transparent": True}
    picture, identity, ground = None, "", None
    if table.path not in (None, ENVIRONMENT):
        assert table.path is not None
        file = used(table.path)
        picture, identity = str(file), file_digest(file)
    if table.ground is not None:
        ground = Ground(**{**table.ground.model_dump(), "center": tuple(table.ground.center)})
    chosen = Backdrop(picture=picture, identity=identity, exposure=table.exposure, blur=table.blur, ground=ground)
    return {"backdrop": chosen}


def _said(file: SplatFile) -> SplatFileInfo | None:
    """The head of a file whose format says how splats are drawn; None: it does not."""
    if file.path.suffix.lower() not in SCENES:
        return None
    from mirelight.io import splats

    return splats.summary(file.path)


def _common(found: Sequence[_T | None]) -> _T | None:
    """What all files say; None where one says nothing, or another thing."""
    return found[0] if found and len(set(found)) == 1 else None


def _color_space(
    table: JobTable, files: Sequence[SplatFile], said: Sequence[SplatFileInfo | None], wrong: list[Mistake]
) -> SplatColorSpace:
    own = [x.color_space if x else _DEFAULT.color_space for x in said]
    spaces = [file.color_space or space for file, space in zip(files, own, strict=True)]
    for k, space in enumerate(spaces):
        at = ("splats", k, "color_space")
        if space != spaces[0]:
            found = f"splats in {space} beside others in {spaces[0]}"
            wrong.append(Mistake(at, found, "leave one kind out: all splats of a picture blend in one space"))
        elif holds_light(space) and rules_of(table.profile).splats.pipelines:
            found = f"splats in {space}, which the real-time engine does not know"
            wrong.append(Mistake(at, found, 'use profile = "physical"'))
    return spaces[0] if spaces else _DEFAULT.color_space
