"""What happens before any rendering: help, versions, wrong arguments, wrong files."""

from __future__ import annotations

import argparse
import errno
import json
import os
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NoReturn

import jsonschema  # type: ignore[import-untyped]
import pytest

import mirelight
from mirelight import cli
from mirelight.base.pages import PAGES, page
from mirelight.batch import Order
from mirelight.cli import options
from mirelight.cli.command import GROUPS, Command
from mirelight.cli.commands import COMMANDS
from mirelight.io.suffixes import SCENES, SPLATS

from .conftest import COMMAND, Run

HEAVY = {"mitsuba", "drjit", "numpy", "pydantic", "rich", "OpenEXR", "trimesh", "PIL", "colour", "scipy", "tomllib"}
HEAVY |= {"json", "platform", "subprocess", "tempfile"}  # not heavy, but a fifth of the time together


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--help"],
        ["--version"],
        ["render", "--help"],
        ["inspect", "--help"],
        ["schema", "--help"],
        ["doctor", "--help"],
    ],
    ids=" ".join,
)
def test_help_loads_nothing_heavy(arguments: list[str]) -> None:
    program = f"""
import sys
import mirelight
from mirelight.cli import main
try:
    main({arguments!r})
except SystemExit:
    pass
print(sorted({HEAVY!r} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_version(run: Run) -> None:
    done = run("--version")
    assert (done.returncode, done.stdout) == (0, f"mirelight {mirelight.__version__}\n")


def test_the_installed_command_is_the_same(tmp_path: Path) -> None:
    command = Path(sys.executable).parent / "mirelight"
    done = subprocess.run([str(command), "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"mirelight {mirelight.__version__}\n"


def test_no_command_prints_help(run: Run) -> None:
    done = run()
    assert done.returncode == 2
    assert "render the frames of a job file" in done.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ["sheet", "a.png", "--size", "9" * 5000],
        ["compare", "a.png", "a.png", "--band", "9" * 5000],
        ["film", "a.png", "-o", "a.gif", "--fps", "1e999999999"],  # 10 ** 999999999 would take hours
        ["film", "a.png", "-o", "a.gif", "--fps", "1/0"],
        ["submit", "a.toml", "--slurm", "--shards", "9" * 5000],
        ["mix", "job.toml", "-o", "a", "--spp", "9" * 5000],
    ],
)
def test_numbers_without_end_are_one_line(run: Run, folder: Path, arguments: list[str]) -> None:
    done = run(*arguments)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("mirelight: ")


@pytest.mark.parametrize(
    "arguments", [["fly"], ["render"], ["render", "a", "b"], ["inspect"], ["render", "a", "--fast"]]
)
def test_wrong_arguments(run: Run, arguments: list[str]) -> None:
    assert run(*arguments).returncode == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("rendr job.toml", "no command 'rendr'; did you mean render?; mirelight --help says more"),
        ("render a.toml --camra front", "render: unknown option --camra; did you mean --camera?; mirelight render"),
        ("film out --file a.gif", "film: the following arguments are required: -o/--out; mirelight film --help"),
        ("sheet out --file a.png", "sheet: unknown option --file; did you mean --out?; mirelight sheet --help"),
        ("compare a b --html=r.html", "compare: unknown option --html; did you mean --out?; mirelight compare"),
        ("render a b", "render: one argument too many: b; mirelight render --help says more"),
        ("compare a b --tone acs", "compare: argument --tone: 'acs'; did you mean aces?; mirelight compare --help"),
        ("compare a b --tone x", "compare: argument --tone: 'x'; give one of none, aces, neutral, agx; mirelight"),
    ],
)
def test_what_was_meant_is_said(arguments: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments.split())
    assert ended.value.code == 2
    line = capsys.readouterr().err
    assert line.startswith(f"mirelight: {said}") and line.count("\n") == 1


@pytest.mark.parametrize("command", COMMANDS, ids=lambda x: x.name)
def test_help_of_every_command(command: Command, capsys: pytest.CaptureFixture[str]) -> None:
    """Examples are ones that the program takes; the page that it points to is there."""
    with pytest.raises(SystemExit):
        cli.main([command.name, "--help"])
    said = capsys.readouterr().out
    assert "\nexamples:\n  mirelight " in said
    for example in command.examples:
        assert f"  mirelight {example}\n" in said
        cli.make_parser().parse_args(shlex.split(example.partition(" > ")[0]))
    assert page(command.page) in said
    assert command.group in GROUPS and cli.make_parser().format_help().count(f"\n  {command.name} ") == 1


def test_pages_that_are_pointed_to_are_there() -> None:
    docs = Path(__file__).parents[2] / "docs"
    assert [x for x in PAGES.values() if not (docs / f"{x}.md").is_file()] == []


TRACING = {"--spp", "--denoise", "--variant", "--threads"}
LESS = {  # commands that trace light, and what they do not take of it
    "bake": {"--denoise"},  # light on splats has no picture to denoise
    "mix": {"--denoise"},
    "estimate": {"--denoise", "--spp"},  # noise would be taken for misfits
    "studio": TRACING,  # its page sets them, in the job
}
NO_LIGHT = {x.name for x in COMMANDS} - {*LESS, "demo", "explain", "match", "render", "submit", "watch"}
TEXT = {"completion", "schema", "submit", "studio", "watch"}  # what they print is the result itself, or they stay


def test_one_option_for_one_thing() -> None:
    """What is written is -o/--out; --json takes nothing, and is there wherever a command writes or tells something;
    what light is traced with can be said wherever it is traced."""
    for command in COMMANDS:
        parser = argparse.ArgumentParser()
        command.arguments(parser)
        named = {name: action for action in parser._actions for name in action.option_strings}
        assert ("-o" in named) == ("--out" in named) and named.get("-o") is named.get("--out")
        assert ("--json" in named) == (command.name not in TEXT), command.name
        assert "--json" not in named or named["--json"].nargs == 0
        tracing = TRACING if command.name in NO_LIGHT else LESS.get(command.name, set())
        assert named.keys() & TRACING == TRACING - tracing, command.name


def test_help_has_colours_on_a_terminal_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert "\x1b[" not in cli.make_parser().format_help()
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    coloured = cli.make_parser().format_help()
    assert "\x1b[" in coloured and "render" in coloured
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b[" not in cli.make_parser().format_help()


def test_the_demo_is_a_sound_job_and_what_is_changed_in_it_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[argparse.Namespace] = []

    def rendered(args: argparse.Namespace) -> int:
        asked.append(args)
        return 0

    monkeypatch.setattr("mirelight.cli.render.run_render", rendered)
    assert cli.main(["demo", "-o", str(tmp_path / "try"), "-q", "--spp", "4", "--no-denoise"]) == 0
    (args,) = asked
    assert args.job == str(tmp_path / "try" / "job.toml") and args.quiet
    assert (args.spp, args.denoise, args.threads) == ("4", False, None)
    job = mirelight.load(args.job)
    assert ([x.name for x in job.cameras], [x.name for x in job.lightings]) == (["front"], ["sunset", "spots", "lamp"])
    text = Path(args.job).read_text(encoding="utf-8")
    Path(args.job).write_text(text.replace("intensity = 14", "intensity = 20"), encoding="utf-8")
    assert cli.main(["demo", "-o", str(tmp_path / "try"), "-q"]) == 0
    assert "intensity = 20" in Path(args.job).read_text(encoding="utf-8")


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_completion(shell: str, run: Run) -> None:
    done = run("completion", shell)
    assert done.returncode == 0
    assert all(command.name in done.stdout for command in COMMANDS)
    if shell == "bash":
        for place in ("render_pos_0", "studio_pos_0", "proxy_pos_0", "sheet_pos_0", "export___out", "mix___out"):
            assert f"_shtab_mirelight_{place}_COMPGEN=" in done.stdout
        assert subprocess.run(["bash", "-n"], input=done.stdout, text=True, check=False).returncode == 0


def test_settings_by_their_own_options(folder: Path) -> None:
    """They are laid over the job, and reach another process or a script."""
    args = cli.make_parser().parse_args(["render", "job.toml", "--spp", "7", "--no-denoise", "--threads", "1"])
    order = options.order_of(args)
    assert [(x.source, x.value) for x in order.overrides()] == [
        ("--spp 7", 7),
        ("--no-denoise", False),
        ("--threads 1", 1),
    ]
    assert Order.of("job.toml", order.arguments()[1:]) == order == Order.read(order.text())
    args = cli.make_parser().parse_args(["match", "job.toml", "--target", "x.png", "-o", "y.toml", "--denoise"])
    assert [(x.source, x.path, x.value) for x in options.overrides(args)] == [
        ("--denoise", ("render", "denoise"), True)
    ]


def test_results_as_json(run: Run, folder: Path) -> None:
    plan = json.loads(run("render", "job.toml", "--camera", "front", "--dry-run", "--json").stdout)
    assert (plan["frames"], plan["there"]) == (2, 0)
    made = json.loads(run("render", "job.toml", "--camera", "front", "--lighting", "day", "--json").stdout)
    assert (made["frames"], made["skipped"], made["failed"]) == (1, 0, [])
    kept = json.loads(run("cache", "--json").stdout)
    assert set(kept) == {"folder", "things", "bytes", "most"}


@pytest.mark.parametrize("name", ["none.toml", "none.ply"])
def test_a_file_that_is_not_there(run: Run, name: str) -> None:
    """It is said before a capture is asked for its light."""
    done = run("render", name)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"mirelight: {name}: no such file; check the path\n"


@pytest.mark.parametrize("command", ["estimate", "bake", "match"])
def test_a_capture_in_place_of_a_job(run: Run, folder: Path, command: str) -> None:
    target = ["--target", "x.png"] if command == "match" else []
    done = run(command, "splats.ply", "-o", "found.ply" if command == "bake" else "found.toml", *target)
    said = "splats.ply: a capture or a mesh, not a job; name a job file; mirelight new splats.ply writes one"
    assert (done.returncode, done.stderr) == (2, f"mirelight: {said}\n")


@pytest.mark.parametrize("suffix", [x for x in SPLATS if x not in SCENES])  # a stage may hold light
def test_a_capture_without_light(suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"my capture{suffix}"
    path.write_text("splats")
    assert cli.main(["render", str(path)]) == 2
    said = f"{path}: splats, not a job; add --light sun, or write a job with: mirelight new '{path}'"  # to be pasted
    assert capsys.readouterr().err == f"mirelight: {said}\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ["new", "none.ply", "-o", "closed/a.toml"],
        ["proxy", "none.ply", "-o", "closed/a.glb"],
        ["bake", "none.toml", "-o", "closed/a.ply"],
        ["estimate", "none.toml", "-o", "closed/a.toml"],
        ["match", "none.toml", "--target", "none.png", "-o", "closed/a.toml"],
    ],
    ids=lambda x: x[0],
)
def test_a_folder_that_cannot_be_written_is_said_before_the_work(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Root may write anywhere, so the refusal is made up. What is to be read is not there: nothing looks for it."""

    def refused(*_: object, **__: object) -> NoReturn:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    (tmp_path / "closed").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tempfile, "TemporaryFile", refused)
    assert cli.main(arguments) == 2
    said = f"{arguments[-1]}: cannot be written (no permission to write there); nothing half-written was left"
    assert capsys.readouterr().err == f"mirelight: {said}\n"


