"""Budget files (``mtu/budget/1``): the contract, what it demands, and the equations as trees."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Field

from mtu_cli.files.contract import (
    Contract,
    Faults,
    IdText,
    Loaded,
    Name,
    NonNegative,
    Positive,
    check_contract,
    is_number,
    optional,
    present,
    wrong,
)
from mtu_cli.files.study import MAX_COVERAGE, CoverageFactor
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, read_yaml
from mtu_cli.findings import Finding, finding
from mtu_cli.language import Node, check_known, names, parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.unit_algebra import check_consistent
from mtu_cli.units import unit_powers

DistributionName = Literal[
    "normal", "t", "rectangular", "triangular", "trapezoidal", "curvilinear-trapezoidal", "arcsine"
]
BOUNDED = frozenset(get_args(DistributionName)) - {"normal", "t"}
LARGEST_PROBABILITY = 0.999
"""Beyond it a Monte Carlo takes too many trials to check the interval."""
LARGEST = 1e150
"""Variances are squares, which a computer cannot hold beyond."""
LEAST_DOF = 0.5
"""Fewer would let a half-width be uncertain by more than itself: dof = (a/da)^2 / 2."""
ROUNDING = 1e-9
WAYS = ("u", "half_width", "low", "U")
"""Keys of which one says how large a contribution is."""
PAIRS = {"low": "high", "high": "low", "U": "k", "k": "U"}
SHAPES = {"top": ("trapezoidal", math.sqrt(3.0)), "inexact": ("curvilinear-trapezoidal", 1.5)}
"""Keys of one distribution alone, and the largest they may be over u: that of a rectangle."""
UNIT = "Unit, such as mm, 1/degC or um/m/K; it converts nothing, but those of a sum must agree"


def _triple(value: object) -> object:
    if not isinstance(value, list) or len(value) != 3:
        raise wrong("two names and a coefficient, such as [V, I, 0.2]")
    return tuple(value)


def _constant(value: object) -> object:
    """`g: 9.81` is a constant, `g: {value: 9.81, u: 0}`."""
    if isinstance(value, (str, list)):
        raise wrong("a number, or keys with values: {value: 10, u: 0.1}")
    return {"value": value} if is_number(value) else value


Value = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Width = Annotated[NonNegative, Field(le=LARGEST)]
Correlation = Annotated[
    tuple[IdText, IdText, float], BeforeValidator(_triple, json_schema_input_type=list[Any])
]


class Contribution(Contract):
    """How well a quantity is known from one source: JCGM 100:2008, 4.2 and 4.3."""

    says: str | None = optional("What it is, in words")
    u: Width | None = optional("Standard uncertainty")
    half_width: Width | None = optional("Half-width of the distribution's base")
    low: Value | None = optional("Lower limit; with `high`")
    high: Value | None = optional("Upper limit; with `low`")
    U: Width | None = optional("Expanded uncertainty; with `k`")
    k: Annotated[float, Field(ge=0.1, lt=MAX_COVERAGE)] | None = optional("Coverage factor of `U`")
    distribution: DistributionName | None = optional("Default: normal")
    dof: Annotated[float, Field(ge=LEAST_DOF)] | None = optional(
        "Degrees of freedom; default: infinite"
    )
    top: Width | None = optional("Half-width of the flat top of a trapezoidal distribution")
    inexact: Positive | None = optional(
        "Half-range of the half-width itself (curvilinear-trapezoidal), d of JCGM 101"
    )

    @property
    def middle(self) -> float | None:
        """The estimate that two limits state."""
        return None if self.low is None or self.high is None else 0.5 * (self.low + self.high)

    @property
    def half(self) -> float | None:
        """The half-width that is stated, by itself or by two limits."""
        if self.low is None or self.high is None:
            return self.half_width
        return 0.5 * (self.high - self.low)

    @property
    def standard(self) -> float | None:
        """The standard uncertainty that is stated, by itself or expanded."""
        return self.u if self.U is None or self.k is None else self.U / self.k

    @property
    def ways(self) -> list[str]:
        """The keys that say how large it is: of a sound one a single key, or none."""
        keys = [way for way in WAYS if getattr(self, way) is not None]
        return [*keys, "low"] if self.high is not None and self.low is None else keys

    def check(self, faults: Faults) -> None:
        """That a width is stated in one way, and whole; that its distribution has what it needs,
        and nothing has what only another one has.
        """
        kind, dof, ways = self.distribution or "normal", self.dof, self.ways
        if len(ways) > 1:
            expected = "one of u, half_width, low with high, U with k"
            faults.add("exclusive", names=" and ".join(ways), expected=expected)
            return
        if self.low is not None and self.high is not None and self.low >= self.high:
            faults.at("low").add("wrong-value", expected=f"a number below `high`, {self.high:g}")
            return
        needs = {key: f"`{other}`" for key, other in PAIRS.items() if getattr(self, other) is None}
        if not ways:
            width = "a width: `u`, `half_width`, `U`, or `low` and `high`"
            needs |= {"distribution": width, "dof": width}
        for key, other in needs.items():
            if getattr(self, key) is not None:
                faults.at(key).add("incomplete", what=f"`{key}`", other=other)
        if kind not in BOUNDED and ways in (["half_width"], ["low"]):
            expected = "`distribution: rectangular`, say, or u"
            faults.add("no-limits", distribution=kind, expected=expected)
        if kind == "t" and dof is None:
            faults.add("missing-key", key="dof", expected="`dof: 9`, say, of a t distribution")
        if dof is not None and self.inexact is not None:
            expected = "one: dof = (half_width/inexact)^2 / 2 (JCGM 100, G.4.2)"
            faults.at("dof").add("exclusive", names="inexact and dof", expected=expected)
        for key, (owner, ratio) in SHAPES.items():
            value, here = getattr(self, key), faults.at(key)
            # The widest that any half-width leaves room for.
            limit = self.half if self.half is not None else ratio * (self.u or math.inf)
            if value is None and kind == owner and (key == "top" or dof is None):
                faults.add("missing-key", key=key, expected=f"that of a {owner} distribution")
            elif value is not None and kind != owner:
                here.add("misplaced", key=key, where=f"`distribution: {owner}`")
            elif value is not None and value > limit:
                here.add("wrong-value", expected=f"at most {limit:.6g}, by the half-width or u")


class Input(Contribution):
    """An input quantity: an estimate and the contributions to its uncertainty."""

    value: Value | None = optional("Estimate; default: mean of readings")
    unit: str | None = optional(UNIT)
    readings: Annotated[list[Value], Field(min_length=2)] | None = optional(
        "Repeated readings: mean, s/sqrt(n), n - 1"
    )
    contributions: list[Contribution] = optional(
        "Further independent contributions to the same quantity; `readings` beside it", []
    )

    @property
    def varies(self) -> bool:
        """Whether anything that it states makes it uncertain."""
        parts = (self, *self.contributions)
        widths = (part.standard or part.half or part.inexact for part in parts)
        return any(widths) or len(set(self.readings or ())) > 1

    def check(self, faults: Faults) -> None:
        """That its value is stated once, and a width of every contribution."""
        super().check(faults)
        if self.readings is not None:
            for key in ("value", "low"):
                if getattr(self, key) is not None:
                    names = f"readings and {key}"
                    expected = "the readings alone: their mean is the value"
                    faults.at(key).add("exclusive", names=names, expected=expected)
        elif self.value is None and self.low is None and self.high is None:
            faults.add("missing-key", key="value", expected="a value or readings")
        elif self.value is not None and self.low is not None and self.high is not None:
            difference = abs(self.value - 0.5 * (self.low + self.high))
            if difference > ROUNDING * max(abs(self.low), abs(self.high)):
                expected = f"{self.middle:g}, the middle of `low` and `high`, or none"
                faults.at("value").add("wrong-value", expected=expected)
        for index, part in enumerate(self.contributions):
            here = faults.at("contributions", index)
            if part.middle is not None:
                expected = "half_width, about the input's value"
                here.add("misplaced", key="low", where="the input itself", expected=expected)
            elif not part.ways:
                here.add("missing-key", key="u", expected="u, half_width or U")


InputEntry = Annotated[Input, BeforeValidator(_constant, json_schema_input_type=Input | float)]


class Quantity(Contract):
    """The measurand."""

    name: Name | None = optional("Its symbol; y by default")
    unit: str | None = optional(UNIT)
    says: str | None = optional("What it is, in words")


class Coverage(Contract):
    """How U is meant: for a coverage probability, or with a given factor."""

    probability: Annotated[float, Field(gt=0, le=LARGEST_PROBABILITY)] | None = optional(
        "Coverage probability; k is then that of Student's t"
    )
    k: CoverageFactor | None = optional("Coverage factor of U = k u")

    def check(self, faults: Faults) -> None:
        """One of both."""
        if self.probability is not None and self.k is not None:
            faults.add("exclusive", names="probability and k", expected="one")


class Budget(Contract):
    """An uncertainty budget: JCGM 100, JCGM 101 and, with several equations, JCGM 102."""

    schema_: Literal["mtu/budget/1"] = Field(alias="schema")
    name: Name
    says: str | None = optional("What it is, in words")
    notes: str | None = optional("Free text")
    quantity: Quantity | None = optional("The measurand of `equation`")
    units: dict[str, str] = optional("Units of the outputs of `equations`", {})
    equation: str | None = optional("The measurand in terms of the inputs")
    equations: Annotated[dict[Name, str], Field(min_length=1)] | None = optional(
        "Several measurands, with their covariance"
    )
    inputs: Annotated[dict[Name, InputEntry], Field(min_length=1)]
    correlations: list[Correlation] = optional("[input, input, correlation coefficient]", [])
    simultaneous: list[Annotated[list[str], Field(min_length=2)]] = optional(
        "Inputs whose readings were taken together", []
    )
    coverage: Coverage = optional("Default: probability 0.95", Coverage())


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedBudget(Loaded):
    """A checked budget; `trees` and `units` (empty: none) of each output by its name."""

    budget: Budget
    trees: dict[str, Node]
    units: dict[str, str]

    @property
    def single(self) -> bool:
        """Whether the file has an `equation`, not `equations`."""
        return self.budget.equation is not None

    def where(self, output: str) -> dict[str, Any]:
        """Where an output's equation stands, for a finding."""
        return self.place("equation") if self.single else self.place("equations", output)


