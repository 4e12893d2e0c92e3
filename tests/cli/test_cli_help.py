"""Help, README and topics: complete, true (console blocks run), no wider than a terminal."""

import re
import shlex
import shutil
from contextlib import nullcontext
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from cli_runner import TWO_FOLDS, UNDRAWN, done, mtu
from support import ROOT

from mtu_cli import __version__, checks
from mtu_cli.cli.commands import app
from mtu_cli.findings import CATALOGUE
from mtu_cli.help import ORDER, paragraph, topic

COMMANDS = typer.main.get_command(app).commands  # type: ignore[attr-defined]  # a group has them
GRAPH = [("graph", name) for name in COMMANDS["graph"].commands]
TYPES = r"<\S+>|\[(?:Path|str|int|float)\]|\b(?:PATH|TEXT|INTEGER|FLOAT)\b"
README = (ROOT / "README.md").read_text("utf-8")
PAGES = {"README": README} | {name: topic(name) for name in ORDER}
CONSOLE = re.compile(r"^```console\n(.*?)^```", re.DOTALL | re.MULTILINE)
SAVED = re.compile(r"Save this as `(out/\S+)`:\n\n```yaml\n(.*?)```", re.DOTALL)


@cache
def help_of(*words: str) -> str:
    return done(mtu(*words, "--help", env={"COLUMNS": "100"})).stdout


@pytest.mark.parametrize("words", [*((name,) for name in COMMANDS), *GRAPH], ids=" ".join)
def test_help_tells_every_option_once_in_a_sentence(words: tuple[str, ...]) -> None:
    command: Any = COMMANDS[words[0]]
    for word in words[1:]:
        command = command.commands[word]
    shown = help_of(*words)
    assert max(map(len, shown.splitlines())) <= 100
    assert not re.findall(TYPES, shown)
    assert done(mtu(*words, "-h", env={"COLUMNS": "100"})).stdout == shown
    plain = " ".join(re.sub("[^\x20-\x7e]", " ", shown).split())
    assert command.help in plain
    for parameter in command.params:
        says, takes = parameter.help or "", not getattr(parameter, "is_flag", False)
        assert re.fullmatch(r"(?s)[A-Z(\w-].{4,}[.;].*|.{5,}\.", says), parameter.name
        assert says[-1] in ".)", parameter.name
        assert (parameter.metavar is not None) == takes, parameter.name
        if parameter.param_type_name == "argument":
            assert re.search(rf"(?m)^[│|* ]+{parameter.metavar}  +[A-Za-z]", shown), parameter.name
        elif takes:
            word = re.escape(parameter.metavar)
            assert re.search(rf"{parameter.opts[-1]} +(-\w +)?{word} ", shown), parameter.name
        else:
            assert all(option in plain for option in parameter.opts)


def test_help_of_the_whole() -> None:
    shown = help_of()
    assert max(map(len, shown.splitlines())) <= 100
    assert [name for name in COMMANDS if f" {name} " not in shown] == []
    assert mtu(env={"COLUMNS": "100"}).stdout.strip() == shown.strip()
    assert done(mtu("--version")).stdout == f"mtu {__version__}\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped studies and data, with the files that the pages ask to be saved."""
    work = tmp_path_factory.mktemp("pages")
    for name in ("configs", "data"):
        shutil.copytree(ROOT / name, work / name)
    (work / "out").mkdir()
    for text in PAGES.values():
        for path, content in SAVED.findall(text):
            (work / path).write_text(content, "utf-8")
    return work


def holds(printed: list[str], expected: list[str]) -> bool:
    """Whether the expected lines are printed in order, with anything at each ``...``."""
    pattern = "".join(
        r"(?:.*\n)*?" if line.strip() == "..." else rf"{re.escape(line.rstrip())}\s*\n"
        for line in expected
    )
    text = "".join(f"{line.rstrip()}\n" for line in printed)
    return re.fullmatch(pattern, text) is not None


@UNDRAWN
@pytest.mark.parametrize("page", [name for name, text in PAGES.items() if CONSOLE.search(text)])
def test_console_blocks_run_as_printed(page: str, folder: Path) -> None:
    for block in CONSOLE.findall(PAGES[page]):
        for call, _, expected in (each.partition("\n") for each in f"\n{block}".split("\n$ ")[1:]):
            # Of a call that shows nothing no held-out error is printed.
            with nullcontext() if expected.strip() else TWO_FOLDS:
                result = mtu(*shlex.split(call)[1:], cwd=folder)
            assert result.returncode in (0, 3), result.stderr
            told = [x for x in result.stderr.splitlines() if not x.startswith("warning: ")]
            printed = [*result.stdout.splitlines(), *told]
            assert holds(printed, expected.splitlines()), f"{call}\n{result.stdout}"


def test_the_readme_is_short_and_names_every_command() -> None:
    assert README.count("\n") <= 150
    assert [name for name in COMMANDS if f"mtu {name}" not in README] == []
    assert [name for _, name in GRAPH if name not in README] == []
    assert [name for name in ORDER if not PAGES[name].startswith("# ")] == []


def test_every_finding_has_a_paragraph() -> None:
    lines = re.findall(r"^## (.*)$", topic("findings"), re.MULTILINE)
    headings = [name for line in lines for name in line.split(", ")]
    assert sorted(headings) == sorted(CATALOGUE)
    assert "Look at the record of the instrument" in paragraph("outlying-value")
    assert "(warning)" in paragraph("max-effects")
    assert "(warning, meets --fail-if suspicious)" in paragraph("outlying-value")
    # Only what the checks find meets the gate.
    room = "".join(path.read_text("utf-8") for path in Path(checks.__file__).parent.glob("*.py"))
    gated = [code for code, kind in CATALOGUE.items() if kind.suspicious]
    assert [code for code in gated if f'"{code}"' not in room] == []
    begun = "# too-little-data (error)\n\n    too little data: "
    assert paragraph("too-little-data").startswith(begun)


def test_help_lists_its_topics_and_prints_findings_and_commands() -> None:
    listed = done(mtu("help")).stdout
    assert [name for name in ORDER if f"`mtu help {name}`" not in listed] == []
    for name in ("start", "budget", "close-loop", "outlying-value", "lengths"):
        text = done(mtu("help", name)).stdout
        assert "# " in text
        assert ("Usage: mtu" in text) == (name in ("budget", "close-loop", "lengths"))
    assert "did you mean 'budget'?" in done(mtu("help", "budgt"), 2).stderr