def test_three_mistakes_give_three_lines(run: Run, folder: Path) -> None:
    (folder / "bad.toml").write_text('splats = "nowhere.ply"\nproxy = "proxy.glb"\n[render]\nspp = 0\nsead = 1\n')
    done = run("render", "bad.toml", "--threads", "many")
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "mirelight: bad.toml:1:10: splats: there is no file 'nowhere.ply'; "
        f"paths are relative to the job file's folder, {folder}",
        "mirelight: bad.toml:4:7: render.spp: 0; give a number of at least 1",
        "mirelight: bad.toml:5:1: render.sead: unknown key; did you mean seed?",
        "mirelight: --threads many: render.threads: 'many'; give a whole number",
    ]
    assert not (folder / "out").exists()


def test_what_is_found_out_while_tracing_names_the_job(run: Run, folder: Path) -> None:
    done = run("estimate", "job.toml", "-o", "light.toml")
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("mirelight: job.toml: ") and "too few to tell the captured light from" in line


def test_a_variant_that_does_not_exist(run: Run, folder: Path) -> None:
    done = run("render", "job.toml", "--variant", "metal")
    assert done.returncode == 2
    assert done.stderr.startswith("mirelight: --variant metal: render.variant: 'metal'; give one of \"llvm_ad_rgb\"")


