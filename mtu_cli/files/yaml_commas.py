"""Decimal commas in the lists of a YAML file: ``[50,0021, 50,0024]`` reads as four numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

_WHOLE = re.compile(r"[-+]?[0-9]+")
_DECIMALS = re.compile(r"[0-9]+(?:[eE][-+]?[0-9]+)?")
_UNIT = r"\s*[A-Za-z\u00b5\u03bc\u00b0%\"'/].*"
_PIECE = re.compile(rf"({_DECIMALS.pattern})({_UNIT})?", re.DOTALL)
_PADDED = re.compile(r"[-+]?0[0-9]+(?:[eE][-+]?[0-9]+)?")


@dataclass(frozen=True, slots=True)
class Cell:
    """A plain scalar of a list in brackets, with the characters of the file that it covers."""

    text: str
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class OddNumber:
    """A number of a list that looks like a piece of another one: its index in the list, what is
    odd, the text as it stands, and what to write instead.
    """

    index: int
    what: str
    text: str
    expected: str


def decimal_point(key: str) -> str | None:
    """What to write instead of a key that is the rest of a number: {value: 1,5} has the keys
    `value` and `5`. None for another key.
    """
    found = _PIECE.fullmatch(key)
    if found is None:
        return None
    no_unit = ", without a unit" if found[2] else ""
    return f"a decimal point before {found[1]}{no_unit}: a comma ends a value"


def odd_number(cells: Sequence[Cell], text: str) -> OddNumber | None:
    """The first sign that numbers of a list are written with a decimal comma, None without one.

    `cells` are all items of the list, `text` is that of the file. YAML cannot tell: a comma ends
    an item with a blank behind it or without. A reader can. Where some commas have a blank behind
    them and others stand between digits, the latter are decimal commas; and no number of its own
    begins with an idle zero. At the end of a line no blank is needed: such a comma counts where
    no more than pairs stand between them, since 1,2,3 is no number; and nobody writes 0,0 for 0.
    """
    joints = [(i, text[a.end : b.start]) for i, (a, b) in enumerate(pairwise(cells))]
    tight = {i for i, joint in joints if joint == ","}
    blank = any(joint != "," and "\n" not in joint for _, joint in joints)
    wrapped = any("\n" in joint for _, joint in joints)
    mixed = blank or (wrapped and not any(i + 1 in tight for i in tight))
    for i, cell in enumerate(cells):
        if mixed and i in tight and _is_split(cells[i], cells[i + 1]):
            return _split(i, cell.text, cells[i + 1].text)
        if _PADDED.fullmatch(cell.text):
            if i - 1 in tight and _is_split(cells[i - 1], cell):
                return _split(i - 1, cells[i - 1].text, cell.text)
            expected = "no idle zeros before a number, and a decimal point in it"
            return OddNumber(i, "a number that begins with 0", cell.text, expected)
    return None


def _is_split(whole: Cell, decimals: Cell) -> bool:
    if decimals.text == "0" and whole.text.lstrip("+-") == "0":
        return False
    return bool(_WHOLE.fullmatch(whole.text) and _DECIMALS.fullmatch(decimals.text))


def _split(index: int, whole: str, decimals: str) -> OddNumber:
    expected = f"{whole}.{decimals} with a decimal point; of two numbers: {whole}, {decimals}"
    if _PADDED.fullmatch(decimals):
        expected = f"{whole}.{decimals} with a decimal point"
    return OddNumber(index, "a comma ends a number of a list", f"{whole},{decimals}", expected)