def load_budget(file: Path | YamlDocument) -> LoadedBudget:
    """Checks a budget file, or one that was read already.

    Raises InputError with all problems of the file, each with its line.
    """
    document = file if isinstance(file, YamlDocument) else read_yaml(file, "budget")
    trees: dict[str, Node] = {}
    units: dict[str, str] = {}

    def check(budget: Budget, faults: Faults) -> None:
        uses = dict.fromkeys(("pi", *BUDGET_FUNCTIONS), "part of the equation language")
        at_inputs, at_equations = faults.at("inputs"), faults.at("equations")
        for name in at_inputs.valued_keys():
            at_inputs.at(name).symbol(name, uses)
        _check_correlations(budget, faults)
        stated, outputs = {*faults.valued_keys()}, at_equations.keys()
        if {"equation", "equations"} <= stated:
            at_equations.add("exclusive", names="equation and equations", expected="one")
        elif not {"equation", "equations"} & stated:
            faults.add("missing-key", key="equation", expected="equation: or equations:")
        for name in budget.units or {}:
            if name not in outputs:
                faults.at("units", name).unknown(name, outputs, "output")
        if budget.quantity is not None and outputs:
            facts = {"where": "a single `equation`", "expected": "`units: {...}`"}
            faults.at("quantity").add("misplaced", key="quantity", **facts)
        for name, unit, tree in _outputs(budget, faults):
            units[name], trees[name] = unit, tree

    budget = check_contract(document, Budget, "budget", check)
    warnings = tuple(_warnings(budget, trees, document))
    return LoadedBudget(
        document=document, warnings=warnings, budget=budget, trees=trees, units=units
    )


