"""The floors of the house: imports go down, never up, and stay out of what costs time."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from module_graph import drawn, nodes, parsed

import mtu_cli

ROOT = Path(mtu_cli.__file__).parent
FLOORS = {
    "errors": 0,
    "slips": 0,
    "units": 0,
    "language": 1,
    "files": 2,
    "stats": 3,
    "model": 4,
    "analyses": 5,
    "reports": 6,
    "cli": 7,
}
SOLVERS = {"lstsq", "lsq_linear", "pinv", "pinvh", "qr", "solve", "solve_triangular", "cho_solve"}
"""What fits by least squares is made of; `stats` has the one routine, and what it stands on."""
SOLVED_ELSEWHERE = {
    "files/thermal_contract.py": "gradients of a file against their polynomial: files lie lower",
    "model/drift_simulation.py": "the smallest change that gives a stated drift: nothing is fitted",
    "model/effect_distinct.py": "orthonormal bases of many effects at once, to compare their spans",
    "model/estimates.py": "a Schur complement: powers of a covariance eliminated",
    "model/geometry.py": "the gradient of a circle's minimum, by the implicit function theorem",
    "model/graph/examine.py": "a partial correlation from a matrix that may be singular",
    "model/instruments.py": "the weight of a difference, its covariance perhaps singular",
    "model/variance.py": "a gradient with fewer columns of the same products",
}
"""Files that solve linear systems outside `stats`, each with its reason; no other may."""
BODIES = ("body", "orelse", "handlers", "finalbody")
MODULES = sorted(ROOT.rglob("*.py"))


def room(module: str) -> str:
    """The room of a dotted module name below mtu_cli."""
    return module.split(".")[1] if "." in module else "mtu_cli"


@cache
def imports(path: Path) -> list[tuple[str, int]]:
    """Imported modules with their lines, those for type checkers only left out."""
    skipped = {
        id(inner)
        for node in nodes(path)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    found: list[tuple[str, int]] = []
    for node in nodes(path):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            found += [(alias.name, node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.append((node.module, node.lineno))
    return found


def dotted(path: Path) -> str:
    """The name that a module is imported by."""
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported_at_once(body: list[ast.stmt]) -> Iterator[str]:
    """What is imported while a module loads: in no function, and not for type checkers only."""
    for node in body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield str(node.module)
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            yield from imported_at_once(node.orelse)
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            inner = (getattr(node, part, []) for part in BODIES)
            yield from (name for part in inner for name in imported_at_once(part))


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_go_down_only(path: Path) -> None:
    own = path.relative_to(ROOT).with_suffix("").parts[0]
    if own in ("__init__", "py"):
        return
    upward = [
        f"{path.name}:{line} imports {module}"
        for module, line in imports(path)
        if module.startswith("mtu_cli.") and FLOORS[room(module)] > FLOORS[own]
    ]
    assert not upward


def test_imports_make_no_circle() -> None:
    modules = {dotted(path): parsed(path) for path in MODULES}
    graph = {
        name: {other for other in imported_at_once(tree.body) if other in modules} - {name}
        for name, tree in modules.items()
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_pandas_and_slow_libraries_stay_in_their_rooms(path: Path) -> None:
    own = path.relative_to(ROOT).parts[0]
    for module, line in imports(path):
        top = module.split(".")[0]
        place = f"{path}:{line}"
        assert module != "scipy.stats", place
        assert not (module == "scipy" and "stats" in path.read_text()), place
        if top == "pandas":
            assert own in ("files", "reports"), place
        if top == "matplotlib":
            assert own == "reports", place


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_one_idea_a_file(path: Path) -> None:
    assert len(path.read_text("utf-8").splitlines()) <= 300


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_one_idea_a_function(path: Path) -> None:
    """At most 40 lines from `def` to the end, the docstring among them."""
    long = [
        f"{node.name} has {node.end_lineno - node.lineno + 1} lines"
        for node in nodes(path)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.end_lineno is not None
        and node.end_lineno - node.lineno >= 40
    ]
    assert not long


def solvers(tree: Iterable[ast.AST]) -> list[str]:
    """`name:line` of what solves linear systems: calls below `linalg`, and imports from there."""
    found: list[str] = []
    for node in tree:
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            below = ast.unparse(node.func.value).split(".")[-1]
            if node.func.attr in SOLVERS and below in ("linalg", "optimize"):
                found.append(f"{node.func.attr}:{node.lineno}")
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in (
            "numpy", "scipy",
        ):  # fmt: skip
            names = SOLVERS.intersection(alias.name for alias in node.names)
            found += [f"{name}:{node.lineno}" for name in sorted(names)]
    return found


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("np.linalg.lstsq(X, y)", ["lstsq:1"]),
        ("import numpy.linalg as linalg\nlinalg.qr(X)", ["qr:2"]),
        ("from scipy.linalg import solve, norm", ["solve:1"]),
        ("self.solve(X)\nfactor.qr()\nnp.linalg.norm(X)", []),
    ],
)
def test_solvers_are_seen(code: str, expected: list[str]) -> None:
    assert solvers(ast.walk(ast.parse(code))) == expected


def test_least_squares_is_solved_in_one_place() -> None:
    found = {
        str(path.relative_to(ROOT)): lines
        for path in MODULES
        if path.relative_to(ROOT).parts[0] != "stats" and (lines := solvers(nodes(path)))
    }
    new = {path: lines for path, lines in found.items() if path not in SOLVED_ELSEWHERE}
    assert not new, "use mtu_cli.stats.least_squares, or give the reason in SOLVED_ELSEWHERE"
    stale = {path for path in SOLVED_ELSEWHERE if path not in found}
    assert not stale, "these solve nothing any more: take them off the list"


def test_analyses_do_not_import_each_other() -> None:
    for path in (ROOT / "analyses").glob("*.py"):
        own = f"mtu_cli.analyses.{path.stem}"
        others = [m for m, _ in imports(path) if m.startswith("mtu_cli.analyses.") and m != own]
        assert not others, path.name


HEAVY = ("numpy", "pandas", "scipy", "matplotlib", "pydantic")
SLOW = ("pandas", "scipy.linalg", "scipy.special", "scipy.stats", "matplotlib")


@pytest.mark.parametrize(
    ("call", "without"),
    [
        ("--help", HEAVY),
        ("-h", HEAVY),
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


def test_only_files_opens_files() -> None:
    for path in MODULES:
        if path.relative_to(ROOT).parts[0] in ("files",):
            continue
        opened = [
            node.lineno
            for node in nodes(path)
            if isinstance(node, ast.Call)
            and (
                (isinstance(node.func, ast.Name) and node.func.id == "open")
                or (
                    isinstance(node.func, ast.Attribute)
                    and node.func.attr in ("read_text", "read_bytes", "write_text", "write_bytes")
                )
            )
        ]
        assert not opened, f"{path}:{opened}"


def test_the_readme_shows_the_house_as_it_is() -> None:
    assert drawn() in (ROOT.parent / "README.md").read_text("utf-8")
