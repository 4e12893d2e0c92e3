"""Machine tool uncertainty: from measurements of a machine to statements about its parts.

The public Python API, imported when it is used: `read_machine`, `read_part`, `read_study`,
`read_readings`, `read_points`, `check`, and a function for each command (`fit_components`,
`predict_points`, `lengths`, `simulate`, `graph_sweep`, ...), which returns a `Result`.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"
_READ = ("read_machine", "read_part", "read_study", "read_readings", "read_points", "check")


def __getattr__(name: str) -> Any:
    if name.startswith("_"):
        raise AttributeError(name)
    api = import_module("mtu_cli.api")
    return getattr(api, name) if name in (*_READ, "Result") else api.function_of(name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_READ, *import_module("mtu_cli.api").FUNCTIONS, "Result"])