def _check_correlations(budget: Budget, faults: Faults) -> None:
    """Correlations of uncertain inputs, no pair twice; simultaneous inputs, each once."""
    keys, inputs = faults.at("inputs").keys(), budget.inputs
    pairs: set[frozenset[str]] = set()
    for index, (first, second, r) in present(budget.correlations):
        here = faults.at("correlations", index)
        for at, name in enumerate((first, second)):
            if name not in keys:
                here.at(at).unknown(name, keys)
            elif name in inputs and not inputs[name].varies:
                facts = {"reason": "it has no uncertainty", "expected": "an uncertain input"}
                here.at(at).add("wrong-correlation", **facts)
        if not -1.0 <= r <= 1.0:
            here.at(2).add("wrong-value", expected="-1 to 1")
        pair = frozenset((first, second))
        if first == second or pair in pairs:
            what = "the name" if first == second else "the correlation"
            here.add("appears-twice", what=what, value=f"{first}, {second}")
        pairs.add(pair)
    members: set[str] = set()
    for index, group in present(budget.simultaneous):
        counts, here = {}, faults.at("simultaneous", index)
        if any(pair <= set(group) for pair in pairs):
            ways, expected = "correlations and simultaneous", "one: readings have a correlation"
            here.add("exclusive", names=ways, expected=expected)
        for at, name in enumerate(group):
            if name not in keys:
                here.at(at).unknown(name, keys)
            elif name in members:
                here.at(at).add("appears-twice", what="the input")
            elif name in inputs and (readings := inputs[name].readings) is None:
                here.at(at).add("incomplete", what=f"`{name}`", other="`readings`")
            elif name in inputs and readings:
                counts[name] = len(readings)
            members.add(name)
        if len(set(counts.values())) > 1:
            text = ", ".join(f"{count} of {name}" for name, count in counts.items())
            facts = {"found": f"readings: {text}", "expected": "one of each input at a time"}
            here.add("wrong-count", **facts)


