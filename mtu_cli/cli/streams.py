"""Standard output and error that may be closed, full, in another encoding, or without a reader."""

from __future__ import annotations

import io
import os
import sys
from typing import TextIO


def prepare_streams() -> None:
    """Makes both writable: a closed one swallows all, a sign that it lacks is escaped."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            sink = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")
            setattr(sys, name, sink)
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def hush(stream: TextIO | None = None) -> None:
    """The reader of a stream (``| head``; standard output unless said) has gone, or its disk is
    full: nothing more can be said there, not even when the interpreter flushes it at its end.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2 if stream is sys.stderr else 1)


def last_words(text: str) -> None:
    """A message on standard error, if that takes any."""
    try:
        print(text, file=sys.stderr)
    except OSError:
        hush(sys.stderr)


def write_bytes(content: bytes) -> None:
    """Bytes on standard output as they are, whatever its encoding."""
    sys.stdout.flush()
    sys.stdout.buffer.write(content)
    sys.stdout.buffer.flush()
