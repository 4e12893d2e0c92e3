"""Calls of the installed `mtu` in children of one process that has imported its libraries."""

from __future__ import annotations

import atexit
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryFile

from fork_server import SET_BEFORE

SERVER = Path(__file__).with_name("fork_server.py")
POSSIBLE = sys.platform == "linux" and not os.environ.get("MTU_STARTED")
"""Elsewhere system libraries may not be forked; MTU_STARTED=1 has every call start a process."""
AT_CALL = ("COLUMNS",)
"""What only a call looks at: nothing reads it while it is imported."""
START_S = 120.0
"""Time to import everything, once, on a computer that does much else."""


class ForkServer:
    """A process that forks children, all in the environment that it was started with."""

    def __init__(self, script: Path, environment: dict[str, str]) -> None:
        self._environment = environment
        self._script = script
        self._connection, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, SERVER, script, str(theirs.fileno())],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                pass_fds=[theirs.fileno()],
            )
        atexit.register(self.close)

    def close(self) -> None:
        """Ends the process, as the end of this one would."""
        self._connection.close()
        self.process.communicate()

    def serves(self, environment: dict[str, str]) -> bool:
        """Whether this environment is the server's, but for what a call looks at and for what the
        command sets itself: tests that run it within their own process leave that set.
        """
        names = {*environment, *self._environment} - {*SET_BEFORE, *AT_CALL}
        return all(environment.get(name) == self._environment.get(name) for name in names)

    def call(
        self,
        arguments: Sequence[str],
        cwd: Path | None,
        environment: dict[str, str],
        timeout_s: float,
    ) -> subprocess.CompletedProcess[str]:
        """As `subprocess.run` of the script with what it says, read as UTF-8."""
        request = {
            "arguments": arguments,
            "folder": str(cwd or Path.cwd()),
            "environment": environment,
        }
        with (
            TemporaryFile("w+", encoding="ascii") as asked,
            TemporaryFile("w+", encoding="utf-8") as out,
            TemporaryFile("w+", encoding="utf-8") as error,
        ):
            json.dump(request, asked)
            asked.seek(0)
            files = [file.fileno() for file in (asked, out, error)]
            socket.send_fds(self._connection, [b"!"], files)
            command = [str(self._script), *arguments]
            code = self._waited(command, timeout_s)
            out.seek(0)
            error.seek(0)
            return subprocess.CompletedProcess(command, code, out.read(), error.read())

    def _waited(self, command: list[str], timeout_s: float) -> int:
        """The exit code of the child that was asked for; one that takes too long is killed."""
        try:
            child = self._answer(START_S)
        except TimeoutError:
            # What it says later must not be taken for the answer to another call.
            self.process.kill()
            self.close()
            raise
        try:
            return self._answer(timeout_s)
        except TimeoutError:
            os.kill(child, signal.SIGKILL)
            self._answer(None)
            raise subprocess.TimeoutExpired(command, timeout_s) from None

    def _answer(self, timeout_s: float | None) -> int:
        self._connection.settimeout(timeout_s)
        answer = self._connection.recv(100)
        if not answer:
            raise RuntimeError(f"the server has gone: {self.process.communicate()[1].decode()}")
        return int(answer)
