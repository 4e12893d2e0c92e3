"""Typer with faults of a call in the one-line form of all faults, and how a process ends."""

from __future__ import annotations

import os
import sys
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from mtu_cli.findings import EXIT_INPUT, LONGEST_NAME, MtuError, error, printable, shorten

UsageError: Any = typer.BadParameter.__base__
"""Typer's own class of all faults of a call, which it does not export."""


LEFT = 1
"""How typer exits where the reader of its help has left."""


class OneCommand(TyperCommand):
    """A command in whose help no Python type stands beside an argument or a flag."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, as help shows them."""
        return _without_types(super().get_params(ctx))


class Program(TyperGroup):
    """All commands; every fault ends the process with one message and exit code 2."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, as help shows them."""
        return _without_types(super().get_params(ctx))

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Runs a command; the exit code, which a caller of another mode than `standalone_mode`
        gets back, and its errors with it.
        """
        if not standalone_mode:
            return self._called(args, extra)
        try:
            code = self._called(args, extra)
            sys.stdout.flush()
        except (BrokenPipeError, SystemExit) as ended:
            if isinstance(ended, SystemExit) and ended.code != LEFT:
                raise
            # The reader has left (``| head``): nothing more can be said, and nothing is wrong.
            silence(sys.__stdout__)
            code = 0
        except (MtuError, OverflowError, OSError, MemoryError) as fault:
            code = EXIT_INPUT
            try:
                print(f"mtu: {_words(fault)}", file=sys.stderr, flush=True)
            except OSError:
                silence(sys.stderr)
            if isinstance(fault, OSError):
                silence(sys.stdout)
        sys.exit(code if isinstance(code, int) else 0)

    def _called(self, args: Any, extra: dict[str, Any]) -> Any:
        called: Any = super().main
        try:
            return called(*args, standalone_mode=False, **extra)
        except UsageError as fault:
            # Without a command help is shown: a script whose command's name was empty has done
            # nothing.
            if type(fault).__name__ == "NoArgsIsHelpError":
                return EXIT_INPUT
            text = " ".join(fault.format_message().split()).rstrip(".?")
            where = f" (see {fault.ctx.command_path} --help)" if fault.ctx else ""
            raise error("usage", reason=f"{text[:1].lower()}{text[1:]}{where}") from None


def _without_types(params: list[Any]) -> list[Any]:
    for param in params:
        if param.param_type_name == "argument" or getattr(param, "is_flag", False):
            param.display_type_rich = lambda ctx: ""
        # Bounds are there for slips of the keyboard.
        param._get_number_range_help_str = lambda: None
    return params


def _words(fault: BaseException) -> str:
    """What is said of a fault; what the system refuses without a name is standard output."""
    if isinstance(fault, OverflowError):
        return "a number of the input is too large to calculate with"
    if isinstance(fault, MemoryError):
        return "the memory of this computer does not suffice for this call"
    if isinstance(fault, OSError):
        what = "standard output cannot be written"
        if isinstance(fault.filename, str):
            what = f"{shorten(printable(fault.filename), LONGEST_NAME)}: the system refuses"
        return f"{what}: {(fault.strerror or str(fault)).lower()}"
    return str(fault)


def silence(stream: Any) -> None:
    """Nothing more can be said on a stream, not even when the interpreter flushes it at its end."""
    if stream in (sys.__stdout__, sys.__stderr__):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
