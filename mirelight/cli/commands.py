"""The table of commands: the order in which help lists them, and where each is found."""

from __future__ import annotations

from mirelight.cli import (
    bake,
    cache,
    compare,
    demo,
    estimate,
    explain,
    export,
    film,
    inspect,
    match,
    mix,
    new,
    orders,
    proxy,
    realtime,
    sheet,
    small,
    status,
    studio,
    verify,
)
from mirelight.cli.command import Command

COMMANDS: tuple[Command, ...] = (
    small.DOCTOR,
    demo.COMMAND,
    new.COMMAND,
    studio.COMMAND,
    proxy.COMMAND,
    estimate.COMMAND,
    small.COMPLETION,
    orders.RENDER,
    orders.WATCH,
    orders.SUBMIT,
    status.COMMAND,
    match.COMMAND,
    bake.COMMAND,
    inspect.COMMAND,
    mix.COMMAND,
    sheet.COMMAND,
    film.COMMAND,
    compare.COMMAND,
    realtime.COMMAND,
    explain.COMMAND,
    export.COMMAND,
    verify.COMMAND,
    cache.COMMAND,
    small.SCHEMA,
)