def _outputs(budget: Budget, faults: Faults) -> Iterator[tuple[str, str, Node]]:
    """Name, unit and tree of each measurand whose equation can be read; adds what is wrong."""
    keys, single = faults.at("inputs").keys(), budget.equation is not None
    texts, symbols = budget.equations or {}, budget.units or {}
    if budget.equation is not None:
        quantity = budget.quantity or Quantity()
        default = next((y for y in ("y", "Y", "result") if y not in keys), "y_1")
        name = quantity.name or default
        texts, symbols = {name: budget.equation}, {name: quantity.unit or ""}
    units = {name: item.unit or "" for name, item in budget.inputs.items()}
    outputs = {name: symbols.get(name) or "" for name in texts}
    powers_of = {text: unit_powers(text) for text in (*units.values(), *outputs.values())}
    powers = {name: powers_of[text] for name, text in units.items()}
    for name, text in texts.items():
        here = faults.at("equation") if single else faults.at("equations", name)
        if name in keys:
            at_name = faults.at("quantity", "name") if single else here
            at_name.add("name-taken", value=name, taken="an input")
        with here.collected():
            tree = parse(text, BUDGET_FUNCTIONS)
            if not keys:  # that the inputs are missing is reported; every name would be unknown
                continue
            check_known(tree, keys)
            yield name, outputs[name], tree
            errors, result = check_consistent(tree, powers, powers_of[outputs[name]], powers_of)
            here.extend(errors)
            at_unit = faults.at("quantity", "unit") if single else faults.at("units", name)
            at_unit.extend([] if result is None else [result])


def _warnings(budget: Budget, trees: dict[str, Node], document: YamlDocument) -> Iterator[Finding]:
    """Inputs without use or uncertainty; ``g: 9.81`` and ``u: 0`` mean constants."""
    symbols = {name for tree in trees.values() for name in names(tree)}
    constants = []
    for name, item in budget.inputs.items():
        path: YamlPath = ("inputs", name)
        if name not in symbols:
            yield finding("unused", what="input", name=name, **document.place(path))
        elif isinstance(document.at(*path), dict) and not item.varies and not item.ways:
            constants.append(name)
    if constants:
        place = {**document.place(("inputs", constants[0])), "path": None}
        expected = "u: 0 where that is meant"
        yield finding("no-uncertainty", names=constants, expected=expected, **place)
