"""Budget files (``mtu/budget/1``): read, checked, and their equations as trees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mtu_cli.errors import did_you_mean
from mtu_cli.files.budget_checks import check_coverage, check_inputs, check_joint
from mtu_cli.files.budget_contract import Budget, Contribution, Correlation, Coverage, Input
from mtu_cli.files.budget_fahrenheit import unconverted
from mtu_cli.files.budget_kelvin import mixed_temperatures
from mtu_cli.files.budget_notices import notices, stated_unit
from mtu_cli.files.budget_ones import beside_ones
from mtu_cli.files.budget_readings import reading_notices
from mtu_cli.files.budget_sizes import check_sizes
from mtu_cli.files.budget_units import BudgetUnits
from mtu_cli.files.contract_errors import path_text
from mtu_cli.files.contracts import Findings, check_contract, is_identifier
from mtu_cli.files.source import Source
from mtu_cli.files.unit_text import grams
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, read_yaml
from mtu_cli.findings import Finding
from mtu_cli.language import EquationError, Node, names, parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS

__all__ = [
    "Budget",
    "Contribution",
    "Correlation",
    "Coverage",
    "Input",
    "LoadedBudget",
    "budget_from",
    "load_budget",
]

OUTPUT_NAMES = ("y", "Y", "result")
"""Of an equation whose quantity has no name, the first that no input has."""
RESERVED = frozenset(BUDGET_FUNCTIONS) | {"pi"}


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedBudget:
    """A checked budget; `trees` holds the equation of each output, by the output's name.

    `single`: whether the file has an `equation`, not `equations`.
    """

    source: Source
    budget: Budget
    trees: dict[str, Node]
    single: bool
    warnings: tuple[Finding, ...]
    document: YamlDocument

    def line_of(self, *path: str | int) -> int | None:
        """The line of a value of the file: ``line_of("inputs", "ls")``."""
        return self.document.line_of(*path)

    def place(self, output: str) -> tuple[str | int, ...]:
        """The path of an output's equation in the file."""
        return ("equation",) if self.single else ("equations", output)

    @property
    def units(self) -> dict[str, str]:
        """The unit of every output, empty where none is stated."""
        budget = self.budget
        if self.single:
            unit = budget.quantity.unit if budget.quantity else None
            return dict.fromkeys(self.trees, unit or "")
        return {name: budget.units.get(name, "") for name in self.trees}


def load_budget(path: Path, role: str = "budget") -> LoadedBudget:
    """Reads and checks a budget file.

    Raises InputError with all problems of the file, each with its line.
    """
    return budget_from(read_yaml(path, role))


def budget_from(document: YamlDocument) -> LoadedBudget:
    """Checks a budget that was read already.

    Raises InputError with all problems of the document.
    """
    trees: dict[str, Node] = {}
    known = _names_of(document)

    def check(budget: Budget, findings: Findings) -> None:
        check_inputs(budget, findings)
        check_sizes(budget, findings)
        check_joint(budget, findings)
        check_coverage(budget, findings)
        _check_names(findings)
        _check_units(budget, findings)
        stated = {name: item.unit for name, item in (budget.inputs or {}).items()}
        given = [*stated.values(), *(budget.units or {}).values()]
        given += [budget.quantity.unit] if budget.quantity is not None else []
        units = [BudgetUnits.of_inputs(stated, gram) for gram in grams(given)]
        for name, place, text in _equations(budget, findings):
            tree = _tree(text, known, place, findings)
            if tree is not None:
                trees[name] = tree
                _check_tree_units(budget, units, tree, place, findings)
        _check_temperatures(budget, trees, findings)

    budget = check_contract(document, Budget, "budget", check)
    return LoadedBudget(
        source=document.source,
        budget=budget,
        trees=trees,
        single=budget.equation is not None,
        warnings=(*notices(budget, trees, document), *reading_notices(budget, document)),
        document=document,
    )


def _names_of(document: YamlDocument) -> tuple[str, ...]:
    # Inputs whose own entry is faulty are not unknown: they have a message of their own.
    return Findings(document).keys("inputs")


