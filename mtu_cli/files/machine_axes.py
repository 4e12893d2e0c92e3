"""Axes by other names than x, y and z: one fault of a machine file, however often they stand."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from mtu_cli.errors import SHOWN_ROWS
from mtu_cli.files.column_dimensions import POSITIONS
from mtu_cli.files.contract_errors import path_text
from mtu_cli.files.contracts import Findings
from mtu_cli.files.yaml_file import YamlPath

_EQUATION = re.compile(r"E([A-Za-z])")
EXPECTED = "x, y and z for axes and positions, Ex, Ey and Ez for equations: there are no others"


def tell_axes_once(findings: Findings) -> frozenset[str]:
    """Puts one problem in the place of those of `axes`, `of` and equations of other axes, where
    there are several. Returns the names of these axes.
    """
    places = {path_text(path): (path, name) for path, name in _others(findings.document.data)}
    told = [problem for problem in findings.problems if problem.path in places]
    if len(told) < 2:
        return frozenset()
    findings.problems = [item for item in findings.problems if item.path not in places]
    names = dict.fromkeys(name for _, name in places.values())
    lines = sorted({problem.line for problem in told if problem.line is not None})
    shown = ", ".join(map(str, lines))
    if len(lines) > SHOWN_ROWS:
        shown = f"{lines[0]} to {lines[-1]}"
    path, _ = min(places.values(), key=lambda place: findings.document.line_of(*place[0]) or 0)
    what = f"other axes than x, y and z (line{'s' * (len(lines) > 1)} {shown})"
    findings.add(path, what, value=", ".join(names), expected=EXPECTED)
    return frozenset(names)


def _others(data: Any) -> Iterator[tuple[YamlPath, str]]:
    """Places where an axis of another name stands, and that name."""
    for name in _mapping(data, "axes"):
        yield from _other(("axes", name), name)
    for name, component in _mapping(data, "components").items():
        if isinstance(component, dict):
            yield from _other(("components", name, "of"), component.get("of"))
    yield from _of_equations(data, ())
    effects = data.get("effects")
    for index, effect in enumerate(effects if isinstance(effects, list) else ()):
        yield from _of_equations(effect, ("effects", index))


def _of_equations(entry: Any, path: YamlPath) -> Iterator[tuple[YamlPath, str]]:
    for key in _mapping(entry, "equations"):
        if found := _EQUATION.fullmatch(key):
            yield from _other((*path, "equations", key), found[1])


def _other(path: YamlPath, name: object) -> Iterator[tuple[YamlPath, str]]:
    # X for x is told so.
    if isinstance(name, str) and name.casefold() not in POSITIONS:
        yield path, name


def _mapping(data: Any, key: str) -> Mapping[str, Any]:
    found = data.get(key) if isinstance(data, dict) else None
    return found if isinstance(found, dict) else {}
