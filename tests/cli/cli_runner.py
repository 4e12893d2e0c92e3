"""Runs the installed `mtu` as a user or a script does, and looks at what it left behind."""

import atexit
import json
import os
import shutil
import subprocess
import sys
import warnings
from collections.abc import Mapping
from contextlib import chdir, redirect_stderr, redirect_stdout
from functools import cache
from io import BytesIO, TextIOWrapper
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, NamedTuple
from unittest.mock import patch

from support import CONFIGS, SIMULATED

from mtu_cli.cli.main import exit_code

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

TWO_FOLDS = patch("mtu_cli.analyses.close_loop.FOLDS", (2, 2))
"""For `close-loop` where what is held out does not matter: its blocks take most of the time."""
NO_WAVES = ("--exclude", "cyclic")
"""For the same: hundreds of members, of the places alone, take two fifths of a call's time."""
UNDRAWN = patch("mtu_cli.reports.figures.figure_bytes", lambda *_: b"<svg></svg>")
"""For pictures of shipped studies that other tests draw (PAGES), or that are not looked at."""

Result = subprocess.CompletedProcess[str]
Listing = dict[str, bytes | None]


def environment(changes: Mapping[str, str] | None = None) -> dict[str, str]:
    """The environment of the tests without what changes how a terminal program shows itself."""
    kept = {name: value for name, value in os.environ.items() if name not in DROPPED}
    return kept | dict(changes or {})


def mtu(*args: object, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> Result:
    """One call within this process, which has the libraries; `test_cli_started` holds that it
    does what a process does. Where another environment is asked for than the width of a terminal
    a process is started.
    """
    changes = dict(env or {})
    if changes.keys() - {"COLUMNS"}:
        return started(*args, cwd=cwd, env=env)
    out, error = (
        TextIOWrapper(BytesIO(), "utf-8", errors="backslashreplace", write_through=True)
        for _ in range(2)
    )
    with (
        patch.dict(os.environ, environment(changes), clear=True),
        chdir(cwd or Path.cwd()),
        warnings.catch_warnings(),
        redirect_stdout(out),
        redirect_stderr(error),
    ):
        warnings.resetwarnings()
        # Of numpy's, such as of a division by zero, a user would see the text: they are faults.
        warnings.simplefilter("error", RuntimeWarning)
        code = exit_code([*map(str, args)])
    said = [stream.buffer.getvalue().decode() for stream in (out, error)]
    return subprocess.CompletedProcess([*map(str, args)], code, *said)


def started(*args: object, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> Result:
    """One call as a user or a script makes it: a process of its own, standard input closed."""
    return _process([MTU, *map(str, args)], cwd, env)


def shell(script: str) -> Result:
    """A line of bash in which `mtu` is the installed one."""
    path = f"{MTU.parent}{os.pathsep}{os.environ['PATH']}"
    return _process(["bash", "-c", script], None, {"PATH": path})


def _process(call: list[Any], cwd: Path | None, env: Mapping[str, str] | None) -> Result:
    return subprocess.run(
        call, cwd=cwd, env=environment(env), stdin=subprocess.DEVNULL, capture_output=True,
        encoding="utf-8", timeout=TIMEOUT_S, check=False,
    )  # fmt: skip


def done(result: Result, code: int = 0) -> Result:
    """The result of a call that must end with `code` and without a traceback."""
    assert "Traceback" not in result.stderr, result.stderr
    assert result.returncode == code, result.stderr or result.stdout
    return result


def report(*args: object, cwd: Path | None = None) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(done(mtu(*args, "-o", "-", cwd=cwd)).stdout)
    return found


RIDGE = "thermal-fit configs/valdes-ring --model ridge"
"""As a word of a call: the report of this one, which is quickly made."""
PAGES = (
    *("fit-components configs/undeclared", "predict-points configs/gilsinn-ling"),
    *("lengths configs/undeclared", "orthogonality configs/gilsinn-ling --trials 20000"),
    *("anova configs/undeclared", "compare configs/undeclared"),
    *("close-loop configs/undeclared", "correct configs/valdes-ring -c RIDGE"),
    "budget configs/budgets/gum-h1-end-gauge.yaml --trials 20000",
)
"""Of these the file to hand on is made, too."""


class Shared(NamedTuple):
    """What a call has said and written: report, main table, and of PAGES the file to hand on."""

    said: Result
    report: dict[str, Any]
    table: str
    page: Path


@cache
def shared(call: str) -> Shared:
    """A call on a shipped file, made once for all tests that look at what is written of it."""
    command, _, words = call.partition(" configs/")
    folder = Path(mkdtemp(prefix="mtu-"))
    atexit.register(shutil.rmtree, folder)
    out, table, page = (folder / name for name in ("out.json", "out.csv", "out.html"))
    study, *options = words.split()
    outputs = ["-o", out, "--csv", table, *(["--report", page] if call in PAGES else [])]
    if "RIDGE" in options:
        options[options.index("RIDGE")] = str(shared(RIDGE).page.with_name(out.name))
    with TWO_FOLDS:
        said = done(mtu(*command.split(), CONFIGS / study, *options, *outputs))
    report = json.loads(out.read_text("utf-8"))
    return Shared(said, report, table.read_text("utf-8"), page)


def listing(folder: Path) -> Listing:
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


def machine_file(folder: Path, components: str, equations: str = "{Ex: dx, Ey: dy}") -> None:
    """The file m.yaml of a machine of these components."""
    text = f"schema: mtu/machine/1\nname: m\ncomponents: {components}\nequations: {equations}\n"
    (folder / "m.yaml").write_text(text, "utf-8")


def refused(folder: Path, *args: object, env: Mapping[str, str] | None = None) -> str:
    """The message of a call that must fail: code 2, nothing said elsewhere, nothing written."""
    before = listing(folder)
    result = done(mtu(*args, cwd=folder, env=env), 2)
    assert result.stdout == ""
    assert listing(folder) == before
    assert "Warning" not in result.stderr
    return result.stderr
