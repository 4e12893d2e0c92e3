"""`mtu`: the entry point, and what it sets before anything heavy is imported."""

from __future__ import annotations

import gc
import io
import os
import signal
import sys

EXIT_INTERRUPTED = 130


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
        prepare_streams()
        from mtu_cli.cli.commands import app

        try:
            app()
        finally:
            # All is written: from here on an interrupt ends the process without a word.
            signal.signal(signal.SIGINT, signal.SIG_DFL)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)


def prepare_streams() -> None:
    """Standard output and error take all text: what their encoding lacks is escaped. Of the closed
    ones standard output can be opened but takes nothing, standard error swallows it.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            sink = os.open(os.devnull, os.O_RDONLY if name == "stdout" else os.O_WRONLY)
            stream = os.fdopen(sink, "w", encoding="utf-8", errors="backslashreplace")
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
