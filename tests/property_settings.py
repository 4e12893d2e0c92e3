"""How many examples properties are tried on: few in the suite, more with MTU_EXAMPLES."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

TIMES = int(os.environ.get("MTU_EXAMPLES", "1"))
"""Times as many as in the suite."""


def tried(examples: int) -> settings:
    """The same examples in every run; those of folders that tests share are independent."""
    return settings(
        derandomize=True,
        deadline=None,
        database=None,
        max_examples=examples * TIMES,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )
