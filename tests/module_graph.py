"""The house as a picture: which room imports from which, drawn from the imports themselves.

`python tests/module_graph.py` prints the block that stands in the README.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

import mtu_cli

ROOT = Path(mtu_cli.__file__).parent
SAYS = {
    "cli": "commands, options",
    "reports": "tables, JSON, pictures",
    "analyses": "one folder a question",
    "model": "the machine, its errors, effects",
    "stats": "numbers in, numbers out",
    "files": "CSV, YAML, JSON",
    "language": "equations",
    "errors": "problems of the input",
    "units": "um, arcsec, degC",
}


@cache
def parsed(path: Path) -> ast.Module:
    """The tree of a module's text."""
    return ast.parse(path.read_text("utf-8"))


@cache
def nodes(path: Path) -> list[ast.AST]:
    """All nodes of the tree: to walk through it takes as long as to parse it."""
    return list(ast.walk(parsed(path)))


def room(path: Path) -> str:
    """The room that a module stands in."""
    return path.relative_to(ROOT).with_suffix("").parts[0]


def doors() -> dict[str, set[str]]:
    """Rooms that each room imports from."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in ROOT.rglob("*.py"):
        for node in nodes(path):
            module = node.module if isinstance(node, ast.ImportFrom) else None
            if module and module.startswith("mtu_cli."):
                other = module.split(".")[1]
                if other != room(path) and room(path) in SAYS:
                    found[room(path)].add(other)
    return found


def drawn() -> str:
    """The mermaid block; a door that is there through another room's doors is left out."""
    known = doors()
    lines = ["```mermaid", "graph TD"]
    lines += [f'  {name}["<b>{name}</b><br/>{says}"]' for name, says in SAYS.items()]
    for name in SAYS:
        further = {far for near in known[name] for far in _reached(near, known)}
        lines += [f"  {name} --> {other}" for other in SAYS if other in known[name] - further]
    return "\n".join([*lines, "```"])


def _reached(name: str, known: dict[str, set[str]]) -> set[str]:
    return known[name] | {far for near in known[name] for far in _reached(near, known)}


if __name__ == "__main__":
    print(drawn())
