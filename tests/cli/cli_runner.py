"""Runs the installed `mtu` as a user or a script does, and looks at what it left behind."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from forked_calls import POSSIBLE, ForkServer
from support import SIMULATED

HERE = Path(__file__).parent
VALID = HERE / "valid"
INVALID = HERE / "invalid"
SMALL = VALID / "small"
TRUTH = SIMULATED / "truth.yaml"

MTU = Path(sys.executable).parent / "mtu"
TIMEOUT_S = 30.0

DROPPED = ("COLUMNS", "LINES", "FORCE_COLOR", "NO_COLOR", "TERM", "PYTHONWARNINGS",
           "PYTEST_CURRENT_TEST")  # fmt: skip
"""How a terminal shows itself; and which test runs, or no two would have the same environment."""

Result = subprocess.CompletedProcess[str]
Listing = dict[str, bytes | None]


def environment(changes: Mapping[str, str] | None = None) -> dict[str, str]:
    """The environment of the tests without what changes how a terminal program shows itself."""
    kept = {name: value for name, value in os.environ.items() if name not in DROPPED}
    return kept | dict(changes or {})


@cache
def fork_server() -> ForkServer:
    """That of this worker of the tests, which ends with it."""
    return ForkServer(MTU, environment())


def mtu(*args: object, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> Result:
    """One call, standard input closed: a child of the fork server, which has the libraries.

    Where another environment is asked for than the width of a terminal, or that of the tests has
    changed, a process is started. What tests see of time and memory is of started processes only.
    """
    if not POSSIBLE or not fork_server().serves(environment(env)):
        return started(*args, cwd=cwd, env=env)
    return forked(*args, cwd=cwd, env=env)


def forked(*args: object, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> Result:
    """One call in a child of the fork server."""
    return fork_server().call([*map(str, args)], cwd, environment(env), TIMEOUT_S)


def started(*args: object, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> Result:
    """One call as a user or a script makes it: a process of its own, standard input closed."""
    return subprocess.run(
        [MTU, *map(str, args)],
        cwd=cwd,
        env=environment(env),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=TIMEOUT_S,
        check=False,
    )


def shell(script: str, env: Mapping[str, str] | None = None) -> Result:
    """A line of bash in which `mtu` is the installed one."""
    path = f"{MTU.parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        ["bash", "-c", script],
        env=environment({"PATH": path} | dict(env or {})),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=TIMEOUT_S,
        check=False,
    )


def done(result: Result, code: int = 0) -> Result:
    """The result of a call that must end with `code` and without a traceback."""
    assert "Traceback" not in result.stderr, result.stderr
    assert result.returncode == code, result.stderr or result.stdout
    return result


def report(*args: object, cwd: Path | None = None) -> dict[str, Any]:
    """The JSON report of a call, from standard output."""
    found: dict[str, Any] = json.loads(done(mtu(*args, "-o", "-", cwd=cwd)).stdout)
    return found


def listing(folder: Path) -> Listing:
    """Every file below a folder with its bytes, and every folder."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


def prepared(folder: Path, example: Path | None = None) -> Path:
    """A copy of the small study, with the files of an example laid over it."""
    shutil.copytree(SMALL, folder, dirs_exist_ok=True)
    if example is not None:
        shutil.copytree(example, folder, dirs_exist_ok=True)
    return folder


def refused(folder: Path, *args: object, env: Mapping[str, str] | None = None) -> str:
    """The message of a call that must fail: code 2, nothing said elsewhere, nothing written."""
    before = listing(folder)
    result = done(mtu(*args, cwd=folder, env=env), 2)
    assert result.stdout == ""
    assert listing(folder) == before
    assert "Warning" not in result.stderr
    return result.stderr
