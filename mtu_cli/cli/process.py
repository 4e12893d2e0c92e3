"""A call as a process: what it sets before it starts, and how it ends, whatever happens."""

from __future__ import annotations

import errno
import gc
import os
import signal
import sys

from mtu_cli.cli.commands import app
from mtu_cli.cli.streams import hush, last_words, prepare_streams
from mtu_cli.findings import EXIT_INPUT, LONGEST_NAME, MtuError, printable, shorten

TAKES_NO_MORE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)


def run() -> None:
    """Runs the command line; every fault of the input ends with one message and exit code 2."""
    # One thread a BLAS call: results must not depend on how many cores a machine has.
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ[name] = "1"
    # Pictures are files, whatever a notebook has set for its own.
    os.environ["MPLBACKEND"] = "agg"
    # Imports make much that stays; to look for rubbish among it every 700 objects takes 5 %.
    gc.set_threshold(20_000)
    prepare_streams()
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
            # All is written: from here on an interrupt ends the process without a word.
            signal.signal(signal.SIGINT, signal.SIG_DFL)
    except MtuError as error:
        _end(f"mtu: {error}")
    except OverflowError:
        _end("mtu: a number of the input is too large to calculate with")
    except OSError as error:
        # The disk behind standard output is full or it is closed, the working folder is gone.
        hush()
        # A file that takes no more is told by its name: without one it is standard output.
        full = error.errno in TAKES_NO_MORE and error.filename is None
        what = "standard output cannot be written" if full else "the system refuses"
        if isinstance(error.filename, str):
            what = f"{shorten(printable(error.filename), LONGEST_NAME)}: {what}"
        _end(f"mtu: {what}: {(error.strerror or str(error)).lower()}")
    except MemoryError:
        _end("mtu: the memory of this computer does not suffice for this call")


def _end(message: str) -> None:
    last_words(message)
    sys.exit(EXIT_INPUT)
