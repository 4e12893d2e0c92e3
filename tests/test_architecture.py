"""The rooms of the house: imports go down, never up, make no circle, and cost no time."""

import ast
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import mtu_cli

ROOT = Path(mtu_cli.__file__).parent
FLOORS = {
    "findings": 0, "units": 0, "help": 1, "language": 1, "files": 2,
    "stats": 3, "formats": 4, "model": 4, "checks": 5, "analyses": 5, "reports": 6,
    "result": 6, "cli": 7, "api": 8,
}  # fmt: skip
HEAVY = ("numpy", "pandas", "scipy", "matplotlib", "pydantic")
SLOW = ("pandas", "scipy.linalg", "scipy.stats", "matplotlib")


def dotted(path: Path) -> str:
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {dotted(path): path for path in sorted(ROOT.rglob("*.py"))}


@cache
def imports(module: str) -> frozenset[str]:
    found = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = (f"{node.module}.{alias.name}" for alias in node.names)
            found |= {name if name in MODULES else node.module for name in names}
    return frozenset(found & MODULES.keys())


def floor(module: str) -> int | None:
    """How high the room of a module lies; None for the house itself, which is its door."""
    return FLOORS[module.split(".")[1]] if "." in module else None


def test_imports_go_down_only() -> None:
    upward = [
        f"{module} imports {other}"
        for module in MODULES
        for other in imports(module)
        if (own := floor(module)) is not None and (floor(other) or 0) > own
    ]
    assert not upward


def test_imports_make_no_circle() -> None:
    """Nor those for types alone."""
    graph = {name: imports(name) - {name} for name in MODULES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


@pytest.mark.parametrize(
    ("call", "without"),
    [
        ("--help", HEAVY),
        ("predict-points configs/gilsinn-ling", SLOW),
        ("graph simulate configs/graphs/axes-a-and-c.yaml", SLOW),
    ],
)
def test_a_command_imports_no_more_than_it_needs(call: str, without: tuple[str, ...]) -> None:
    code = (
        f"import sys; sys.argv = ['mtu', *{call.split()}]\n"
        "from mtu_cli.cli.main import main\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code\n"
        f"heavy = set({without}) & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT.parent
    )
    assert result.returncode == 0, result.stderr
