"""Faults of a call in the one-line form of all faults: what typer finds, without its boxes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import typer

from mtu_cli.findings import error

UsageError: Any = typer.BadParameter.__base__
"""Typer's own class of all of them, which it does not export."""


@contextmanager
def usage_faults(ctx: Any, raw: Mapping[str, Any] | None = None) -> Iterator[None]:
    """Raises InputError for what typer finds at fault in the call of `ctx`.

    `raw` are the values of the call as they were written. What is of a command within that is no
    fault: a group called without any command shows its help.
    """
    try:
        yield
    except UsageError as failed:
        if failed.ctx is not None and failed.ctx is not ctx:
            raise
        text = " ".join(failed.format_message().split()).rstrip(".")
        reason = f"{text[:1].lower()}{text[1:]} (see {ctx.command_path} --help)"
        param = getattr(failed, "param", None)
        bad = None if param is None else (raw or {}).get(param.name)
        raise error("usage", reason=reason, value=None if bad is None else str(bad)) from None


def refuse_repeated(order: Sequence[Any], several: str) -> None:
    """Raises InputError for an option with one value that stands twice: the first would be lost.

    `several`: the name of the option that takes several values with commas.
    """
    for option in dict.fromkeys(order):
        if option.multiple or getattr(option, "is_flag", True) or order.count(option) < 2:
            continue
        name = max(option.opts, key=len)
        hint = f", several with commas: {name} A,B" if option.name == several else ""
        raise error("appears-twice", what=name, expected=f"once{hint}")


def refuse_forgotten_values(ctx: Any, raw: dict[str, Any]) -> None:
    """Raises InputError where the value of an option is the name of another: its own is missing."""
    params = [each for each in ctx.command.params if each.param_type_name == "option"]
    names = {name for each in params for name in (*each.opts, *each.secondary_opts)}
    for each in params:
        given = raw.get(each.name)
        if any(item in names for item in (given if isinstance(given, list) else [given])):
            option = max(each.opts, key=len)
            expected = f"{option} {each.metavar}"
            raise error("usage", reason=f"option {option!r} has no value", expected=expected)