def test_a_damaged_splat_file(run: Run, folder: Path) -> None:
    whole = (folder / "splats.ply").read_bytes()
    (folder / "cut.ply").write_bytes(whole[: len(whole) // 2])
    done = run("render", "job.toml", "--set", "splats=cut.ply")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1 and "cut.ply" in done.stderr


def test_names_that_the_job_does_not_have(run: Run, folder: Path) -> None:
    done = run("render", "job.toml", "--camera", "back")
    assert done.returncode == 2
    assert "no camera named 'back'; there are: front, orbit.0001, orbit.0002" in done.stderr


def test_schema(run: Run) -> None:
    done = run("schema")
    assert done.returncode == 0
    schema = json.loads(done.stdout)
    jsonschema.Draft202012Validator.check_schema(schema)
    shipped = Path(__file__).parents[2] / "docs" / "job.schema.json"
    assert done.stdout == shipped.read_text(encoding="utf-8")


def test_a_reader_that_goes_away_is_no_error() -> None:
    with subprocess.Popen([*COMMAND, "schema"], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        said = process.stderr.read()
    assert said == b""


# --- inspect ---------------------------------------------------------------------------------------------------------


def test_inspect_a_job(run: Run, folder: Path) -> None:
    facts = json.loads(run("inspect", "--json", "job.toml").stdout)
    assert facts["kind"] == "job"
    assert (facts["splats"], facts["triangles"], facts["frames"]) == (300, 2, 6)
    assert [x["name"] for x in facts["lightings"]] == ["day", "night"]
    assert facts["lightings"][0]["environment"]["mean"] == [1, 1, 1]
    assert facts["lightings"][1]["lights"][0]["intensity"] == 20
    assert [x["name"] for x in facts["cameras"]] == ["front", "orbit.0001", "orbit.0002"]
    text = run("inspect", "job.toml").stdout
    assert "6, written to" in text and "lamp: point, 20 cd" in text
    (folder / "clean.toml").write_text((folder / "job.toml").read_text() + "denoise = true\n")  # stands in [render]
    clean = json.loads(run("inspect", "--json", "clean.toml").stdout)
    assert clean["memory"] - facts["memory"] == 64 * 48 * (510 + 110)  # one layer a lighting


def test_inspect_splats_meshes_and_images(run: Run, folder: Path) -> None:
    splats = json.loads(run("inspect", "--json", "splats.ply").stdout)
    assert (splats["kind"], splats["splats"], splats["sh_degree"]) == ("splats", 300, 0)
    assert max(splats["bounds"]["high"]) == pytest.approx(1, abs=0.01)
    assert splats["memory"] == 300 * 4 * (3 + 4 + 3 + 1 + 3)
    mesh = json.loads(run("inspect", "--json", "proxy.glb").stdout)
    assert (mesh["kind"], mesh["triangles"]) == ("mesh", 2)
    assert mesh["bounds"] == {"low": [-3, -1, -3], "high": [3, -1, 3]}
    assert mesh["lights"][0]["position"] == [1, 3, 1]
    from PIL import Image

    Image.new("RGB", (8, 4), (255, 0, 0)).save(folder / "red.png")
    image = json.loads(run("inspect", "--json", "red.png").stdout)
    assert (image["kind"], image["width"], image["height"], image["mean"]) == ("image", 8, 4, [1, 0, 0])


@pytest.mark.parametrize("name", ["none.ply", "job.txt", "."])
def test_inspect_what_it_cannot(run: Run, folder: Path, name: str) -> None:
    (folder / "job.txt").write_text("hello")
    done = run("inspect", name)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
