"""Makes the modules beside this file importable from every test; tells what was covered."""

import gc
import importlib
import os
import pkgutil
import sys
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from unittest.mock import patch

import pytest
import typer
from coverage import Coverage

TESTS = Path(__file__).parent
PRODUCT = TESTS.parent / "mtu_cli"
sys.path.insert(0, str(TESTS))

# As in the command: threads that wait for each other over small matrices take most of the time.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
gc.set_threshold(20_000)

# Typer makes all commands anew in every call, which takes as long as a small one itself.
patch("typer.main.get_command", cache(typer.main.get_command)).start()

COUNTED = ("unit/model", "unit/stats", "published")
"""Folders whose tests are counted: those of the floors that are measured. To count takes half as
long again, and statistics of thousands of tables elsewhere cover nothing more.
"""


REPEATED = (
    "cover", "alarms", "uniform", "unbiased", "seeds", "rarely", "seldom", "rejected", "thousand",
    "no_reversal", "future", "paths", "moments_of", "draughts", "threads", "refits", "statsmodels",
    "follows", "strip", "negative_part", "never_negative", "few_trials", "slow_sum", "ends_of",
)  # fmt: skip
"""In the names of tests that run the same lines for thousands of drawn tables."""


def counted(item: pytest.Item) -> bool:
    inside = any(item.path.is_relative_to(TESTS / folder) for folder in COUNTED)
    return inside and not any(word in item.name for word in REPEATED)


@contextmanager
def uncounted() -> Iterator[None]:
    """Nothing is counted meanwhile: a worker of xdist has two that count, one below the other."""
    stopped: list[Coverage] = []
    while (running := Coverage.current()) is not None:
        running.stop()
        stopped.append(running)
    try:
        yield
    finally:
        for running in reversed(stopped):
            running.start()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """With ``--cov``, counts where it tells something: not what is made for other tests either."""
    if counted(item):
        return (yield)
    with uncounted():
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """With ``--cov``, what is measured is imported first: to count while thousands of tests are
    collected takes longer than to collect them, and covers nothing more.
    """
    if (running := Coverage.current()) is not None:
        for folder in running.config.source or ():
            prefix = f"{folder.replace('/', '.')}."
            for module in pkgutil.walk_packages([str(PRODUCT.parent / folder)], prefix):
                importlib.import_module(module.name)
    with uncounted():
        return (yield)


def pytest_collection_finish() -> None:
    """What was imported stays: it is not looked through for garbage again and again."""
    gc.collect()
    gc.freeze()


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Where lines were counted (``--cov``): the share of each folder, files that fall short."""
    if config.getoption("cov_source", default=None):
        from covered import coverage_lines

        for line in coverage_lines():
            terminalreporter.write_line(line)


@pytest.fixture(scope="module")
def styled() -> Iterator[None]:
    """Pictures are drawn in the house style, as by `figure_bytes`."""
    from mtu_cli.reports.figures import house_style

    with house_style():
        yield


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the small study of `tests/cli`, as the working folder."""
    from cli_runner import prepared

    folder = prepared(tmp_path / "work")
    monkeypatch.chdir(folder)
    return folder
