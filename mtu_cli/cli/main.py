"""`mtu`: the entry point, what it sets before anything heavy is imported, and how a call ends."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import io
import os
import signal
import sys
from collections.abc import Sequence
from typing import Any

from mtu_cli.cli import silence

EXIT_INTERRUPTED = 130
M_TRIM_THRESHOLD, M_MMAP_MAX = -1, -4
"""Of glibc's malloc.h."""
LEFT = 1
"""How typer exits where the reader of its help has left."""


def main() -> None:
    """Runs the command line; an interrupt ends it without a word, from its imports on."""
    try:
        # One thread a BLAS call: results must not depend on how many cores a machine has.
        for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
            os.environ[name] = "1"
        # Pictures are files, whatever a notebook has set for its own.
        os.environ["MPLBACKEND"] = "agg"
        # Imports make much that stays; to look for rubbish among it every 700 objects takes 5 %.
        gc.set_threshold(20_000)
        keep_memory()
        prepare_streams()
        try:
            code = called(sys.argv[1:])
        finally:
            # All is written: from here on an interrupt ends the process without a word.
            signal.signal(signal.SIGINT, signal.SIG_DFL)
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
    if code == EXIT_INTERRUPTED:
        # An interrupt may leave threads that wait for each other: nobody waits for them.
        os._exit(code)
    sys.exit(code)


def called(arguments: Sequence[str]) -> int:
    """The exit code of one call; every fault of it is one message on standard error."""
    import typer

    from mtu_cli.cli.commands import app
    from mtu_cli.findings import EXIT_INPUT, MtuError, error

    # Typer's own class of all faults of a call, which it does not export.
    faults_of_calls: Any = typer.BadParameter.__base__
    try:
        code = app([*arguments], prog_name="mtu", standalone_mode=False)
        sys.stdout.flush()
        return code if isinstance(code, int) else 0
    except (BrokenPipeError, SystemExit) as ended:
        if isinstance(ended, SystemExit) and ended.code != LEFT:
            return ended.code if isinstance(ended.code, int) else 0
        # The reader has left (``| head``): nothing more can be said, and nothing is wrong.
        silence(sys.__stdout__)
        return 0
    except faults_of_calls as fault:
        # Without a command help is shown: a script whose command's name was empty has done nothing.
        if type(fault).__name__ == "NoArgsIsHelpError":
            return EXIT_INPUT
        text = " ".join(fault.format_message().split()).rstrip(".?")
        where = f" (see {fault.ctx.command_path} --help)" if fault.ctx else ""
        message = str(error("usage", reason=f"{text[:1].lower()}{text[1:]}{where}"))
    except (MtuError, OverflowError, OSError, MemoryError) as fault:
        message = _words(fault)
        if isinstance(fault, OSError):
            silence(sys.stdout)
    try:
        print(f"mtu: {message}", file=sys.stderr, flush=True)
    except OSError:
        silence(sys.stderr)
    return EXIT_INPUT


def _words(fault: BaseException) -> str:
    """What is said of a fault; what the system refuses without a name is standard output."""
    from mtu_cli.findings import LONGEST_NAME, printable, shorten

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


def keep_memory() -> None:
    """Large arrays that are freed stay with the process: glibc would give each back to the system,
    and the next one costs a page fault every 4 KB, a third of the time on ten million rows.
    """
    with contextlib.suppress(AttributeError, OSError, TypeError):
        allocator = ctypes.CDLL(None)
        allocator.mallopt(M_MMAP_MAX, 0)
        allocator.mallopt(M_TRIM_THRESHOLD, -1)


def prepare_streams() -> None:
    """Standard output and error take all text: what their encoding lacks is escaped, closed ones
    swallow it.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115  # as long as the process
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
