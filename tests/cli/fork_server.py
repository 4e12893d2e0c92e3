"""Forks a child for every call of the installed `mtu`: what takes most of a short call, to import
the libraries, is done once. Started by `forked_calls`, once for each worker of the tests.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import re
import runpy
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path

SET_BEFORE = {
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MPLBACKEND": "agg",
    "KMP_DUPLICATE_LIB_OK": "True",
}
"""As the command sets it before it imports what reads it, whatever it was; the last is set by
threadpoolctl.
"""
PICTURES = [f"matplotlib.backends.backend_{kind}" for kind in ("agg", "svg", "pdf")]
"""What matplotlib imports by itself when a picture is written."""
IMPORT = re.compile(r"^ *(?:from ([\w.]+) import|import ([\w.]+))", re.MULTILINE)
"""A line that imports. To parse the package takes as long as half of its libraries."""


def imported(path: Path) -> Iterator[str]:
    """The modules that a file imports, those within its functions too."""
    for found in IMPORT.finditer(path.read_text("utf-8")):
        yield found[1] or found[2]


def preload() -> None:
    """Imports every module of the package and all that they import anywhere, once.

    What fails is told by the command that needs it, as in a process of its own.
    """
    os.environ.update(SET_BEFORE)
    root = Path(str(import_module("mtu_cli").__file__)).parent
    names = {*PICTURES}
    for path in root.rglob("*.py"):
        parts = path.relative_to(root.parent).with_suffix("").parts
        names.add(".".join(parts).removesuffix(".__init__"))
        names.update(imported(path))
    for name in sorted(names):
        with suppress(Exception):
            import_module(name)
    if len(os.listdir("/proc/self/task")) > 1:
        sys.exit("a child of a process with threads may wait for a lock that nobody opens")
    gc.freeze()


def next_call(connection: socket.socket) -> list[int]:
    """Comes back in the child of each call, with its files; never in the server, which ends when
    the tests close the connection or are gone.

    A call is three files: its arguments, folder and environment as JSON, and what is to be
    standard output and error. It is answered by the child's process id and by its exit code.
    """
    loaded = False
    while True:
        asked, files, _, _ = socket.recv_fds(connection, 1, 3)
        if not asked:
            sys.exit()
        if not loaded:
            preload()
            loaded = True
        child = os.fork()
        if child == 0:
            connection.close()
            return files
        for file in files:
            os.close(file)
        connection.send(str(child).encode())
        _, status = os.waitpid(child, 0)
        connection.send(str(os.waitstatus_to_exitcode(status)).encode())


def run(script: str, request: int, out: int, error: int) -> None:
    """The script as a process of its own runs it."""
    with open(request, encoding="ascii") as file:
        call = json.load(file)
    for written, stream in ((out, 1), (error, 2)):
        os.dup2(written, stream)
        os.close(written)
    os.environ.clear()
    os.environ.update(call["environment"])
    os.chdir(call["folder"])
    sys.argv[:] = [script, *call["arguments"]]
    try:
        runpy.run_path(script, run_name="__main__")
    except SystemExit as end:
        leave(end.code)
        raise


def leave(code: object) -> None:
    """Ends the child as the interpreter ends, but frees nothing: that takes three short calls.

    Comes back, for the interpreter to do it, where there is more to do or to say than to write
    what is still held: another thread runs, the code is a text, a stream cannot be written.
    """
    if threading.active_count() == 1 and (code is None or isinstance(code, int)):
        with suppress(OSError, ValueError):
            atexit._run_exitfuncs()
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code or 0)


def serve(script: str, number: int) -> None:
    """Waits for calls at the socket of that number."""
    sys.path[0] = str(Path(script).parent)
    run(script, *next_call(socket.socket(fileno=number)))


if __name__ == "__main__":
    serve(sys.argv[1], int(sys.argv[2]))
