"""Help: there for every command, complete, and no wider than a terminal."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import pytest
import typer
from cli_runner import done, mtu

from mtu_cli import __version__
from mtu_cli.cli.commands import app

COMMANDS = typer.main.get_command(app).commands  # type: ignore[attr-defined]  # a group has them


GRAPH = [("graph", name) for name in COMMANDS["graph"].commands]


@cache
def help_of(*words: str) -> str:
    return done(mtu(*words, "--help", env={"COLUMNS": "100"})).stdout


def parameters(words: tuple[str, ...]) -> list[Any]:
    found: Any = COMMANDS[words[0]]
    for word in words[1:]:
        found = found.commands[word]
    known: list[Any] = found.params
    return known


@pytest.mark.parametrize("words", [(), *((name,) for name in COMMANDS), *GRAPH], ids=" ".join)
def test_help_says_once_and_without_types_what_an_option_takes(words: tuple[str, ...]) -> None:
    shown = help_of(*words)
    assert not re.findall(
        r"<\S+>|\[(?:Path|str|int|float)\]|\b(?:PATH|TEXT|INTEGER|FLOAT)\b", shown
    )
    if not words or words == ("graph",):
        return
    for parameter in parameters(words):
        takes = not getattr(parameter, "is_flag", False)
        assert (parameter.metavar is not None) == takes, parameter.name
        if takes and parameter.param_type_name == "argument":
            assert re.search(rf"(?m)^[│|* ]+{parameter.metavar}  +[A-Za-z]", shown), parameter.name
        elif takes:
            assert re.search(
                rf"{parameter.opts[-1]} +(-\w +)?{re.escape(parameter.metavar)} ", shown
            )


@pytest.mark.parametrize("name", COMMANDS)
def test_help_tells_every_option_in_a_sentence(name: str) -> None:
    shown = help_of(name)
    assert max(map(len, shown.splitlines())) <= 100
    words = " ".join(re.sub("[^\x20-\x7e]", " ", shown).split())
    assert COMMANDS[name].help in words
    for parameter in parameters((name,)) if name != "graph" else ():
        for option in parameter.opts:
            assert option in words or parameter.param_type_name == "argument"
        assert re.fullmatch(r"(?s)[A-Z(\w-].{4,}[.;].*|.{5,}\.", parameter.help or ""), parameter
        assert (parameter.help or "")[-1] in ".)", parameter.help


def test_help_of_the_whole() -> None:
    shown = done(mtu("--help", env={"COLUMNS": "100"})).stdout
    assert max(map(len, shown.splitlines())) <= 100
    for name in COMMANDS:
        assert f" {name} " in shown
    alone = mtu(env={"COLUMNS": "100"})
    assert alone.stdout.strip() == shown.strip()


@pytest.mark.parametrize(
    "words", [(), ("budget",), ("close-loop",), ("graph",), ("graph", "sweep")], ids=" ".join
)
def test_help_is_had_by_one_letter(words: tuple[str, ...]) -> None:
    assert done(mtu(*words, "-h", env={"COLUMNS": "100"})).stdout == help_of(*words)


def test_version() -> None:
    assert done(mtu("--version")).stdout == f"mtu {__version__}\n"
