"""Makes the modules beside this file importable from every test; tells what was covered."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
sys.path.insert(0, str(TESTS))

# As in the command: threads that wait for each other over small matrices take most of the time.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")


COUNTED = ("unit/model", "unit/stats", "published")
"""Folders whose tests are counted: those of the floors that are measured. To count takes half as
long again, and statistics of thousands of tables elsewhere cover nothing more.
"""


REPEATED = ("cover", "alarms", "uniform", "unbiased", "seeds", "nineteen", "rarely", "thousand")
"""In the names of tests that run the same lines for thousands of drawn tables."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """With ``--cov``, counts where it tells something."""
    if config.getoption("cov_source", default=None):
        for item in items:
            inside = any(item.path.is_relative_to(TESTS / folder) for folder in COUNTED)
            if not inside or any(word in item.name for word in REPEATED):
                item.add_marker("no_cover")


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Where lines were counted (``--cov``): the share of each folder, files that fall short."""
    if config.getoption("cov_source", default=None):
        from covered import coverage_lines

        for line in coverage_lines():
            terminalreporter.write_line(line)
