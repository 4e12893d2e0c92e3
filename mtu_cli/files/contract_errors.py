"""Old names of `contract`, until graph, effects and budgets use the new ones."""

from __future__ import annotations

from pydantic_core import PydanticCustomError

from mtu_cli.files.contract import number_expectation as number_expectation
from mtu_cli.files.contract import wrong
from mtu_cli.files.yaml_file import path_text as path_text


def told(what: str, expected: str) -> PydanticCustomError:
    """An error of a validator whose sentence is written where it is found."""
    return wrong(expected, "fault", what=what)


def lists_within(value: object) -> object:
    """A list of lists; one of them alone, ``[a, b]`` for ``[[a, b]]``, is a single fault."""
    if isinstance(value, list) and value and not any(isinstance(item, list) for item in value):
        raise told("not a list of lists", "brackets around each of them too, [[...], [...]]")
    return value
