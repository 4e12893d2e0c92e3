"""Input made to break things: bombs, code, bytes that are no text, names that are no UTF-8."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
from cli_runner import SMALL, done, mtu, prepared, refused

MACHINE = "schema: mtu/machine/1\nname: m\ncomponents: {a: {unit: um}}\n"
SECONDS = 10.0
"""Generous: a refusal takes 0.4 s, and an expanded bomb would take hours or all memory."""


def bomb() -> str:
    """Nine levels of nine aliases: four hundred million values."""
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    for above, name in zip("abcdefgh", "bcdefghi", strict=True):
        lines.append(f"{name}: &{name} [{', '.join([f'*{above}'] * 9)}]")
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (bomb(), "machine.yaml:6: more than 500000 values"),
        (
            MACHINE + f"equations: {{Ex: '{'(' * 5000}a{')' * 5000}'}}",
            "machine.yaml:4: equations.Ex: more than 60 levels of an equation at column",
        ),
        (
            MACHINE + f"equations: {{Ex: '{'-' * 9000}a'}}",
            "machine.yaml:4: equations.Ex: more than 300 operators of an equation",
        ),
        (
            MACHINE + f"equations: {{Ex: '{'a*' + '9' * 9000}'}}",
            "machine.yaml:4: equations.Ex: not a finite number at column 3: '999",
        ),
        (
            "!!python/object/apply:os.system ['touch stolen']\n",
            "machine.yaml:1: the tag '!!python/object/apply:os.system' is not accepted",
        ),
    ],
    ids=["aliases", "parentheses", "signs", "digits", "tag"],
)
def test_hostile_yaml_is_refused_at_once(text: str, words: str, tmp_path: Path) -> None:
    work = prepared(tmp_path / "work")
    (work / "machine.yaml").write_text(text, "utf-8")
    start = time.perf_counter()
    message = refused(work, "fit-components", "-o", "out.json")
    assert time.perf_counter() - start < SECONDS
    assert words in message
    assert len(message.splitlines()) == 1


def test_names_that_are_no_text_or_move_the_cursor(tmp_path: Path) -> None:
    work = prepared(tmp_path / "work")
    name = os.fsdecode(b"l\xe9\x1b[31m.csv")
    try:
        (work / name).write_bytes((SMALL / "lbb.csv").read_bytes())
    except OSError:
        pytest.skip("this file system takes UTF-8 names only")
    result = done(mtu("fit-components", "--lbb", name, "-o", "-", cwd=work))
    assert r"l\\xe9\\x1b[31m.csv" in result.stdout
    (work / name).write_bytes(b"component,error,unit\naxy,x,urad\n")
    message = refused(work, "fit-components", "--lbb", name, "-o", "out.json")
    assert r"l\xe9\x1b[31m.csv, row 2, column 'error': not a number: 'x'" in message
