"""Standard output and error that may be closed, full, in another encoding, or without a reader."""

from __future__ import annotations

import io
import os
import sys
from typing import Any, TextIO

ESCAPED = "backslashreplace"


def prepare_streams() -> None:
    """Makes both take what is written: a sign that they lack is escaped, a reader may leave
    early. A closed standard error swallows all, a closed standard output refuses it as a full
    disk does: a table that nobody can have is no success.
    """
    for number, name in ((1, "stdout"), (2, "stderr")):
        stream = getattr(sys, name)
        if stream is None:
            _open_null(number, os.O_RDONLY if number == 1 else os.O_WRONLY)
            sink = os.fdopen(number, "w", encoding="utf-8", errors=ESCAPED, closefd=False)
            setattr(sys, name, sink)
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=ESCAPED)
            # Those that a test or a notebook has put in their place have no pipe behind them.
            if stream is getattr(sys, f"__{name}__") and not stream.isatty():
                setattr(sys, name, _patient(stream))


class _Patient(io.FileIO):
    """A stream whose reader may leave early (``| head``): the rest is said to nobody, and no
    library between is there to make a failure of it.
    """

    def write(self, content: Any, /) -> int:
        try:
            return super().write(content)
        except BrokenPipeError:
            _open_null(self.fileno(), os.O_WRONLY)
            return super().write(content)


def _patient(stream: io.TextIOWrapper) -> io.TextIOWrapper:
    """A stream as the interpreter opened it (PYTHONUNBUFFERED: without a buffer), but patient."""
    raw = _Patient(stream.fileno(), "w", closefd=False)
    return io.TextIOWrapper(
        raw if isinstance(stream.buffer, io.RawIOBase) else io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


def _open_null(number: int, flags: int) -> None:
    os.dup2(os.open(os.devnull, flags), number)


def hush(stream: TextIO | None = None) -> None:
    """Nothing more can be said on a stream (standard output unless said), as its disk is full:
    not even when the interpreter flushes it at its end.
    """
    _open_null(2 if stream is sys.stderr else 1, os.O_WRONLY)


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