def _equations(budget: Budget, findings: Findings) -> list[tuple[str, YamlPath, str]]:
    top = findings.given()
    given = [key for key in ("equation", "equations") if key in top]
    if len(given) == 2:
        findings.add(("equations",), "both `equation` and `equations` are given", expected="one")
    elif not given:
        findings.add_missing((), "equation", expected="equation: or equations:")
    found: list[tuple[str, YamlPath, str]] = []
    if budget.equation is not None:
        found.append((_output_name(budget, findings), ("equation",), budget.equation))
    for name, text in (budget.equations or {}).items():
        found.append((name, ("equations", name), text))
    for name, place, _ in found:
        if not name.strip():
            findings.add(place, "an output without a name", expected="a name before its equation")
        if name in findings.keys("inputs"):
            place = ("quantity", "name") if place == ("equation",) else place
            what = "an input has the same name as this output"
            findings.add(place, what, value=name, expected="a name of its own")
    return found


def _output_name(budget: Budget, findings: Findings) -> str:
    if budget.quantity is not None and budget.quantity.name is not None:
        return budget.quantity.name
    taken = findings.keys("inputs")
    return next((name for name in OUTPUT_NAMES if name not in taken), "measurand")


def _check_units(budget: Budget, findings: Findings) -> None:
    outputs = findings.keys("equations")
    for name in budget.units or {}:
        if name not in outputs:
            expected = did_you_mean(name, outputs)
            findings.add(("units", name), "no such output", value=name, expected=expected)
    if budget.quantity is not None and outputs:
        findings.add(
            ("quantity",), "`quantity` belongs to a single `equation`", expected="`units: {...}`"
        )


def _check_temperatures(budget: Budget, trees: Mapping[str, Node], findings: Findings) -> None:
    """Of scales that do not go together: degF, degC, K."""
    inputs = budget.inputs or {}
    units = {name: item.unit for name, item in inputs.items()}
    for name, expected in unconverted(units, trees.values()):
        what = "degF beside degC or K: no unit is converted"
        findings.add(("inputs", name, "unit"), what, value=units[name], expected=expected)
    for mixed in mixed_temperatures(inputs, trees.values()):
        if mixed.sure:
            place = ("inputs", mixed.name, "unit")
            findings.add(place, mixed.what, value=units[mixed.name], expected=mixed.expected)


def _check_tree_units(
    budget: Budget, units: Sequence[BudgetUnits], tree: Node, place: YamlPath, findings: Findings
) -> None:
    """What is at fault whichever of its `units` a g is."""
    first, *others = units
    path = ("quantity", "unit") if place == ("equation",) else ("units", str(place[-1]))
    stated = stated_unit(budget, place)
    found, *also = (
        [*beside_ones(own, tree, stated)] or [*own.faults(tree, stated)] for own in units
    )
    columns = [{error.column for error in own} for own in also]
    shared = [error for error in found if all(error.column in own for own in columns)]
    for error in shared:
        _add(findings, place, error)
    if shared:
        return
    fault = first.result_fault(tree, stated)
    if fault is not None and all(own.result_fault(tree, stated) for own in others):
        findings.add(path, fault.what, value=stated, expected=fault.expected)


def _check_names(findings: Findings) -> None:
    # One without a value has its own message.
    for name in findings.given("inputs"):
        if not is_identifier(name):
            what = "no equation can use this name"
            findings.add(
                ("inputs", name), what, value=name, expected="letters, digits and _, such as l_s"
            )
        elif name in RESERVED:
            what = "the name of a function or constant of the equations"
            findings.add(("inputs", name), what, value=name, expected="another name")


def _tree(text: str, known: tuple[str, ...], place: YamlPath, findings: Findings) -> Node | None:
    try:
        tree = parse(text, BUDGET_FUNCTIONS)
    except EquationError as error:
        _add(findings, place, error)
        return None
    if not known:
        # That is told; so every name would be unknown.
        return None
    unknown = [(name, column) for name, column in names(tree).items() if name not in known]
    for name, column in unknown:
        hint = did_you_mean(name, known)
        _add(findings, place, EquationError(f"unknown name {name!r}", column, hint))
    return None if unknown else tree


def _add(findings: Findings, path: YamlPath, error: EquationError) -> None:
    document = findings.document
    line = document.line_of(*path)
    findings.problems.append(
        error.problem(file=document.source.shown, line=line, path=path_text(path))
    )
