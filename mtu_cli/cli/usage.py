"""A call that is none: unknown options and commands, values and arguments missing or too many.

Typer shows these in boxes of its own; here they get the words and the form of all other faults.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import typer

from mtu_cli.findings import InputError, error, nearest, shorten

UsageError: Any = typer.BadParameter.__base__
"""Typer's own class of all of them, which it does not export."""


@contextmanager
def usage_faults(ctx: Any) -> Iterator[None]:
    """Raises InputError for what typer finds at fault in the call of `ctx`.

    What is of a command within that is no fault: a group called without any command shows its help.
    """
    try:
        yield
    except UsageError as failed:
        if failed.ctx is not None and failed.ctx is not ctx:
            raise
        raise _usage_error(failed, ctx) from None


def _usage_error(failed: Any, ctx: Any) -> InputError:
    option = getattr(failed, "option_name", None)
    if hasattr(failed, "possibilities"):
        return _no_option(str(option), ctx)
    param = _owner(ctx, option)
    if option and param is not None:
        if getattr(param, "is_flag", False):
            return error("option-takes-no-value", option=option, expected=f"{option} alone")
        return _without_value(str(option), param)
    param = getattr(failed, "param", None)
    if hasattr(failed, "param_type") and param is not None:
        name = f"{max(param.opts, key=len)} " if param.param_type_name == "option" else ""
        return error("missing-argument", command=_called(ctx), argument=name + param.metavar)
    commands: Mapping[str, Any] = getattr(ctx.command, "commands", {})
    if commands and param is None:
        expected = f"one of: {', '.join(commands)}"
        return error(
            "missing-argument", command=ctx.command_path, argument="COMMAND", expected=expected
        )
    text = failed.format_message().rstrip(".")
    return error("usage", reason=text[:1].lower() + text[1:], expected=_help(ctx))


def _no_option(name: str, ctx: Any) -> InputError:
    commands: Mapping[str, Any] = getattr(ctx.command, "commands", {})
    have = next((key for key, c in commands.items() if any(name in p.opts for p in c.params)), None)
    if have is not None:
        expected = f"{ctx.command_path} {have} {name}"
        return error("unknown-option", command=_called(ctx), option=name, expected=expected)
    long = {option.lstrip("-"): option for option in _options(ctx) if option.startswith("--")}
    near = nearest(name.lstrip("-"), long) if name.startswith("--") else ()
    return error(
        "unknown-option",
        command=_called(ctx),
        option=shorten(name),
        meant=tuple(long[each] for each in near),
        expected=f"an option that {_help(ctx)} lists",
    )


def _without_value(option: str, param: Any) -> InputError:
    return error("option-without-value", option=option, expected=f"{option} {param.metavar}")


def check_own(ctx: Any, args: Sequence[str]) -> None:
    """Raises InputError for an option of other commands alone, and says of which."""
    own = _options(ctx)
    others = getattr(ctx.parent.command, "commands", {}) if ctx.parent else {}
    for name in (text.partition("=")[0] for text in args):
        if not name.startswith("--") or name in own or name == "--":
            continue
        have = [key for key, other in others.items() if any(name in p.opts for p in other.params)]
        if have:
            expected = f"an option that {_help(ctx)} lists ({name} is of {', '.join(have)})"
            raise error("unknown-option", command=_called(ctx), option=name, expected=expected)


def check_values(ctx: Any, args: Sequence[str], raw: Mapping[str, Any]) -> None:
    """Raises InputError where the value of an option is another option: its own was forgotten.

    `raw` are the values in `args`, as they were written.
    """
    options = _options(ctx)
    for param in ctx.command.params:
        value = raw.get(param.name)
        for item in value if isinstance(value, list) else [value]:
            if param.param_type_name == "option" and item in options:
                raise _without_value(max(param.opts, key=len), param)


def check_arguments(ctx: Any, rest: Sequence[str]) -> None:
    """Raises InputError for arguments that a command does not take."""
    if rest:
        takes = [p.metavar for p in ctx.command.params if p.param_type_name == "argument"]
        expected = f"{' '.join(takes) or 'options'} alone, see {_help(ctx)}"
        raise error("extra-argument", command=_called(ctx), value=rest[0], expected=expected)


def check_command(ctx: Any, args: Sequence[str]) -> None:
    """Raises InputError for a command that a group has not, and names those of nearly that name."""
    commands: Mapping[str, Any] = ctx.command.commands
    if not args or args[0] in commands:
        return
    name = args[0].casefold()
    within = [f"{key} {name}" for key, c in commands.items() if name in getattr(c, "commands", {})]
    raise error(
        "unknown-command",
        value=args[0],
        meant=tuple(within) or nearest(name, commands),
        expected=f"one of: {', '.join(commands)}",
    )


def _owner(ctx: Any, option: str | None) -> Any:
    found = (p for p in ctx.command.params if option in (*p.opts, *p.secondary_opts))
    return next(found, None)


def _options(ctx: Any) -> list[str]:
    params = (p for p in ctx.command.get_params(ctx) if p.param_type_name == "option")
    return [name for p in params for name in (*p.opts, *p.secondary_opts)]


def _called(ctx: Any) -> str:
    """A command as it is called within `mtu`."""
    path = str(ctx.command_path)
    return path.partition(" ")[2] or path


def _help(ctx: Any) -> str:
    return f"{ctx.command_path} --help"
