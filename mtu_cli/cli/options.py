"""The options of a call, and commands made of groups of them.

Typer reads a command's options from its signature: the groups are joined into one.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from mtu_cli.cli.option_values import bad_number, check_names
from mtu_cli.cli.parameters import FAIL_IF, Parameter
from mtu_cli.errors import fault, is_near


@dataclass(frozen=True, slots=True)
class Options:
    """The options of one call, by name; an option that the command lacks is None.

    `given` are those that stand in the call, whatever their value.
    """

    command: str
    values: dict[str, Any] = field(default_factory=dict)
    given: frozenset[str] = frozenset()

    def __getattr__(self, name: str) -> Any:
        return self.values.get(name)


def _shown_once(params: list[Any]) -> list[Any]:
    """Parameters whose help says what they take in one word, their metavar: no Python type
    stands beside the name of an argument, and none beside a flag, which takes nothing.
    """
    for param in params:
        named = param.param_type_name == "argument" or getattr(param, "is_flag", False)
        if named:
            param.display_type_rich = lambda ctx: ""
    return params


def _check_own(command: TyperCommand, ctx: Any, args: list[str]) -> None:
    """Raises InputError for an option of other commands alone, and says of which."""
    own = {
        name for param in command.get_params(ctx) for name in (*param.opts, *param.secondary_opts)
    }
    others = getattr(ctx.parent.command, "commands", {}) if ctx.parent else {}
    for name in (text.partition("=")[0] for text in args):
        if not name.startswith("--") or name in own or name == "--":
            continue
        have = [key for key, other in others.items() if any(name in p.opts for p in other.params)]
        if have:
            expected = f"an option of its own (mtu {command.name} --help): {name} is one of"
            raise fault(f"{command.name} has no {name}", expected=f"{expected} {', '.join(have)}")


@contextmanager
def _near_options() -> Iterator[None]:
    """Of what stands for an option that does not exist, leaves the options that are nearly called
    so, or begin so.
    """
    try:
        yield
    except Exception as error:
        given = str(getattr(error, "option_name", "")).lstrip("-")
        offered = getattr(error, "possibilities", None) or ()
        bare = {name: name.lstrip("-") for name in offered}
        near = [n for n, own in bare.items() if is_near(given, own) or own.startswith(given)]
        if offered:
            error.possibilities = near  # type: ignore[attr-defined]  # it has some
        raise


class Commands(TyperGroup):
    """Commands under one name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The rest of the arguments."""
        with _near_options():
            return list(super().parse_args(ctx, args))

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, as help shows them."""
        return _shown_once(super().get_params(ctx))


class Once(TyperCommand):
    """A command that refuses what stands twice in a call: the first would be lost in silence."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, as help shows them."""
        return _shown_once(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The rest of the arguments; raises InputError where an option with a value is repeated,
        one is given that only other commands have, or a value is none.
        """
        _check_own(self, ctx, args)
        with _near_options():
            raw, _, order = self.make_parser(ctx).parse_args(list(args))
        for option in dict.fromkeys(order):
            if option.multiple or getattr(option, "is_flag", True) or order.count(option) < 2:
                continue
            name = max(option.opts, key=len)
            several = f", several gates with commas: {name} A,B" if option.name == FAIL_IF else ""
            raise fault(f"{name} is given {order.count(option)} times", expected=f"once{several}")
        try:
            rest = super().parse_args(ctx, args)
        except typer.BadParameter as error:
            told = None if error.param is None else bad_number(error.param, raw, str(error))
            raise error if told is None else told from None
        check_names(self.params, ctx.params, raw)
        return list(rest)


def register(
    app: typer.Typer,
    name: str,
    groups: Iterable[list[Parameter]],
    run: Callable[[Options], None],
    text: str,
) -> None:
    """Adds a command whose options are the groups' and whose body is `run`."""

    def command(context: typer.Context, **values: Any) -> None:
        source = context.get_parameter_source
        given = {key for key in values if getattr(source(key), "name", "") == "COMMANDLINE"}
        run(Options(name, values, frozenset(given)))

    parameters = [
        ("context", typer.Context, inspect.Parameter.empty),
        *(item for group in groups for item in group),
    ]
    for _, annotation, _ in parameters:
        for info in getattr(annotation, "__metadata__", ()):
            # Our own reader says what may not be read, in the words of all faults.
            info.readable = False
    command.__signature__ = inspect.Signature(  # type: ignore[attr-defined]  # read by typer
        [
            inspect.Parameter(
                key, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default
            )
            for key, annotation, default in parameters
        ]
    )
    command.__annotations__ = {key: annotation for key, annotation, _ in parameters}
    command.__doc__ = text
    command.__name__ = name.replace("-", "_")
    app.command(name, help=text, cls=Once)(command)
