"""The command line: load, run, emit, once for all commands."""

import os
import sys
from typing import Any


def silence(stream: Any) -> None:
    """Nothing more can be said on a stream, not even when the interpreter flushes it at its end."""
    if stream in (sys.__stdout__, sys.__stderr__):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
