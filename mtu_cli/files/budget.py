"""Budget files (``mtu/budget/1``): the contract, what it demands, and the equations as trees."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Field

from mtu_cli.files.contract import (
    Contract,
    Faults,
    NonNegative,
    Positive,
    check_contract,
    present,
    wrong,
)
from mtu_cli.files.source import Source
from mtu_cli.files.study import MAX_COVERAGE
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, path_text, read_yaml
from mtu_cli.findings import Finding, finding
from mtu_cli.language import Node, check_known, names, parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.unit_algebra import check_consistent
from mtu_cli.units import ANY, unit_powers

DistributionName = Literal[
    "normal", "t", "rectangular", "triangular", "trapezoidal", "curvilinear-trapezoidal", "arcsine"
]
BOUNDED = frozenset(get_args(DistributionName)) - {"normal", "t"}
LARGEST_PROBABILITY = 0.999
"""Beyond it a Monte Carlo takes too many trials to check the interval."""
LARGEST, SMALLEST = 1e150, 1e-150
"""Variances are squares, which a computer cannot hold beyond."""
LEAST_BOUNDED_DOF = 0.5
"""Fewer would let a half-width be uncertain by more than itself: dof = (a/da)^2 / 2."""
ROUNDING = 1e-9
OUTPUT_NAMES = ("y", "Y", "result", "measurand")
"""Of an equation whose quantity has no name, the first that no input has."""
WAYS = ("u", "half_width", "low", "U")
"""Keys of which one says how large a contribution is."""

Text = Annotated[str, Field(min_length=1)]
UNIT = "Unit, such as mm, 1/degC or um/m/K; it converts nothing, but those of a sum must agree"


def _lists_within(value: object) -> object:
    """A list of lists; one of them alone, ``[a, b]`` for ``[[a, b]]``, is a single fault."""
    if isinstance(value, list) and value and not any(isinstance(item, list) for item in value):
        raise wrong("brackets around each of them too, [[...], [...]]")
    return value


class Contribution(Contract):
    """How well a quantity is known from one source: JCGM 100:2008, 4.2 and 4.3."""

    says: str | None = Field(default=None, description="What it is, in words")
    u: NonNegative | None = Field(default=None, description="Standard uncertainty")
    half_width: NonNegative | None = Field(
        default=None, description="Half-width of the distribution's base"
    )
    low: float | None = Field(default=None, description="Lower limit; with `high`")
    high: float | None = Field(default=None, description="Upper limit; with `low`")
    U: NonNegative | None = Field(default=None, description="Expanded uncertainty; with `k`")
    k: Positive | None = Field(default=None, description="Coverage factor of `U`")
    distribution: DistributionName | None = Field(default=None, description="Default: normal")
    dof: Positive | None = Field(default=None, description="Degrees of freedom; default: infinite")
    top: NonNegative | None = Field(
        default=None, description="Half-width of the flat top of a trapezoidal distribution"
    )
    inexact: Positive | None = Field(
        default=None,
        description="Half-range of the half-width itself (curvilinear-trapezoidal), d of JCGM 101",
    )


class Input(Contribution):
    """An input quantity: an estimate and the contributions to its uncertainty."""

    value: float | None = Field(default=None, description="Estimate; default: mean of readings")
    unit: str | None = Field(default=None, description=UNIT)
    readings: Annotated[list[float], Field(min_length=2)] | None = Field(
        default=None, description="Repeated readings: mean, s/sqrt(n), n - 1"
    )
    contributions: list[Contribution] = Field(
        default=[],
        description="Further independent contributions to the same quantity; `readings` beside it",
    )


def _constant(value: object) -> object:
    """`g: 9.81` is a constant, `g: {value: 9.81, u: 0}`."""
    if isinstance(value, (str, list)):
        raise ValueError("a number, or keys with values: {value: 10, u: 0.1}")
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return {"value": value} if is_number else value


def _correlation(value: object) -> object:
    match value:
        case [str(), str(), int() | float() as r] if not isinstance(r, bool):
            return value
    raise ValueError("two inputs and a coefficient, such as [V, I, 0.2]")


Correlation = Annotated[
    list[Any],
    BeforeValidator(_correlation, json_schema_input_type=list[str | float]),
    Field(min_length=3, max_length=3),
]


class Quantity(Contract):
    """The measurand."""

    name: Text | None = Field(default=None, description="Its symbol; y by default")
    unit: str | None = Field(default=None, description=UNIT)
    says: str | None = Field(default=None, description="What it is, in words")


class Coverage(Contract):
    """How U is meant: for a coverage probability, or with a given factor."""

    probability: Annotated[float, Field(gt=0, le=LARGEST_PROBABILITY)] | None = Field(
        default=None, description="Coverage probability; k is then that of Student's t"
    )
    k: Annotated[float, Field(gt=0, lt=MAX_COVERAGE)] | None = Field(
        default=None, description="Coverage factor of U = k u"
    )


class Budget(Contract):
    """An uncertainty budget: JCGM 100, JCGM 101 and, with several equations, JCGM 102."""

    schema_: Literal["mtu/budget/1"] = Field(alias="schema")
    name: Text
    says: str | None = Field(default=None, description="What it is, in words")
    notes: str | None = Field(default=None, description="Free text")
    quantity: Quantity | None = Field(default=None, description="The measurand of `equation`")
    units: dict[str, str] = Field(default={}, description="Units of the outputs of `equations`")
    equation: str | None = Field(default=None, description="The measurand in terms of the inputs")
    equations: Annotated[dict[str, str], Field(min_length=1)] | None = Field(
        default=None, description="Several measurands, with their covariance"
    )
    inputs: Annotated[
        dict[
            str, Annotated[Input, BeforeValidator(_constant, json_schema_input_type=Input | float)]
        ],
        Field(min_length=1),
    ]
    correlations: Annotated[list[Correlation], BeforeValidator(_lists_within)] = Field(
        default=[], description="[input, input, correlation coefficient]"
    )
    simultaneous: Annotated[
        list[Annotated[list[str], Field(min_length=2)]], BeforeValidator(_lists_within)
    ] = Field(default=[], description="Inputs whose readings were taken together")
    coverage: Coverage = Field(default=Coverage(), description="Default: probability 0.95")


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

    def check(budget: Budget, faults: Faults) -> None:
        for name, item in (budget.inputs or {}).items():
            _check_input(item, ("inputs", name), faults)
        taken = dict.fromkeys(("pi", *BUDGET_FUNCTIONS), "part of the equation language")
        for name in faults.given("inputs"):
            faults.symbol(("inputs", name), name, taken)
        _check_correlations(budget, faults)
        _check_simultaneous(budget, faults)
        coverage = budget.coverage
        if coverage is not None and coverage.probability is not None and coverage.k is not None:
            faults.add(("coverage",), "keys-exclude", keys="probability and k", expected="one")
        trees.update(_check_equations(budget, faults))

    budget = check_contract(document, Budget, "budget", check, largest=math.inf)
    return LoadedBudget(
        source=document.source,
        budget=budget,
        trees=trees,
        single=budget.equation is not None,
        warnings=tuple(_warnings(budget, trees, document)),
        document=document,
    )


def _check_input(item: Input, path: YamlPath, faults: Faults) -> None:
    _check_contribution(item, path, faults)
    limits = item.low is not None and item.high is not None
    if item.readings is not None:
        values = [reading for _, reading in present(item.readings)]
        for index, reading in present(item.readings):
            _check_size(reading, (*path, "readings", index), faults)
        if values:
            _check_size(max(values) - min(values), (*path, "readings"), faults, least=SMALLEST)
        given = [key for key in ("value", "low") if getattr(item, key) is not None]
        if given:
            keys = f"readings and {given[0]}"
            expected = "the readings alone: their mean is the value"
            faults.add((*path, given[0]), "keys-exclude", keys=keys, expected=expected)
    elif item.value is None and not limits and not faults.is_faulty(*path):
        faults.add(path, "missing-key", key="value", expected="a value or readings")
    elif item.value is not None and item.low is not None and item.high is not None:
        middle = 0.5 * (item.low + item.high)
        if abs(item.value - middle) > ROUNDING * max(abs(item.low), abs(item.high)):
            expected = f"{middle:g}, the middle of `low` and `high`, or none"
            faults.add((*path, "value"), "wrong-value", value=item.value, expected=expected)
    for index, part in present(item.contributions):
        own = (*path, "contributions", index)
        _check_contribution(part, own, faults)
        if part.low is not None and part.high is not None:
            expected = "half_width, about the input's value"
            faults.add(own, "key-elsewhere", key="low", where="the input itself", expected=expected)
        elif not _stated(part) and not faults.is_faulty(*own):
            faults.add(own, "missing-key", key="u", expected="u, half_width or U")


def _stated(item: Contribution) -> list[str]:
    """The ways in which a contribution says how large it is."""
    stated = [way for way in WAYS if getattr(item, way) is not None]
    return [*stated, "low"] if item.high is not None and item.low is None else stated


def _check_contribution(item: Contribution, path: YamlPath, faults: Faults) -> None:
    for key in ("value", "low", "high", "u", "half_width", "U", "top", "inexact"):
        if (value := getattr(item, key, None)) is not None:
            least = 0.0 if key in ("value", "low", "high") else SMALLEST
            _check_size(value, (*path, key), faults, least)
    stated = _stated(item)
    if len(stated) > 1:
        keys, expected = " and ".join(stated), "one of u, half_width, low with high, U with k"
        faults.add(path, "keys-exclude", keys=keys, expected=expected)
        return
    for one, other in (("low", "high"), ("high", "low"), ("U", "k"), ("k", "U")):
        if getattr(item, one) is not None and getattr(item, other) is None:
            faults.add((*path, one), "key-needs", key=one, other=f"`{other}`")
    half = item.half_width
    if item.low is not None and item.high is not None:
        half = 0.5 * (item.high - item.low)
        if half <= 0.0:
            expected = f"a number below `high`, {item.high:g}"
            faults.add((*path, "low"), "wrong-value", value=item.low, expected=expected)
            return
        _check_size(half, (*path, "low"), faults, SMALLEST)
    if item.U is not None and item.k is not None:
        _check_size(item.U / item.k, (*path, "k"), faults, SMALLEST)
    _check_distribution(item, stated, half, path, faults)


def _check_size(value: float, path: YamlPath, faults: Faults, least: float = 0.0) -> None:
    """Numbers whose squares a computer holds; a width, which has a `least`, may be 0."""
    if abs(value) > LARGEST or 0.0 < abs(value) < least:
        expected = f"{SMALLEST:g} to {LARGEST:g}, in another unit"
        faults.add(path, "number-extreme", value=value, expected=expected)


def _check_distribution(
    item: Contribution, stated: Sequence[str], half: float | None, path: YamlPath, faults: Faults
) -> None:
    """That a distribution has what it needs, and nothing has what only another one has."""
    kind = item.distribution or "normal"
    if kind not in BOUNDED and stated in (["half_width"], ["low"]):
        expected = "`distribution: rectangular`, say, or u"
        faults.add(path, "no-limits", distribution=kind, expected=expected)
    if item.distribution is not None and not stated:
        other = "`u`, `half_width` or `low` and `high`"
        faults.add((*path, "distribution"), "key-needs", key="distribution", other=other)
    if kind == "t" and item.dof is None:
        faults.add(path, "missing-key", key="dof", expected="`dof: 9`, say, of a t distribution")
    if item.dof is not None and not stated:
        other = "`u`, `half_width` or `U` (readings have n - 1)"
        faults.add((*path, "dof"), "key-needs", key="dof", other=other)
    elif item.dof is not None and kind in BOUNDED and item.dof < LEAST_BOUNDED_DOF:
        expected = f"{LEAST_BOUNDED_DOF:g} or more for limits (JCGM 100, G.4.2)"
        faults.add((*path, "dof"), "wrong-value", value=item.dof, expected=expected)
    if item.dof is not None and item.inexact is not None:
        expected = "one: dof = (half_width/inexact)^2 / 2 (JCGM 100, G.4.2)"
        faults.add((*path, "dof"), "keys-exclude", keys="inexact and dof", expected=expected)
    u = item.u if half is None else None
    for key, owner, ratio in (
        ("top", "trapezoidal", math.sqrt(3.0)),
        ("inexact", "curvilinear-trapezoidal", 1.5),
    ):
        value = getattr(item, key)
        if kind == owner and value is None and (key == "top" or item.dof is None):
            faults.add(path, "missing-key", key=key, expected=f"that of a {owner} distribution")
        if value is None:
            continue
        if kind != owner:
            faults.add((*path, key), "key-elsewhere", key=key, where=f"`distribution: {owner}`")
        # The widest that any half-width leaves room for: of a u that of a rectangle.
        most = half if half is not None else None if u is None else ratio * u
        if most is not None and value > most:
            expected = f"at most {most:.6g}, by the half-width or u"
            faults.add((*path, key), "wrong-value", value=value, expected=expected)


def _check_correlations(budget: Budget, faults: Faults) -> None:
    """Known names of uncertain inputs, coefficients of -1 to 1, no pair twice."""
    known, inputs = faults.keys("inputs"), budget.inputs or {}

    def judge(path: YamlPath, name: str) -> None:
        if name not in known:
            faults.unknown(path, name, known)
        elif name in inputs and not _is_uncertain(inputs[name]):
            faults.add(path, "not-correlatable", value=name, expected="an uncertain input")

    pairs = present(budget.correlations)
    faults.correlated(pairs, judge)
    together = [set(group) for _, group in present(budget.simultaneous)]
    for index, (first, second, _) in pairs:
        if first != second and any({first, second} <= group for group in together):
            keys, expected = "correlations and simultaneous", "one: readings have a correlation"
            own, path = [first, second], ("correlations", index)
            faults.add(path, "keys-exclude", keys=keys, value=own, expected=expected)


def _check_simultaneous(budget: Budget, faults: Faults) -> None:
    """Known names, none twice, of inputs with equally many readings."""
    known = faults.keys("inputs")
    seen: set[str] = set()
    for index, group in present(budget.simultaneous):
        path: YamlPath = ("simultaneous", index)
        counts = {}
        for place, name in enumerate(group):
            item = (budget.inputs or {}).get(name)
            if name not in known:
                faults.unknown((*path, place), name, known)
            elif name in seen:
                faults.add((*path, place), "appears-twice", what="the input", value=name)
            elif item is not None and item.readings is None:
                faults.add((*path, place), "key-needs", key=name, other="`readings`")
            elif item is not None and item.readings is not None:
                counts[name] = len(item.readings)
            seen.add(name)
        if len(set(counts.values())) > 1:
            listed = ", ".join(f"{name} {count}" for name, count in counts.items())
            expected = "one reading of each input at a time"
            faults.add(path, "unequal-counts", counts=listed, expected=expected)


def _is_uncertain(item: Input) -> bool:
    """Whether anything that an entry says makes it vary."""
    widths = [getattr(part, way) for part in (item, *item.contributions) for way in ("u", "U")]
    widths += [part.half_width or part.inexact for part in (item, *item.contributions)]
    return any(widths) or item.low is not None or len(set(item.readings or [])) > 1


def _check_equations(budget: Budget, faults: Faults) -> dict[str, Node]:
    """The sound equations as trees by their outputs."""
    given, inputs = faults.given(), faults.keys("inputs")
    ways = [key for key in ("equation", "equations") if key in given]
    if len(ways) == 2:
        faults.add(("equations",), "keys-exclude", keys=" and ".join(ways), expected="one")
    elif not ways:
        faults.add((), "missing-key", key="equation", expected="equation: or equations:")
    _check_outputs(budget, faults)
    equations: list[tuple[str, YamlPath, YamlPath, str, str | None]] = []
    if budget.equation is not None:
        quantity = budget.quantity or Quantity()
        free = next((own for own in OUTPUT_NAMES if own not in inputs), "y_1")
        named, unit = ("quantity", "name"), ("quantity", "unit")
        name = quantity.name or free
        equations.append((name, ("equation",), named, budget.equation, quantity.unit))
        units: dict[YamlPath, YamlPath] = {("equation",): unit}
    else:
        units = {}
    for name, text in (budget.equations or {}).items():
        own: YamlPath = ("equations", name)
        units[own] = ("units", name)
        equations.append((name, own, own, text, (budget.units or {}).get(name)))
    stated = {name: item.unit for name, item in (budget.inputs or {}).items()}
    texts = [*stated.values(), *(unit for *_, unit in equations)]
    named_units = {text: unit_powers(text) for text in texts if text}
    powers = {name: named_units.get(text or "", ANY) for name, text in stated.items()}
    trees = {}
    for name, path, named_at, text, unit_text in equations:
        if not name.strip():
            faults.add(named_at, "not-a-name", value=name, expected="a name before its equation")
        elif name in inputs:
            faults.add(named_at, "name-taken", value=name, taken="an input")
        tree = _tree(text, inputs, path, faults)
        if tree is None:
            continue
        trees[name] = tree
        wanted = named_units.get(unit_text or "", ANY)
        within, result = check_consistent(tree, powers, wanted, named_units)
        faults.extend(path, within)
        if result is not None:
            faults.extend(units[path], [result])
    return trees


def _check_outputs(budget: Budget, faults: Faults) -> None:
    outputs = faults.keys("equations")
    for name in budget.units or {}:
        if name not in outputs:
            faults.unknown(("units", name), name, outputs, "output")
    if budget.quantity is not None and outputs:
        where, expected = "a single `equation`", "`units: {...}`"
        path = ("quantity",)
        faults.add(path, "key-elsewhere", key="quantity", where=where, expected=expected)


def _tree(text: str, known: Sequence[str], path: YamlPath, faults: Faults) -> Node | None:
    """The tree of an equation; None where it is none, or has names that no input has."""
    with faults.collected(path):
        tree = parse(text, BUDGET_FUNCTIONS)
        # Without any inputs every name would be unknown: the missing key is reported.
        if known:
            check_known(tree, known)
            return tree
    return None


def _warnings(budget: Budget, trees: dict[str, Node], document: YamlDocument) -> Iterator[Finding]:
    """Inputs that no equation has, that have no uncertainty, scatter or known unit.

    A plain number (``g: 9.81``) is meant as a constant, and so is a `u` of 0. A budget in which
    no unit is stated says nothing of units.
    """
    used = {name for tree in trees.values() for name in names(tree)}
    file = document.source.shown
    exact, without = [], []
    for name, item in budget.inputs.items():
        path: YamlPath = ("inputs", name)
        place = {"file": file, "line": document.line_of(*path), "path": path_text(path)}
        if name not in used:
            yield finding("unused", what="input", name=name, **place)
            continue
        is_constant = not isinstance(document.data["inputs"][name], dict)
        varied = _is_uncertain(item)
        if item.readings and not varied:
            place["line"] = document.line_of(*path, "readings")
            yield finding("equal-readings", n=len(item.readings), **place)
        elif not (varied or is_constant or 0.0 in (item.u, item.half_width, item.U)):
            exact.append(name)
        if item.unit is None or not unit_powers(item.unit).known:
            without.append(name)
    if exact:
        line = document.line_of("inputs", exact[0])
        yield finding("taken-as-exact", names=exact, file=file, line=line)
    if without and any(item.unit is not None for item in budget.inputs.values()):
        line = document.line_of("inputs", without[0])
        yield finding("unit-not-checked", names=without, file=file, line=line)
