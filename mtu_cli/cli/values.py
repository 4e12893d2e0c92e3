"""Values within the text of an option: NAME=VALUE, 'NAME: NUMBERS', LOW:HIGH:COUNT."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from math import isfinite
from typing import Any, TypeVar

from mtu_cli.cli.options import Option, option_name
from mtu_cli.files.headers import number
from mtu_cli.findings import Finding, InputError, collected, error, suggestion

T = TypeVar("T")
MOST_STEPS = 10_000
"""Of a range LOW:HIGH:COUNT."""
SPAN = "LOW:HIGH:COUNT"


def number_of(option: str, text: str, *, whole: bool = False, positive: bool = False) -> float:
    """A finite number, which may have to be `whole`, or `positive`.

    Raises InputError that names the `option`.

    >>> number_of("--at T_a_degC", " 23.5 ")
    23.5
    """
    text = text.strip()
    value = number(text)
    if value is None or not isfinite(value):
        kind = "a number" if value is None else "a finite number"
        raise error("wrong-type", path=option, kind=kind, value=text)
    if whole and not text.lstrip("+-").isdigit():
        raise error("wrong-type", path=option, kind="a whole number", value=text)
    if positive and value <= 0:
        raise error("out-of-range", path=option, value=text, expected="a number above 0")
    return value


def ends(
    option: str, text: str, form: str, example: str, *, ordered: bool = False, whole: bool = False
) -> list[float]:
    """The numbers of LOW:HIGH, or of LOW:HIGH:COUNT, as the `form` says; all of them `whole`, or
    the count alone.

    Raises InputError for another form, for what is no number, for a count out of range, and for
    ends that are not `ordered`.
    """
    items = text.split(":")
    if len(items) != len(form.split(":")) or not all(item.strip() for item in items):
        raise error("wrong-type", path=option, kind=form, value=text, expected=f"{example}, say")
    result = [number_of(option, item, whole=whole or i == 2) for i, item in enumerate(items)]
    if len(result) == 3 and not 2 <= result[2] <= MOST_STEPS:
        expected = f"a COUNT from 2 to {MOST_STEPS}"
        raise error("out-of-range", path=option, value=text, expected=expected)
    if ordered and result[0] >= result[1]:
        raise error("out-of-range", path=option, value=text, expected="LOW below HIGH")
    return result


def within(option: str, values: Iterable[float], bounds: Sequence[float], unit: str = "") -> None:
    """Raises InputError for a value that is out of the `bounds` (low, high)."""
    low, high = bounds
    for value in values:
        if not low <= value <= high:
            expected = f"from {low:g} to {high:g} {unit}".strip()
            place = {"path": option, "value": f"{value:g} {unit}".strip()}
            raise error("out-of-range", **place, expected=expected)


def check_values(options: Mapping[str, Option], values: Mapping[str, Any]) -> None:
    """Raises InputError for a number that is out of the bounds of its option, and for a text that
    is none of its choices.
    """
    for name, option in options.items():
        value = values.get(name)
        if option.bounds and value is not None:
            within(option_name(name), value if option.many else [value], option.bounds)
        if option.choices:
            what = str(option.metavar).lower().replace("how", "value")
            known_name(option_name(name), what, value, option.choices)


def known_name(option: str, what: str, name: Any, choices: Collection[str]) -> Any:
    """The name, or None without one; raises InputError, with the nearest, for one that is none of
    the `choices`.
    """
    if name is not None and name not in choices:
        raise error("unknown-name", path=option, what=what, value=name, **suggestion(name, choices))
    return name


def assignments(
    option: str,
    texts: Iterable[str] | None,
    form: str,
    example: str,
    value: Callable[[str, str], T],
    choices: Collection[str] | None = None,
    what: str = "name",
) -> dict[str, T]:
    """The values by name of the texts NAME=VALUE or NAME: VALUE of an option, as `value` reads name
    and text.

    Raises InputError with every text that is of another form, has a name that is none of the
    `choices` or stands twice, or a value that cannot be read.
    """
    result: dict[str, T] = {}
    faults: list[Finding] = []
    for text in texts or ():
        name, _, content = (side.strip() for side in text.partition("=" if "=" in form else ":"))
        with collected(faults.append):
            if not name or not content or not name.isprintable():
                kind, expected = form, f"{example}, say"
                raise error("wrong-type", path=option, kind=kind, value=text, expected=expected)
            if choices is not None:
                known_name(option, what, name, choices)
            if name in result:
                raise error("appears-twice", what=f"{option} {name}", value=text)
            result[name] = value(name, content)
    if faults:
        raise InputError(faults)
    return result
