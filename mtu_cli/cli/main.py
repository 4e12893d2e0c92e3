"""`mtu`: the entry point, what it sets before anything heavy is imported, and how a call ends."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import io
import os
import sys
from collections.abc import Sequence
from typing import Any

from mtu_cli.cli import silence

EXIT_INTERRUPTED = 130


def main() -> None:
    """Runs the command line; an interrupt ends it without a word, from its imports on."""
    try:
        # One thread a BLAS call: results must not depend on how many cores a machine has.
        for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
            os.environ[name] = "1"
        # Pictures are files, whatever backend a notebook has set.
        os.environ["MPLBACKEND"] = "agg"
        # Imports make much that stays; to look for rubbish among it every 700 objects takes 5 %.
        gc.set_threshold(200_000)
        with contextlib.suppress(AttributeError, OSError, TypeError):
            # glibc (M_MMAP_MAX, M_TRIM_THRESHOLD) would give each large array that is freed back to
            # the system, and the next one costs a page fault every 4 KB: a fifth of reading.
            ctypes.CDLL(None).mallopt(-4, 0)
            ctypes.CDLL(None).mallopt(-1, -1)
        for name in ("stdout", "stderr"):
            # A closed stream is replaced; characters that an encoding lacks are escaped.
            stream: Any = getattr(sys, name) or open(os.devnull, "w")  # noqa: SIM115
            setattr(sys, name, stream)
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")
        code = exit_code(sys.argv[1:])
    except KeyboardInterrupt:
        # Its threads may wait for each other: nobody waits for them.
        os._exit(EXIT_INTERRUPTED)
    sys.exit(code)


def exit_code(arguments: Sequence[str]) -> int:
    """The exit code of one call; every fault of it is one message on standard error."""
    import typer

    from mtu_cli.cli.commands import app
    from mtu_cli.findings import EXIT_INPUT, InputError, error, printable

    # Typer's class of all faults of a call, which it does not export.
    faults_of_calls: Any = typer.BadParameter.__base__
    try:
        code = app([*arguments], prog_name="mtu", standalone_mode=False)
        sys.stdout.flush()
        return code if isinstance(code, int) else 0
    except (BrokenPipeError, SystemExit) as end:
        code = getattr(end, "code", 1)
        if code != 1:
            return code if isinstance(code, int) else 0
        # The reader has left (``| head``), which typer ends with 1: nothing is wrong.
        silence(sys.__stdout__)
        return 0
    except faults_of_calls as fault:
        # Without a command help is shown: a script whose command's name was empty has done nothing.
        if type(fault).__name__ == "NoArgsIsHelpError":
            return EXIT_INPUT
        text = " ".join(fault.format_message().split()).rstrip(".?")
        where = f" (see {fault.ctx.command_path} --help)" if fault.ctx else ""
        message = str(error("usage", reason=f"{text[:1].lower()}{text[1:]}{where}"))
    except InputError as fault:
        message = str(fault)
    except OSError as fault:
        # What the system refuses without a name is standard output.
        what = f"{fault.filename or 'standard output'}: the system refuses"
        message = printable(f"{what}: {(fault.strerror or str(fault)).lower()}")
        silence(sys.stdout)
    except (OverflowError, MemoryError):
        message = "numbers of the input are too large, or too many, to calculate with"
    try:
        print(f"mtu: {message}", file=sys.stderr, flush=True)
    except OSError:
        silence(sys.stderr)
    return EXIT_INPUT
