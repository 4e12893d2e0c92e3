"""The options of a call, and commands made of groups of them.

Typer reads a command's options from its signature: the groups are joined into one.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from mtu_cli.cli.option_values import check_names
from mtu_cli.cli.parameters import FAIL_IF, Parameter
from mtu_cli.cli.usage import refuse_forgotten_values, refuse_repeated, usage_faults
from mtu_cli.findings import error, suggestion


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


class Commands(TyperGroup):
    """Commands under one name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The rest of the arguments; raises InputError for an unknown option.

        Without any argument it is help: on standard output, for who types `mtu` and reads, with
        exit code 2, for a script whose command's name was empty has done nothing.
        """
        if not args:
            return list(super().parse_args(ctx, args))
        with usage_faults(ctx):
            return list(super().parse_args(ctx, args))

    def invoke(self, ctx: Any) -> Any:
        """What the command returns; raises InputError where none is named."""
        with usage_faults(ctx):
            return super().invoke(ctx)

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[Any, Any, list[str]]:
        """Name, command and the rest; raises InputError for a command that there is not."""
        known = self.list_commands(ctx)
        if args and args[0] not in known:
            hint = suggestion(args[0].casefold(), known)
            raise error("unknown-name", what="command", value=args[0], **hint)
        return super().resolve_command(ctx, args)

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, as help shows them."""
        return _shown_once(super().get_params(ctx))


class Once(TyperCommand):
    """A command that refuses what stands twice in a call: the first would be lost in silence."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, as help shows them."""
        return _shown_once(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """The rest of the arguments; raises InputError for what typer refuses, an option with a
        value that is repeated or has another option for its value, and names that are no file.
        """
        with usage_faults(ctx):
            raw, _, order = self.make_parser(ctx).parse_args(list(args))
        refuse_repeated(order, FAIL_IF)
        refuse_forgotten_values(ctx, raw)
        with usage_faults(ctx, raw):
            rest = super().parse_args(ctx, args)
        check_names(self.params, ctx.params, raw)
        return list(rest)


def register(
    app: typer.Typer,
    name: str,
    groups: Iterable[list[Parameter]],
    run: Callable[[Options], None],
    text: str,
    panel: str | None = None,
) -> None:
    """Adds a command whose options are the groups' and whose body is `run`, under the title `panel`
    in the help of all.
    """

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
    app.command(name, help=text, cls=Once, rich_help_panel=panel)(command)
