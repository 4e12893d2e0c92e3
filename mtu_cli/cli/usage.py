"""A call that is none: unknown options and commands, values and arguments missing or too many.

Typer shows these in boxes of its own; here they get the words and the form of all other faults.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import typer

from mtu_cli.errors import InputError, fault, is_near, shorten

UsageError: Any = typer.BadParameter.__base__
"""Typer's own class of all of them, which it does not export."""


@contextmanager
def usage_faults(ctx: Any) -> Iterator[None]:
    """Raises InputError for what typer finds at fault in the call of `ctx`.

    What is of a command within that is no fault: a group called without any command shows its help.
    """
    try:
        yield
    except UsageError as error:
        if error.ctx is not None and error.ctx is not ctx:
            raise
        raise _told(error, ctx) from None


def _told(error: Any, ctx: Any) -> InputError:
    option = getattr(error, "option_name", None)
    if hasattr(error, "possibilities"):
        return _no_option(str(option), ctx)
    param = _owner(ctx, option)
    if option and param is not None:
        name = str(option)
        if getattr(param, "is_flag", False):
            return fault(f"{name} takes no value", expected=f"{name} alone, see {_help(ctx)}")
        return fault(f"{name} stands without a value", expected=_with_value(name, param, ctx))
    param = getattr(error, "param", None)
    if hasattr(error, "param_type") and param is not None:
        option = param.param_type_name == "option"
        own = f"{max(param.opts, key=len)} {param.metavar}" if option else param.metavar
        what = f"{_called(ctx)} stands without its {own}"
        return fault(what, expected=f"{ctx.command_path} {own}, see {_help(ctx)}")
    commands: Mapping[str, Any] = getattr(ctx.command, "commands", {})
    if commands and param is None:
        expected = f"{ctx.command_path} COMMAND, one of {', '.join(commands)}; see {_help(ctx)}"
        return fault("no command is named", expected=expected)
    text = error.format_message().rstrip(".")
    return fault(text[:1].lower() + text[1:], expected=f"a call as {_help(ctx)} shows")


def _no_option(name: str, ctx: Any) -> InputError:
    commands: Mapping[str, Any] = getattr(ctx.command, "commands", {})
    have = next((key for key, c in commands.items() if any(name in p.opts for p in c.params)), None)
    if have is not None:
        first = f"the command before its options, such as {ctx.command_path} {have} {name}"
        return fault(f"{_called(ctx)} has no {name} of its own", expected=first)
    near = ", ".join(near_options(name, ctx))
    shown = f"those that {_help(ctx)} shows"
    expected = f"did you mean {near}? See {_help(ctx)}" if near else f"one of {shown}"
    return fault(f"{_called(ctx)} has no {shorten(name)}", expected=expected)


def near_options(name: str, ctx: Any) -> list[str]:
    """The long options that are nearly called so, or one of which begins as the other does."""
    given = name.lstrip("-").casefold()
    bare = {option: option.lstrip("-") for option in _options(ctx) if option.startswith("--")}
    return [
        option
        for option, own in bare.items()
        if is_near(given, own)
        or (given and own.startswith(given))
        or (len(own) > 2 and given.startswith(own))
    ]


def check_own(ctx: Any, args: Sequence[str]) -> None:
    """Raises InputError for an option of other commands alone, and says of which."""
    own = _options(ctx)
    others = getattr(ctx.parent.command, "commands", {}) if ctx.parent else {}
    for name in (text.partition("=")[0] for text in args):
        if not name.startswith("--") or name in own or name == "--":
            continue
        have = [key for key, other in others.items() if any(name in p.opts for p in other.params)]
        if have:
            expected = f"an option of its own ({_help(ctx)}): {name} is one of {', '.join(have)}"
            raise fault(f"{ctx.command.name} has no {name}", expected=expected)


def check_values(ctx: Any, args: Sequence[str], raw: Mapping[str, Any]) -> None:
    """Raises InputError where the value of an option is another option: its own was forgotten.

    `raw` are the values in `args`, as they were written.
    """
    options = _options(ctx)
    for param in ctx.command.params:
        value = raw.get(param.name)
        for item in value if isinstance(value, list) else [value]:
            if param.param_type_name == "option" and item in options:
                name = max(param.opts, key=len)
                expected = _with_value(name, param, ctx)
                if any(f"{opt}={item}" in args for opt in param.opts):
                    raise fault(f"{name} has an option as its value", value=item, expected=expected)
                expected += f"; {item} is an option"
                raise fault(f"{name} stands without a value", expected=expected)


def check_arguments(ctx: Any, rest: Sequence[str]) -> None:
    """Raises InputError for arguments that a command does not take."""
    if rest:
        takes = [p.metavar for p in ctx.command.params if p.param_type_name == "argument"]
        alone = f"{' '.join(takes)} alone" if takes else "options alone"
        what = f"{_called(ctx)} takes no further argument"
        raise fault(what, value=rest[0], expected=f"{alone}, see {_help(ctx)}")


def check_command(ctx: Any, args: Sequence[str]) -> None:
    """Raises InputError for a command that a group has not, and names those of nearly that name."""
    commands: Mapping[str, Any] = ctx.command.commands
    if not args or args[0] in commands:
        return
    name = args[0].casefold()
    within = [f"{key} {name}" for key, c in commands.items() if name in getattr(c, "commands", {})]
    near = within or [key for key in commands if _may_mean(name, key)]
    offered = _either(near) if near else ""
    told = f"did you mean {offered}? See" if near else f"one of {', '.join(commands)}, see"
    raise fault("unknown command", value=args[0], expected=f"{told} {_help(ctx)}")


def _may_mean(name: str, command: str) -> bool:
    begins = len(name) > 1 and command.startswith(name)
    return begins or is_near(name, command)


def _either(names: Iterable[str]) -> str:
    return " or ".join(repr(name) for name in names)


def _with_value(name: str, param: Any, ctx: Any) -> str:
    return f"{name} {param.metavar}, see {_help(ctx)}"


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
