"""A measurement graph from its file (``mtu/graph/1``), and the checks of its net.

Stryczek, "A Bipartite Graph for Estimating Measurement Uncertainty on Five-Axis Machining
Centres". A place holds a marker once it has a value; a transition fires, once, when all its
inputs hold one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from itertools import chain
from pathlib import Path

import numpy as np

from mtu_cli.files.contract import Faults, check_contract, present
from mtu_cli.files.graph_contract import COORDINATES, Graph, Place, Transition
from mtu_cli.files.yaml_file import YamlDocument, read_yaml
from mtu_cli.findings import error, listed, suggestion
from mtu_cli.language import Node, check_known, names, parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.parser import DOTTED
from mtu_cli.model.geometry import GeometryError
from mtu_cli.model.graph.transitions import (
    TRANSITIONS,
    Step,
    Unit,
    Values,
    described,
    matches,
    place_of,
)
from mtu_cli.stats.least_squares import FloatArray

Rounds = tuple[tuple[Step, ...], ...]
ONLY = {"repeats": "meas", "uncertainty": "meas", "along": "meas", "formula": "compute"}
"""Keys that one transition alone has."""
KEYS = {
    "axis": ("coordinate",), "nominal_mm": ("coordinate", "point"), "value": ("constant",),
    "u": ("constant",), "unit": ("constant",), "known": ("point",),
}  # fmt: skip
"""Keys of places, and the kinds that have them."""
NOMINAL = {"coordinate": (1, "one number"), "point": (3, "[x, y, z]")}


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """One coordinate of a place; `index` is its number among those of the place."""

    place: str
    coordinate: str
    index: int
    kind: str
    unit: str

    def __str__(self) -> str:
        single = self.coordinate == "value"
        return self.place if single else f"{self.place}.{self.coordinate}"


@dataclass(frozen=True, kw_only=True)
class MeasurementGraph:
    """A sound graph. `rounds`: its transitions as they fire; `nominal` holds every place (m = 1),
    `units` the unit of every place: mm, rad, 1 (or mm^n of a product); mm where undetermined.
    """

    document: YamlDocument
    graph: Graph
    rounds: Rounds
    nominal: Values
    units: dict[str, str]

    @property
    def computed(self) -> list[Step]:
        """The computing transitions in firing order."""
        return [step for step in chain.from_iterable(self.rounds) if step.do != "meas"]

    @property
    def reported(self) -> tuple[str, ...]:
        """The places to report: those of the file, or else the computed ones that no transition
        uses.
        """
        used = {name for item in self.graph.transitions for name in item.in_}
        made = {name for step in self.computed for name in step.outputs}
        return tuple(self.graph.report) or tuple(n for n in self.graph.places if n in made - used)

    def outputs(self, names: Iterable[str] = ()) -> tuple[Output, ...]:
        """The outputs behind names such as ``P1``, ``P1.x`` or ``d_AC``, each once; without names
        those that the file reports.

        Raises InputError for a place or coordinate that there is not.
        """
        places, outputs = self.graph.places, {}
        for text in tuple(names) or self.reported:
            name, suffix = (text, "") if text in places else text.rpartition(".")[::2]
            if name not in places:
                near = suggestion(name or text, places)
                raise error("unknown-name", what="place", value=text, **near)
            kind, unit = places[name].kind, self.units[name]
            coordinates = COORDINATES[kind]
            if suffix and suffix not in coordinates:
                hint = f"one of: {', '.join(f'{name}.{item}' for item in coordinates)}"
                raise error("unknown-name", what="coordinate", value=text, expected=hint)
            direction_unit = {"frame": "rad", "line": "1", "plane": "1"}.get(kind, unit)
            for i, coordinate in enumerate(coordinates):
                if suffix in ("", coordinate):
                    symbol = direction_unit if i >= 3 else unit
                    fields = {"place": name, "coordinate": coordinate, "kind": kind, "unit": symbol}
                    outputs[name, i] = Output(**fields, index=i)
        return tuple(outputs.values())

    def needed(self, outputs: Sequence[Output]) -> tuple[set[str], list[Step]]:
        """Start places and transitions that some outputs depend on."""
        places, steps = {item.place for item in outputs}, []
        for step in reversed(self.computed):
            if places.intersection(step.outputs):
                steps.append(step)
                places.update(step.inputs)
        made = {name for step in self.computed for name in step.outputs}
        return places - made, steps[::-1]


def start_value(place: Place) -> FloatArray:
    """Nominal of a measured place, or value of a constant, for one trial: (1,) or (3, 1)."""
    if place.nominal_mm is not None:
        nominal = np.array(place.nominal_mm)
        return nominal[:, None] if len(nominal) == 3 else nominal
    return np.array([math.nan if place.value is None else place.value])


def load_graph(path: Path) -> MeasurementGraph:
    """Reads and checks a graph file.

    Raises InputError with all faults of the file, each with its line.
    """
    document, nets = read_yaml(path, "graph"), list[_Net]()
    graph = check_contract(document, Graph, "graph", lambda *of: nets.append(_Net(*of)))
    return MeasurementGraph(
        document=document,
        graph=graph,
        rounds=nets[0].rounds,
        nominal=nets[0].nominal,
        units={name: unit or "mm" for name, unit in nets[0].units.items()},
    )


def firing_order(steps: Iterable[Step], marked: Iterable[str]) -> Rounds:
    """Rounds of transitions: each fires once, as soon as all its inputs hold a marker (Stryczek: M0
    marks those of `marked`); within a round the file's order counts. Transitions that never fire
    (in or behind a cycle, or behind a fault) are left out.
    """
    holding, waiting, rounds = set(marked), list(steps), []
    while fired := tuple(step for step in waiting if holding.issuperset(step.inputs)):
        rounds.append(fired)
        done = {step.index for step in fired}
        waiting = [step for step in waiting if step.index not in done]
        holding.update(chain.from_iterable(step.outputs for step in fired))
    return tuple(rounds)


class _Net:
    """The checks of one file, of the sound part of its contract; `place_names` are those of all
    places, faulty ones included; the places of transitions that cannot be read are unknown. Checks
    that take a calculation see the sound part in firing order.
    """

    def __init__(self, graph: Graph, faults: Faults) -> None:
        self.faults, self.places = faults, graph.places or {}
        self.place_names = dict.fromkeys(faults.at("places").keys())
        self.transitions = dict(present(graph.transitions))
        self.report = present(graph.report)
        self.makers: dict[str, list[int]] = {}
        for index, item in self.transitions.items():
            for name in dict.fromkeys(item.out):
                self.makers.setdefault(name, []).append(index)
        self.unread = any(not (x.path or "").startswith("places.") for x in faults.findings)
        self.nominal: Values = {}
        self.units: dict[str, Unit] = {
            n: p.unit if p.kind == "constant" else "mm" for n, p in self.places.items()
        }
        steps = [self.step(index, item) for index, item in self.transitions.items()]
        marked = [name for name, place in self.places.items() if place.marked]
        self.rounds = firing_order([step for step in steps if step is not None], marked)
        for name, place in self.places.items():
            self.check_place(name, place)
        self.check_names()
        self.nominal.update({name: start_value(self.places[name]) for name in marked})
        for step in chain.from_iterable(self.rounds):
            self.check_value(step)
            for name in step.outputs:
                if self.units[name] is None or self.places[name].kind == "vector":
                    with self.faults.at("transitions", step.index, "formula").collected():
                        self.units[name] = step.unit(self.units)

    def step(self, index: int, item: Transition) -> Step | None:
        """A transition against its signature; None with its faults, and where it makes a place a
        second time: faults that follow from that are not its own.
        """
        faults, before = self.faults.at("transitions", index), len(self.faults.findings)
        for key, owner in ONLY.items():
            if getattr(item, key) is not None and item.do != owner:
                faults.at(key).add("misplaced", key=key, where=owner)
        self.check_known(faults.at("in"), enumerate(item.in_))
        self.check_known(faults.at("out"), enumerate(item.out))
        faults.at("out").once(enumerate(item.out), "the output")
        if not all(name in self.places for name in (*item.in_, *item.out)):
            return None
        formula = self.formula(item, faults) if item.do == "compute" else None
        takes, makes = (
            [described(self.places[name].kind, self.places[name].axis) for name in group]
            for group in (item.in_, item.out)
        )
        uses = TRANSITIONS[item.do]
        taking = [use for use in uses if matches(use.takes, takes)]
        making = [use for use in taking if matches(use.makes, makes)]
        if not making:
            options = [use.makes for use in taking] or [use.takes or "nothing" for use in uses]
            side, verb, kinds = ("out", "make", makes) if taking else ("in", "take", takes)
            facts = {"do": item.do, "expected": "; or ".join(dict.fromkeys(options)), "verb": verb}
            places = ", ".join(kinds) or "nothing"
            faults.at(side).add("wrong-connection", places=places, **facts)
        elif item.do == "meas" and makes == ["a point"] and item.along is None:
            faults.add("missing-key", key="along", expected="x, -x, ... or [i, j, k]")
        elif item.do == "meas" and makes != ["a point"] and item.along is not None:
            faults.at("along").add("misplaced", key="along", where="a point")
        again = any(self.makers[name][0] != index for name in item.out)
        if again or len(faults.findings) > before:
            return None
        return Step(
            index=index, do=item.do, use=making[0], inputs=tuple(item.in_), outputs=tuple(item.out),
            formula=formula,
        )  # fmt: skip

    def check_known(self, faults: Faults, items: Iterable[tuple[int, str]]) -> None:
        for index, name in items:
            if name not in self.place_names:
                faults.at(index).unknown(name, self.place_names, "place")

    def formula(self, item: Transition, faults: Faults) -> Node | None:
        """The tree of a formula whose names are inputs: a constant or coordinate by its name, a
        point or vector by those of its coordinates, ``H1.x``.
        """
        if item.formula is None:
            faults.add("missing-key", key="formula", expected="a formula in the input places")
            return None
        inputs: list[str] = []
        for name in item.in_:
            kind = self.places[name].kind
            coordinates = COORDINATES[kind] if kind in ("point", "vector") else ()
            inputs += [f"{name}.{each}" for each in coordinates] or [name]
        with faults.at("formula").collected():
            node = parse(item.formula, BUDGET_FUNCTIONS, DOTTED)
            check_known(node, inputs, "input")
            for at, name in enumerate(item.in_):
                if name not in map(place_of, names(node)):
                    reason = "the formula does not use this input"
                    faults.at("in", at).add("unused-place", reason=reason)
            return node
        return None

    def check_place(self, name: str, place: Place) -> None:
        """That a place has the keys of its kind, and that one which a transition makes states
        nothing against it.
        """
        faults = self.faults.at("places", name)
        stated = faults.valued_keys()
        if "." in name:
            facts = {"kind": "a name that formulas can use", "expected": name.replace(".", "_")}
            faults.add("wrong-type", value=name, **facts)
        makers = self.makers.get(name, [])
        maker = self.transitions[makers[0]].do if makers else ""
        # Keys of places that no transition makes; a measured one states where it is all the same.
        starts = ("value", "known") if maker == "meas" else ("value", "known", "nominal_mm")
        for key, kinds in KEYS.items():
            if key not in stated:
                continue
            if place.kind not in kinds:
                where = "a " + " or a ".join(kinds)
                faults.at(key).add("misplaced", key=key, where=where)
            elif makers and key in starts:
                other = self.made_by(makers[0])
                faults.at(key).add("contradicts", other=other, expected="one of the two")
        if place.kind == "coordinate" and place.axis is None:
            faults.add("missing-key", key="axis", expected="x, y or z")
        count, expected = NOMINAL.get(place.kind, (0, ""))
        nominal = place.nominal_mm
        if nominal is not None and count and len(nominal) != count:
            faults.at("nominal_mm").add("wrong-value", value=list(nominal), expected=expected)
        if place.u is not None and place.value is None:
            faults.at("u").add("incomplete", what="`u`", other="`value`")
        measured = (maker == "meas" and count) or (place.known and not makers)
        if measured and not nominal and place.kind in NOMINAL:
            expected = "where it is measured" if makers else "where it is"
            faults.add("missing-key", key="nominal_mm", expected=expected)

    def made_by(self, index: int) -> str:
        line = self.faults.document.line_of("transitions", index)
        return f"the transition of line {line}, which makes the place"

    def check_names(self) -> None:
        """That no place is made twice or depends on itself; that every place has its value from one
        transition or from the start, and leads to those reported, or to those that end the graph.
        """
        faults = self.faults
        for name, (first, *rest) in self.makers.items():
            for index in rest:
                here = faults.at("transitions", index, "out")
                here.add("contradicts", other=self.made_by(first), value=name)
        self.check_known(faults.at("report"), self.report)
        faults.at("report").once(self.report, "the place")
        sources: dict[str, list[str]] = {}
        for item in self.transitions.values():
            for name in item.out:
                sources.setdefault(name, []).extend(item.in_)
        uncut: dict[str, list[str]] = sources
        while True:
            try:
                TopologicalSorter(uncut).prepare()
                break
            except CycleError as error:
                cycle: list[str] = error.args[1]
            index = self.makers[cycle[1]][0]
            faults.at("transitions", index).add("graph-cycle", places=" -> ".join(cycle))
            uncut = {
                name: [i for i in inputs if i not in cycle]
                for name, inputs in uncut.items()
                if name not in cycle
            }
        if self.unread:
            return
        computed = {n for n, by in self.makers.items() if self.transitions[by[0]].do != "meas"}
        ends = {*chain.from_iterable(sources.values())}
        ends |= {name for _, name in self.report} or computed
        for name, place in self.places.items():
            here = faults.at("places", name)
            made = name in self.makers or place.marked or place.known
            if not made:
                start = "`value:`, or " if place.kind == "constant" else ""
                reason = f"no transition makes this {place.kind}"
                expected = f"{start}a transition with `out: {name}`"
                here.add("unused-place", reason=reason, expected=expected)
            if name not in ends:
                expected = "an input of a transition, or listed under `report:`"
                reason = "the place leads nowhere"
                here.add("unused-place", reason=reason, expected=expected)

    def check_value(self, step: Step) -> None:
        """The values at nominal: constructions that are degenerate there, formulas without one;
        what depends on them is left out.
        """
        name = step.outputs[0]
        if step.do == "meas":
            place = self.places[name]
            if len(place.nominal_mm or ()) == NOMINAL[place.kind][0]:
                self.nominal[name] = start_value(place)
        elif all(name in self.nominal for name in step.inputs):
            try:
                step.ready(self.nominal)
            except GeometryError as error:
                what, where = f"{step.do} of {listed(step.outputs)}", f" at nominal: {error}"
                here = self.faults.at("transitions", step.index)
                here.add("no-finite-value", what=what, where=where)
