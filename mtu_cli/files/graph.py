"""Measurement graph files (``mtu/graph/1``): what stands in them, and whether their net is sound.

Stryczek, "A Bipartite Graph for Estimating Measurement Uncertainty on Five-Axis Machining
Centres". A place holds a marker once it has a value; a transition fires, once, when all its
inputs hold one. `graph_kinds` says which transitions there are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

from mtu_cli.files.contract import (
    Contract,
    Faults,
    check_contract,
    present,
)
from mtu_cli.files.graph_contract import Graph, Place, Transition
from mtu_cli.files.graph_kinds import (
    COORDINATES,
    NAMED_BY_COORDINATE,
    TRANSITIONS,
    Given,
    Variant,
    described,
)
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, read_yaml
from mtu_cli.findings import Finding, InputError, counted, finding, suggestion
from mtu_cli.language import Node, names, parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.parser import DOTTED


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A transition whose places are known and of the right kinds.

    `index` in the file; `variant` tells the uses of one transition apart, `formula` is that of
    compute.
    """

    index: int
    do: str
    variant: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    formula: Node | None = None


Rounds = Sequence[Sequence[Step]]
Examine = Callable[[Graph, Rounds, Faults], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedGraph:
    """A checked graph file; `rounds` are its transitions in firing order."""

    source: Source
    graph: Graph
    rounds: tuple[tuple[Step, ...], ...]
    document: YamlDocument

    @property
    def steps(self) -> tuple[Step, ...]:
        """All transitions in firing order."""
        return tuple(step for fired in self.rounds for step in fired)

    @property
    def reported(self) -> tuple[str, ...]:
        """The places to report: those of the file, or else the computed ones that no transition
        uses.
        """
        used = {name for item in self.graph.transitions for name in item.in_}
        made = {name for item in self.graph.transitions if item.do != "meas" for name in item.out}
        return tuple(self.graph.report) or tuple(n for n in self.graph.places if n in made - used)

    def line_of(self, *path: str | int) -> int | None:
        """The line of a value of the file."""
        return self.document.line_of(*path)


def load_graph(path: Path, examine: Examine | None = None) -> LoadedGraph:
    """Reads and checks a graph file.

    `examine` sees the sound part in firing order and adds what takes a calculation to see (a
    construction that is degenerate at nominal).

    Raises InputError with all faults of the file, each with its line.
    """
    document = read_yaml(path, "graph")
    rounds: list[list[Step]] = []

    def check(graph: Graph, faults: Faults) -> None:
        # What is faulty as a whole is None.
        lists = {key: getattr(graph, key) or [] for key in ("transitions", "report")}
        lists["correlations"] = graph.correlations or []
        graph = graph.model_copy(update={**lists, "places": graph.places or {}})
        check = _Check(graph, faults)
        check.net()
        marked = (name for name, place in graph.places.items() if place.marked)
        rounds.extend(firing_order(check.steps(), marked))
        if examine is not None:
            examine(graph, rounds, faults)

    graph = check_contract(document, Graph, "graph", check)
    return LoadedGraph(
        source=document.source, graph=graph, rounds=tuple(map(tuple, rounds)), document=document
    )


NEVER = -1


def firing_order(steps: Iterable[Step], marked: Iterable[str]) -> list[list[Step]]:
    """Rounds of transitions: each fires once, as soon as all its inputs hold a marker.

    Places of `marked` hold one from the beginning (Stryczek: M0). Measurements, which have no
    input, fire in the first round; within a round the file's order counts. Transitions that never
    fire (in or behind a cycle, or behind a fault) are left out.
    """
    known = {step.index: step for step in steps}
    maker = {name: step.index for step in known.values() for name in step.outputs}
    start = set(marked)
    sorter: TopologicalSorter[int] = TopologicalSorter()
    for step in known.values():
        waits_for = (maker.get(name, NEVER) for name in step.inputs if name not in start)
        sorter.add(step.index, *waits_for)
    with suppress(CycleError):
        sorter.prepare()
    rounds = []
    while ready := sorted({*sorter.get_ready()} - {NEVER}):
        rounds.append([known[index] for index in ready])
        sorter.done(*ready)
    return rounds


def cycles(before: Mapping[str, Sequence[str]]) -> list[list[str]]:
    """Cycles of places, each from its first place back to it; no two share a place.

    `before`: the inputs of what makes each place.

    >>> cycles({"a": ["b"], "b": ["a"], "c": ["a"]})
    [['a', 'b', 'a']]
    """
    found: list[list[str]] = []
    while True:
        try:
            TopologicalSorter(before).prepare()
        except CycleError as error:
            cycle = error.args[1]
            found.append(cycle)
            before = {
                name: [item for item in inputs if item not in cycle]
                for name, inputs in before.items()
                if name not in cycle
            }
        else:
            return found


def place_of(name: str) -> str:
    """The place of a name in a formula: H1 of ``H1.x``."""
    return name.partition(".")[0]


def _names_in(value: object) -> list[str | None]:
    """What stands at `in` or `out`: names, and None for what can be none."""
    listed = value if isinstance(value, list) else [value]
    return [str(item) if type(item) in (str, int) else None for item in listed]


ONLY = {"repeats": "meas", "uncertainty": "meas", "along": "meas", "formula": "compute"}
"""Keys that one transition alone has."""
KEYS = {
    "axis": ("coordinate",),
    "nominal_mm": ("coordinate", "point"),
    "value": ("constant",),
    "u": ("constant",),
    "unit": ("constant",),
    "known": ("point",),
}
"""Keys of places, and the kinds that have them."""


@dataclass
class _Check:
    """The checks of one file. `arcs` are the inputs and outputs of every transition as the file
    has them, faulty ones included: a place whose maker is at fault is not without one.
    """

    graph: Graph
    faults: Faults
    known: dict[str, None] = field(init=False)
    arcs: dict[int, tuple[list[str | None], list[str | None]]] = field(init=False)
    makers: dict[str, list[int]] = field(init=False)
    transitions: dict[int, Transition] = field(init=False)

    def __post_init__(self) -> None:
        self.known = dict.fromkeys(self.faults.keys("places"))
        self.transitions = dict(present(self.graph.transitions))
        data = self.faults.document.data.get("transitions")
        self.arcs, self.makers = {}, {}
        for index, item in enumerate(data if isinstance(data, list) else []):
            entry = item if isinstance(item, dict) else {}
            inputs = entry.get("in", [] if entry.get("do") == "meas" else None)
            one_list = inputs if isinstance(inputs, list) else [None]
            self.arcs[index] = (_names_in(one_list), _names_in(entry.get("out")))
            for name in dict.fromkeys(self.arcs[index][1]):
                if name is not None:
                    self.makers.setdefault(name, []).append(index)

    def steps(self) -> list[Step]:
        """The sound transitions, less those that make a place a second time: what follows from
        that is not their fault.
        """
        made: set[str] = set()
        kept = []
        for index, item in self.transitions.items():
            step = self.step(index, item)
            if step is not None and made.isdisjoint(step.outputs):
                kept.append(step)
                made.update(step.outputs)
        return kept

    def step(self, index: int, item: Transition) -> Step | None:
        """A transition against its signature; None with its faults."""
        path, before = ("transitions", index), len(self.faults.findings)
        for key, owner in ONLY.items():
            if getattr(item, key) is not None and item.do != owner:
                self.faults.add((*path, key), "key-elsewhere", key=key, where=owner)
        for side, listed in (("in", item.in_), ("out", item.out)):
            for at, name in enumerate(listed):
                self.check_known((*path, side, at), name)
        self.faults.once((*path, "out"), enumerate(item.out), "the output")
        formula = self.formula(item, path) if item.do == "compute" else None
        variant = self.variant(item, path)
        sound = all(name in self.graph.places for name in (*item.in_, *item.out))
        if variant is None or not sound or len(self.faults.findings) > before:
            return None
        if item.do == "compute" and formula is None:  # its key is misspelt, and reported as such
            return None
        return Step(
            index=index,
            do=item.do,
            variant=variant.name,
            inputs=tuple(item.in_),
            outputs=tuple(item.out),
            formula=formula,
        )

    def check_known(self, path: YamlPath, name: str) -> None:
        if name not in self.known:
            self.faults.unknown(path, name, self.known, "place")

    def given(self, name: str) -> Given:
        place = self.graph.places.get(name)
        return (None, None) if place is None else (place.kind, place.axis)

    def misspelt(self, path: YamlPath, item: Contract) -> bool:
        """Whether an entry has an unknown key, which may be the one that it lacks."""
        return len(self.faults.keys(*path)) > len(item.model_fields_set)

    def lacks(self, path: YamlPath, item: Contract, key: str, expected: str) -> None:
        if not self.misspelt(path, item):
            self.faults.add(path, "missing-key", key=key, expected=expected)

    def formula(self, item: Transition, path: YamlPath) -> Node | None:
        """The tree of a formula whose names are inputs: a constant or coordinate by its name, a
        point or vector by those of its coordinates, ``H1.x``.
        """
        if item.formula is None:
            self.lacks(path, item, "formula", "a formula in the input places")
            return None
        try:
            node = parse(item.formula, BUDGET_FUNCTIONS, DOTTED)
            if wrong_names := self.wrong_names(node, item.in_):
                raise InputError(wrong_names)
        except InputError as error:
            self.faults.extend((*path, "formula"), error)
            return None
        used = {place_of(name) for name in names(node)}
        for at, name in enumerate(item.in_):
            if name not in used:
                self.faults.add((*path, "in", at), "unused-place", value=name)
        return node

    def wrong_names(self, node: Node, inputs: Collection[str]) -> list[Finding]:
        """The names of a formula that are no input, or no coordinate of one."""
        found = []
        for name, column in names(node).items():
            place = place_of(name)
            kind, _ = self.given(place)
            named = [place]
            if kind in NAMED_BY_COORDINATE:
                named = [f"{place}.{item}" for item in COORDINATES[kind]]
            if place not in inputs:
                near = suggestion(place, inputs)
                found.append(
                    finding("unknown-name", what="input", value=place, column=column, **near)
                )
            elif kind is not None and name not in named:
                expected = " or ".join(named)
                found.append(
                    finding("unknown-name", what=f"coordinate of a {kind}", value=name,
                            column=column, expected=expected)
                )  # fmt: skip
        return found

    def variant(self, item: Transition, path: YamlPath) -> Variant | None:
        """The variant that takes these inputs and gives these outputs, or None with its fault."""
        given, out = list(map(self.given, item.in_)), list(map(self.given, item.out))
        variants = TRANSITIONS[item.do]
        fitting = [variant for variant in variants if variant.fits(given)]
        if not fitting:
            self.check_inputs(item, given, path)
            return None
        found = next((variant for variant in fitting if variant.gives(out)), None)
        if found is None:
            most = max(fitting, key=lambda variant: len(variant.outputs))
            wrong_at = most.wrong_output(out)
            at = len(most.outputs) if wrong_at is None else wrong_at
            kinds = dict.fromkeys(", ".join(variant.outputs) for variant in fitting)
            self.add_output(item, at, " or ".join(kinds), path)
            return None
        if item.do == "meas" and out[0][0] == "coordinate" and item.along is not None:
            self.faults.add((*path, "along"), "key-elsewhere", key="along", where="a point")
        if item.do == "meas" and out[0][0] == "point" and item.along is None:
            self.lacks(path, item, "along", "x, -x, ... or [i, j, k]")
        if item.do == "displace" and found.name == "coordinate":
            before, after = given[0][1], out[0][1]
            if before and after and before != after:
                self.add_output(item, 0, f"a coordinate {before}", path)
        return found

    def add_output(self, item: Transition, at: int, expected: str, path: YamlPath) -> None:
        place = described(self.given(item.out[at]))
        self.faults.add(
            (*path, "out", at), "wrong-output", do=item.do, place=place, number=at + 1,
            value=item.out[at], expected=expected,
        )  # fmt: skip

    def check_inputs(self, item: Transition, given: list[Given], path: YamlPath) -> None:
        """The first input that no variant takes there; or that there are too few or too many."""
        if not item.in_ and self.misspelt(path, item):
            return
        variants = TRANSITIONS[item.do]
        expected = "; or ".join(dict.fromkeys(map(str, variants)))
        at = max(variant.reach(given)[0] for variant in variants)
        nearest = [variant for variant in variants if variant.reach(given)[0] == at]
        # A run of inputs ends at the first that does not fit: that one is at fault, not the count.
        run = any(slot.most is None for variant in nearest for slot in variant.inputs[-1:])
        if at < len(given) and (run or not any(variant.reach(given)[1] for variant in nearest)):
            self.faults.add(
                (*path, "in", at), "wrong-input", do=item.do, place=described(given[at]),
                number=at + 1, value=item.in_[at], expected=expected,
            )  # fmt: skip
            return
        self.faults.add(
            (*path, "in"),
            "input-count",
            do=item.do,
            inputs=counted(len(given), "input"),
            expected=expected,
        )

    def net(self) -> None:
        """Everything that concerns more than one transition.

        Places that nothing makes or uses are reported if they are more than what transitions name
        that is no place: that may be meant for them.
        """
        used, made = (
            sum(
                math.inf if name is None else name not in self.known
                for arc in self.arcs.values()
                for name in arc[side]
            )
            for side in (0, 1)
        )
        unmade = [n for n, p in self.graph.places.items() if not (n in self.makers or p.marked)]
        for name, indices in self.makers.items():
            for index in indices[1:]:
                self.add_made(("transitions", index, "out"), indices[0], value=name)
        for name, place in self.graph.places.items():
            self.check_keys(name, place)
            self.check_origin(name, place, len(unmade) <= made)
        for index, name in present(self.graph.report):
            self.check_known(("report", index), name)
        self.faults.once(("report",), present(self.graph.report), "the place")
        self.check_used(used + sum(name not in self.known for name in self.graph.report))
        before: dict[str, list[str]] = {}
        for inputs, outputs in self.arcs.values():
            for name in (name for name in outputs if name is not None):
                before.setdefault(name, []).extend(item for item in inputs if item is not None)
        for cycle in cycles(before):
            index = self.makers[cycle[1]][0]
            self.faults.add(("transitions", index), "graph-cycle", places=" -> ".join(cycle))
        self.check_correlations()

    def add_made(self, path: YamlPath, index: int, **given: Any) -> None:
        line = self.faults.document.line_of("transitions", index)
        other = f"the transition of line {line}, which makes the place"
        self.faults.add(path, "contradicts", other=other, **given)

    def check_keys(self, name: str, place: Place) -> None:
        path, given = ("places", name), self.faults.given("places", name)
        if "." in name:
            expected = name.replace(".", "_")
            self.faults.add(path, "not-a-name", value=name, expected=expected)
        for key, kinds in KEYS.items():
            if key in given and place.kind not in kinds:
                where = "a " + " or a ".join(kinds)
                self.faults.add((*path, key), "key-elsewhere", key=key, where=where)
        if place.kind == "coordinate" and "axis" not in given:
            self.lacks(path, place, "axis", "x, y or z")
        wanted = {"coordinate": (1, "one number"), "point": (3, "[x, y, z]")}.get(place.kind)
        nominal = place.nominal_mm
        if nominal is not None and wanted is not None and len(nominal) != wanted[0]:
            self.faults.add(
                (*path, "nominal_mm"), "wrong-value", value=list(nominal), expected=wanted[1]
            )
        if place.u is not None and place.value is None:
            self.faults.add((*path, "u"), "key-needs", key="u", other="`value`")

    def check_origin(self, name: str, place: Place, unclear: bool) -> None:
        """That a place has its value from one transition, or from the start."""
        path, given = ("places", name), self.faults.given("places", name)
        if indices := self.makers.get(name):
            maker = self.transitions.get(indices[0])
            computed = maker is not None and maker.do != "meas"
            for key in ("known", "value", *(["nominal_mm"] if computed else [])):
                if key in given and place.kind in KEYS[key]:
                    self.add_made((*path, key), indices[0], expected="one of the two")
            measured = not computed and maker is not None and place.kind in KEYS["nominal_mm"]
            if measured and "nominal_mm" not in given:
                self.lacks(path, place, "nominal_mm", "where it is measured")
        elif place.known and place.kind == "point":
            if "nominal_mm" not in given:
                self.lacks(path, place, "nominal_mm", "where the point is")
        elif not (unclear or self.misspelt(path, place)) and not (
            place.kind == "constant" and "value" in given
        ):
            expected = f"a transition with `out: {name}`"
            if place.kind == "constant":
                expected = f"`value:`, or {expected}"
            self.faults.add(path, "not-made", kind=place.kind, expected=expected)

    def check_used(self, unclear: float) -> None:
        """That every place leads to those reported, or to those that end the graph."""
        used = {name for inputs, _ in self.arcs.values() for name in inputs}
        measured = {index for index, item in self.transitions.items() if item.do == "meas"}
        computed = {name for name, by in self.makers.items() if not measured.issuperset(by)}
        ends = set(self.graph.report) or computed
        idle = [name for name in self.graph.places if name not in used and name not in ends]
        for name in idle if len(idle) > unclear else []:
            expected = "an input of a transition, or listed under `report:`"
            self.faults.add(("places", name), "leads-nowhere", expected=expected)

    def check_correlations(self) -> None:
        def judge(path: YamlPath, name: str) -> None:
            self.check_known(path, name)
            place = self.graph.places.get(name)
            if place is not None and not (place.u and place.distribution == "normal"):
                expected = "a normal constant with `value` and `u`"
                self.faults.add(path, "not-correlatable", value=name, expected=expected)

        self.faults.correlated(present(self.graph.correlations), judge)
