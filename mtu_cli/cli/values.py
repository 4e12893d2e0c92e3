"""Values within the text of an option: NAME=VALUE, 'NAME: NUMBERS', LOW:HIGH:COUNT."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import isfinite
from typing import NoReturn, TypeVar

from mtu_cli.files.contract import number_expectation
from mtu_cli.files.csv_table import number
from mtu_cli.findings import Finding, InputError, error, suggestion

T = TypeVar("T")
MOST_STEPS = 10_000
"""Of a range LOW:HIGH:COUNT."""
SPAN = "LOW:HIGH:COUNT"


def number_of(option: str, text: str, *, whole: bool = False) -> float:
    """A finite number, `whole` where asked for.

    Raises InputError that names the `option` and says how to write a number.

    >>> number_of("--at T_a_degC", " 23.5 ")
    23.5
    """
    text = text.strip()
    value = number(text)
    if value is None or not isfinite(value):
        kind, expected = "a number", number_expectation(text)
        if value is not None:
            kind, expected = "a finite number", ""
        raise error("wrong-type", path=option, kind=kind, value=text, expected=expected)
    if whole and not text.lstrip("+-").isdigit():
        raise error("wrong-type", path=option, kind="a whole number", value=text)
    return value


def pair(option: str, text: str, sign: str, form: str, example: str) -> tuple[str, str]:
    """Both sides of the first `sign` of a text of the `form` NAME=VALUE.

    Raises InputError where one of them is missing, with an `example`.
    """
    name, _, value = (side.strip() for side in text.partition(sign))
    if not name or not value or not name.isprintable():
        wrong_form(option, text, form, example)
    return name, value


def wrong_form(option: str, text: str, form: str, example: str) -> NoReturn:
    """Raises InputError for a text that is not of a `form`."""
    raise error("wrong-type", path=option, kind=form, value=text, expected=f"{example}, say")


def ends(option: str, text: str, form: str, example: str, *, ordered: bool = False) -> list[float]:
    """The numbers of LOW:HIGH, or of LOW:HIGH:COUNT, as the `form` says.

    Raises InputError for another form, for what is no number, for a count out of range, and for
    ends that are not `ordered`; without a count they may be equal.
    """
    items = text.split(":")
    if len(items) != len(form.split(":")) or not all(item.strip() for item in items):
        wrong_form(option, text, form, example)
    found = [number_of(option, item, whole=place == 2) for place, item in enumerate(items)]
    if len(found) == 3 and not 2 <= found[2] <= MOST_STEPS:
        expected = f"a COUNT from 2 to {MOST_STEPS}"
        raise error("out-of-range", path=option, value=text, expected=expected)
    if ordered and (found[0] > found[1] or (found[0] == found[1] and len(found) == 3)):
        raise error("out-of-range", path=option, value=text, expected="LOW below HIGH")
    return found


def within(option: str, values: Iterable[float], bounds: Sequence[float], unit: str) -> None:
    """Raises InputError for a value that is out of the `bounds` (low, high)."""
    low, high = bounds
    for value in values:
        if not low <= value <= high:
            expected = f"from {low:g} to {high:g} {unit}".strip()
            place = {"path": option, "value": f"{value:g} {unit}".strip()}
            raise error("out-of-range", **place, expected=expected)


def known_name(option: str, what: str, name: str, known: Sequence[str]) -> None:
    """Raises InputError for a name that is none of those `known`, with the nearest."""
    if name not in known:
        raise error("unknown-name", path=option, what=what, value=name, **suggestion(name, known))


def assigned(
    option: str,
    texts: Iterable[str] | None,
    sign: str,
    form: str,
    example: str,
    value: Callable[[str, str], T],
    known: Sequence[str] | None = None,
    what: str = "name",
) -> dict[str, T]:
    """What each text NAME=VALUE of an option gives its name, as `value` reads name and text.

    Raises InputError with every text that is of another form, has a name that is not `known` or
    stands twice, or a value that cannot be read.
    """
    found: dict[str, T] = {}
    faults: list[Finding] = []
    for text in texts or ():
        try:
            name, content = pair(option, text, sign, form, example)
            if known is not None:
                known_name(option, what, name, known)
            if name in found:
                raise error("appears-twice", what=f"{option} {name}", value=text)
            found[name] = value(name, content)
        except InputError as fault:
            faults += fault.findings
    if faults:
        raise InputError(faults)
    return found
