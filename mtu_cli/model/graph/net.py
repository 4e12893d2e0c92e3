"""A measurement graph from its file (``mtu/graph/1``): whether its net is sound, and what it says.

Stryczek, "A Bipartite Graph for Estimating Measurement Uncertainty on Five-Axis Machining
Centres". A place holds a marker once it has a value; a transition fires, once, when all its
inputs hold one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from mtu_cli.files.contract import Faults, check_contract, is_unknown_key, present
from mtu_cli.files.graph_contract import COORDINATES, Graph, Place, Transition
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, read_yaml
from mtu_cli.findings import listed
from mtu_cli.language import Node, check_known, names, parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.parser import DOTTED
from mtu_cli.model.geometry import GeometryError
from mtu_cli.model.graph.places import Output, correlation_matrix, outputs_of, start_value
from mtu_cli.model.graph.transitions import (
    NAMED_BY_COORDINATE,
    TRANSITIONS,
    UNKNOWN,
    Computed,
    Step,
    Unit,
    Use,
    Values,
    described,
    place_of,
)

Rounds = tuple[tuple[Step, ...], ...]
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
STARTS = ("value", "known", "nominal_mm")
"""Keys that a place has which no transition makes."""
NOMINAL = {"coordinate": (1, "one number"), "point": (3, "[x, y, z]")}
CONTRADICT = "the correlations contradict each other: their matrix is not positive semi-definite"
ROUNDING = 1e-9
"""An eigenvalue of n correlations below -n times this is no rounding of 0, as in budgets."""


@dataclass(frozen=True, kw_only=True)
class MeasurementGraph:
    """A sound graph. `rounds`: its transitions as they fire; `nominal` holds every place (m = 1),
    `computed` the computing transitions in firing order, `units` the unit of every place: mm, rad,
    1 (or mm^n of a product); mm where nothing tells it.
    """

    document: YamlDocument
    graph: Graph
    rounds: Rounds
    nominal: Values
    computed: tuple[Computed, ...]
    units: dict[str, str]

    @property
    def reported(self) -> tuple[str, ...]:
        """The places to report: those of the file, or else the computed ones that no transition
        uses.
        """
        used = {name for item in self.graph.transitions for name in item.in_}
        made = {name for item in self.computed for name in item.step.outputs}
        return tuple(self.graph.report) or tuple(n for n in self.graph.places if n in made - used)

    def place_of(self, index: int) -> dict[str, Any]:
        """Where a transition stands, for a finding."""
        line = self.document.line_of("transitions", index)
        return {"file": self.document.source.shown, "line": line, "path": f"transitions[{index}]"}

    def outputs(self, names: Iterable[str] = ()) -> tuple[Output, ...]:
        """Outputs by name; without names those that the file reports."""
        return outputs_of(tuple(names) or self.reported, self.graph.places, self.units)

    def needed(self, outputs: Sequence[Output]) -> tuple[set[str], tuple[Computed, ...]]:
        """Start places and transitions that stand behind some outputs."""
        wanted = {item.place for item in outputs}
        steps = []
        for item in reversed(self.computed):
            if wanted.intersection(item.step.outputs):
                steps.append(item)
                wanted.update(item.step.inputs)
        made = {name for item in self.computed for name in item.step.outputs}
        return wanted - made, tuple(reversed(steps))


def load_graph(path: Path) -> MeasurementGraph:
    """Reads and checks a graph file.

    Raises InputError with all faults of the file, each with its line.
    """
    document = read_yaml(path, "graph")
    nets: list[_Net] = []

    def check(graph: Graph, faults: Faults) -> None:
        nets.append(_Net(_sound_part(graph, faults), faults))
        nets[0].check()

    graph = check_contract(document, Graph, "graph", check)
    return MeasurementGraph(
        document=document,
        graph=graph,
        rounds=nets[0].rounds,
        nominal=nets[0].nominal,
        computed=tuple(nets[0].computed),
        units={name: unit or "mm" for name, unit in nets[0].units.items()},
    )


def firing_order(steps: Iterable[Step], marked: Iterable[str]) -> Rounds:
    """Rounds of transitions: each fires once, as soon as all its inputs hold a marker.

    Places of `marked` hold one from the beginning (Stryczek: M0). Measurements, which have no
    input, fire in the first round; within a round the file's order counts. Transitions that never
    fire (in or behind a cycle, or behind a fault) are left out.
    """
    holding, waiting, rounds = set(marked), list(steps), []
    while fired := tuple(step for step in waiting if holding.issuperset(step.inputs)):
        rounds.append(fired)
        done = {step.index for step in fired}
        waiting = [step for step in waiting if step.index not in done]
        holding.update(chain.from_iterable(step.outputs for step in fired))
    return tuple(rounds)


def cycles(before: Mapping[str, Sequence[str]]) -> list[list[str]]:
    """Cycles of places, each from its first place back to it; no two share a place.

    `before`: the inputs of what makes each place.

    >>> cycles({"a": ["b"], "b": ["a"], "c": ["a"]})
    [['a', 'b', 'a']]
    """
    found: list[list[str]] = []
    while True:
        cut = {name for cycle in found for name in cycle}
        rest = {n: [i for i in own if i not in cut] for n, own in before.items() if n not in cut}
        try:
            TopologicalSorter(rest).prepare()
        except CycleError as error:
            found.append(error.args[1])
        else:
            return found


def _sound_part(graph: Graph, faults: Faults) -> Graph:
    """Without the entries that have a fault, but for places with an unknown key alone."""
    paths = [
        each.path or ""
        for each in faults.findings
        if not (is_unknown_key(each) and (each.path or "").startswith("places."))
    ]
    faulty = {path[:at] for path in paths for at in range(len(path)) if path[at] in ".["}
    faulty |= set(paths)
    places, items = graph.places or {}, graph.transitions or ()
    sound = {
        "places": {name: own for name, own in places.items() if f"places.{name}" not in faulty},
        "transitions": [
            None if f"transitions[{index}]" in faulty else own for index, own in enumerate(items)
        ],
        "report": graph.report or [],
        "correlations": graph.correlations or [],
    }
    return graph.model_copy(update=sound)


def _names(value: object) -> list[str] | None:
    """The names that stand at `in` or `out`, faulty or not; None where something else does."""
    items = value if isinstance(value, list) else [value]
    sound = all(type(item) in (str, int) for item in items)
    return [str(item) for item in items] if sound else None


class _Net:
    """The checks of one file.

    `arcs` are the inputs and outputs of every transition as they stand there, faulty ones
    included: a place whose maker is at fault is not without one. `unclear` names in them are no
    places: each may be meant for one that seems unused.
    """

    def __init__(self, graph: Graph, faults: Faults) -> None:
        self.graph, self.faults = graph, faults
        self.known = dict.fromkeys(faults.keys("places"))
        self.kinds = {name: described(own.kind, own.axis) for name, own in graph.places.items()}
        self.transitions = dict(present(graph.transitions))
        self.arcs: list[tuple[list[str], list[str]]] = []
        self.makers: dict[str, list[int]] = {}
        self.nominal: Values = {}
        self.computed: list[Computed] = []
        self.units: dict[str, Unit] = {}
        self.rounds: Rounds = ()
        data = faults.document.at("transitions")
        entries = data if isinstance(data, list) else []
        # Without any every place seems unused: the key itself may be misspelt.
        self.unclear = float(sum(name not in self.known for name in graph.report))
        self.unclear += 0 if entries else math.inf
        for index, item in enumerate(entries):
            entry = item if isinstance(item, dict) else {}
            inputs = _names(entry.get("in", [] if entry.get("do") == "meas" else None))
            outputs = _names(entry.get("out"))
            self.arcs.append((inputs or [], outputs or []))
            for name in dict.fromkeys(outputs or ()):
                self.makers.setdefault(name, []).append(index)
            named = (*(inputs or ()), *(outputs or ()))
            readable = inputs is not None and outputs is not None
            self.unclear += sum(n not in self.known for n in named) if readable else math.inf

    def check(self) -> None:
        """All of them; those that take a calculation see the sound part in firing order."""
        steps = [self.step(index, item) for index, item in self.transitions.items()]
        marked = [name for name, place in self.graph.places.items() if place.marked]
        self.rounds = firing_order([step for step in steps if step is not None], marked)
        self.check_places()
        self.check_names()
        self.check_values(marked)
        self.check_units()
        self.check_correlations()

    def step(self, index: int, item: Transition) -> Step | None:
        """A transition against its signature; None with its faults, and where it makes a place a
        second time: what follows from that is not its fault.
        """
        path, before = ("transitions", index), len(self.faults.findings)
        for key, owner in ONLY.items():
            if getattr(item, key) is not None and item.do != owner:
                self.faults.add((*path, key), "misplaced", key=key, where=owner)
        for side, listed_names in (("in", item.in_), ("out", item.out)):
            self.check_known((*path, side), enumerate(listed_names))
        self.faults.once((*path, "out"), enumerate(item.out), "the output")
        formula = self.formula(item, path) if item.do == "compute" else None
        use = self.use_of(item, path)
        known = all(name in self.graph.places for name in (*item.in_, *item.out))
        again = any(self.makers[name][0] != index for name in item.out)
        if use is None or again or not known or len(self.faults.findings) > before:
            return None
        both = {"inputs": tuple(item.in_), "outputs": tuple(item.out)}
        return Step(index=index, do=item.do, use=use, formula=formula, **both)

    def check_known(self, path: YamlPath, items: Iterable[tuple[int, str]]) -> None:
        for at, name in items:
            if name not in self.known:
                self.faults.unknown((*path, at), name, self.known, "place")

    def formula(self, item: Transition, path: YamlPath) -> Node | None:
        """The tree of a formula whose names are inputs: a constant or coordinate by its name, a
        point or vector by those of its coordinates, ``H1.x``.
        """
        if item.formula is None:
            expected = "a formula in the input places"
            self.faults.add(path, "missing-key", key="formula", expected=expected)
            return None
        known = set()
        for name in {*item.in_} & {*self.graph.places}:
            kind = self.graph.places[name].kind
            coordinates = COORDINATES[kind] if kind in NAMED_BY_COORDINATE else ()
            known |= {f"{name}.{each}" for each in coordinates} or {name}
        with self.faults.collected((*path, "formula")):
            node = parse(item.formula, BUDGET_FUNCTIONS, DOTTED)
            used = names(node)
            # Of a place that is at fault itself no name is wrong.
            faulty = {*item.in_} - {*self.graph.places}
            check_known(node, known | {n for n in used if place_of(n) in faulty}, "input")
            for at, name in enumerate(item.in_):
                if name not in map(place_of, used):
                    reason = "the formula does not use this input"
                    self.faults.add((*path, "in", at), "unused-place", reason=reason, value=name)
            return node
        return None

    def use_of(self, item: Transition, path: YamlPath) -> Use | None:
        """The use that takes these inputs and gives these outputs, or None with its fault."""
        sides = [[self.kinds.get(name, UNKNOWN) for name in own] for own in (item.in_, item.out)]
        uses = TRANSITIONS[item.do]
        taking = [use for use in uses if use.fits(0, sides[0])]
        making = [use for use in taking if use.fits(1, sides[1])]
        axes = {own[0] for own in sides if own and own[0].startswith("a coordinate ")}
        turned = item.do == "displace" and len(axes) > 1
        if turned or not making:
            at = int(bool(taking))
            wanted = dict.fromkeys(use.words(at) for use in taking or uses)
            expected = sides[0][0] if turned and taking else "; or ".join(wanted)
            facts = {"verb": ("take", "make")[at], "places": ", ".join(sides[at]) or "nothing"}
            side, facts["do"] = ("in", "out")[at], item.do
            self.faults.add((*path, side), "wrong-connection", expected=expected, **facts)
            return None
        if item.do == "meas" and len(making) == 1:
            is_point = sides[1] == ["a point"]
            if item.along is not None and not is_point:
                self.faults.add((*path, "along"), "misplaced", key="along", where="a point")
            elif item.along is None and is_point:
                expected = "x, -x, ... or [i, j, k]"
                self.faults.add(path, "missing-key", key="along", expected=expected)
        return making[0]

    def check_places(self) -> None:
        """That every place has the keys of its kind, its value from one transition or from the
        start, and leads to those reported, or to those that end the graph.

        Places that nothing makes or uses are reported if they are more than the names of
        transitions that are no places: one of these may be meant.
        """
        unmade = []
        for name, place in self.graph.places.items():
            self.check_keys(name, place)
            if name in self.makers:
                self.check_maker(name, place)
            elif place.kind == "point" and place.known and place.nominal_mm is None:
                self.faults.lacks(("places", name), "nominal_mm", "where the point is")
            elif not place.marked and not self.faults.misspelt(("places", name), STARTS):
                own = "`value:`, or " if place.kind == "constant" else ""
                reason = f"no transition makes this {place.kind}"
                unmade.append((name, reason, f"{own}a transition with `out: {name}`"))
        used = {name for inputs, _ in self.arcs for name in inputs}
        measured = {index for index, item in self.transitions.items() if item.do == "meas"}
        computed = {name for name, by in self.makers.items() if not measured.issuperset(by)}
        ends = used | (set(self.graph.report) or computed)
        expected = "an input of a transition, or listed under `report:`"
        idle = [n for n in self.graph.places if n not in ends]
        for found in (unmade, [(name, "the place leads nowhere", expected) for name in idle]):
            for name, reason, wanted in found if len(found) > self.unclear else ():
                path = ("places", name)
                self.faults.add(path, "unused-place", reason=reason, expected=wanted)

    def check_keys(self, name: str, place: Place) -> None:
        path = ("places", name)
        if "." in name:
            given = {"kind": "a name that formulas can use", "expected": name.replace(".", "_")}
            self.faults.add(path, "wrong-type", value=name, **given)
        for key, kinds in KEYS.items():
            if key in place.stated and place.kind not in kinds:
                where = "a " + " or a ".join(kinds)
                self.faults.add((*path, key), "misplaced", key=key, where=where)
        if place.kind == "coordinate" and place.axis is None:
            self.faults.lacks(path, "axis", "x, y or z")
        count, expected = NOMINAL.get(place.kind, (0, ""))
        nominal = place.nominal_mm
        if nominal is not None and count and len(nominal) != count:
            own = (*path, "nominal_mm")
            self.faults.add(own, "wrong-value", value=list(nominal), expected=expected)
        if place.u is not None and place.value is None and not self.faults.misspelt(path, STARTS):
            self.faults.add((*path, "u"), "incomplete", what="`u`", other="`value`")

    def check_maker(self, name: str, place: Place) -> None:
        """That what a transition makes states nothing against it."""
        path, index = ("places", name), self.makers[name][0]
        maker = self.transitions.get(index)
        computed = maker is not None and maker.do != "meas"
        for key in ("known", "value", *(["nominal_mm"] if computed else [])):
            if key in place.stated and place.kind in KEYS[key]:
                other = self.made_by(index)
                self.faults.add((*path, key), "contradicts", other=other, expected="one of the two")
        if maker is not None and not computed and place.kind in NOMINAL and not place.nominal_mm:
            self.faults.lacks(path, "nominal_mm", "where it is measured")

    def made_by(self, index: int) -> str:
        line = self.faults.document.line_of("transitions", index)
        return f"the transition of line {line}, which makes the place"

    def check_names(self) -> None:
        """What is reported; that no place is made twice or depends on itself."""
        for name, (first, *others) in self.makers.items():
            for index in others:
                path, other = ("transitions", index, "out"), self.made_by(first)
                self.faults.add(path, "contradicts", other=other, value=name)
        report = present(self.graph.report)
        self.check_known(("report",), report)
        self.faults.once(("report",), report, "the place")
        before: dict[str, list[str]] = {}
        for inputs, outputs in self.arcs:
            for name in outputs:
                before.setdefault(name, []).extend(inputs)
        for cycle in cycles(before):
            index = self.makers[cycle[1]][0]
            self.faults.add(("transitions", index), "graph-cycle", places=" -> ".join(cycle))

    def check_values(self, marked: Iterable[str]) -> None:
        """The values at nominal: constructions that are degenerate there, formulas without one;
        what depends on them is left out.
        """
        self.nominal.update({name: start_value(self.graph.places[name]) for name in marked})
        for step in chain.from_iterable(self.rounds):
            name, path = step.outputs[0], ("transitions", step.index)
            if step.do == "meas":
                place = self.graph.places[name]
                if len(place.nominal_mm or ()) == NOMINAL[place.kind][0]:
                    self.nominal[name] = start_value(place)
            elif all(name in self.nominal for name in step.inputs):
                try:
                    self.computed.append(Computed.ready(step, self.nominal))
                except GeometryError as error:
                    what, where = f"{step.do} of {listed(step.outputs)}", f" at nominal: {error}"
                    self.faults.add(path, "no-finite-value", what=what, where=where)

    def check_units(self) -> None:
        """Dimensions of formulas, and lengths where lengths are meant: an input of which nothing
        tells the unit counts as one.
        """
        places = self.graph.places
        self.units.update({n: p.unit if p.kind == "constant" else "mm" for n, p in places.items()})
        for step in chain.from_iterable(self.rounds):
            path = ("transitions", step.index)
            for name in step.outputs:
                if self.units[name] is None or places[name].kind == "vector":
                    with self.faults.collected((*path, "formula")):
                        self.units[name] = step.unit(self.units)
            at = step.use.length
            if at is not None and at < len(step.inputs):
                name = step.inputs[at]
                if (unit := self.units[name]) not in (None, "mm"):
                    kind = f"a length, as {step.do} takes here"
                    given = {"value": name, "expected": f"a place in mm, not in {unit}"}
                    self.faults.add((*path, "in", at), "wrong-type", kind=kind, **given)

    def check_correlations(self) -> None:
        """That constants are correlated, and, where each pair may be, that their matrix is one."""

        def judge(path: YamlPath, name: str) -> None:
            place = self.graph.places.get(name)
            if name not in self.known:
                self.faults.unknown(path, name, self.known, "place")
            elif place is not None and not (place.u and place.distribution == "normal"):
                expected = "a normal constant with `value` and `u`"
                given = {"reason": "it cannot be correlated", "expected": expected}
                self.faults.add(path, "wrong-correlation", value=name, **given)

        pairs = present(self.graph.correlations)
        self.faults.correlated(pairs, judge)
        correlated = list(dict.fromkeys(name for _, pair in pairs for name in pair[:2]))
        alone = [abs(r) > 1 or first == second for _, (first, second, r) in pairs]
        if pairs and not any(alone) and len(pairs) == len(self.graph.correlations):
            least = float(np.linalg.eigvalsh(correlation_matrix(self.graph, correlated))[0])
            if least < -ROUNDING * len(correlated):
                expected = f"no eigenvalue below 0; the smallest is {least:.4g}"
                given = {"reason": CONTRADICT, "expected": expected}
                self.faults.add(("correlations",), "wrong-correlation", **given)
