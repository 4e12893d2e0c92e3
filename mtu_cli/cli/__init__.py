"""The command line: load, run, emit, once for all commands."""

import os
import sys
from typing import Any


def silence(stream: Any) -> None:
    """Discards further output of a stream, that of the interpreter's last flush, too."""
    if stream in (sys.__stdout__, sys.__stderr__):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
