"""Measurement graph files (``mtu/graph/1``): what stands in them, and whether their net is sound.

Stryczek, "A Bipartite Graph for Estimating Measurement Uncertainty on Five-Axis Machining
Centres". A place holds a marker once it has a value; a transition fires, once, when all its
inputs hold one. `graph_kinds` says which transitions there are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

from mtu_cli.files.contract import Faults, check_contract, is_unknown_key, present
from mtu_cli.files.graph_contract import Graph, Place, Transition
from mtu_cli.files.graph_kinds import (
    COORDINATES,
    NAMED_BY_COORDINATE,
    TRANSITIONS,
    UNKNOWN,
    Variant,
    described,
    fits,
)
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, read_yaml
from mtu_cli.language import Node, check_known, names, parse
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

    def place_of(self, index: int) -> dict[str, Any]:
        """Where a transition stands, for a finding."""
        line = self.document.line_of("transitions", index)
        return {"file": self.source.shown, "line": line, "path": f"transitions[{index}]"}


def load_graph(path: Path, examine: Examine | None = None) -> LoadedGraph:
    """Reads and checks a graph file.

    `examine` sees the sound part in firing order and adds what takes a calculation to see (a
    construction that is degenerate at nominal).

    Raises InputError with all faults of the file, each with its line.
    """
    document = read_yaml(path, "graph")
    rounds: list[list[Step]] = []

    def check(graph: Graph, faults: Faults) -> None:
        sound = _sound_part(graph, faults)
        net = _Net(sound, faults)
        steps = net.steps()
        net.check_places()
        net.check_names()
        marked = (name for name, place in sound.places.items() if place.marked)
        rounds.extend(firing_order(steps, marked))
        if examine is not None:
            examine(sound, rounds, faults)

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
        cut = {name for cycle in found for name in cycle}
        rest = {n: [i for i in own if i not in cut] for n, own in before.items() if n not in cut}
        try:
            TopologicalSorter(rest).prepare()
        except CycleError as error:
            found.append(error.args[1])
        else:
            return found


def place_of(name: str) -> str:
    """The place of a name in a formula: H1 of ``H1.x``."""
    return name.partition(".")[0]


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
    listed = value if isinstance(value, list) else [value]
    sound = all(type(item) in (str, int) for item in listed)
    return [str(item) for item in listed] if sound else None


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
        self.names = {
            name: [f"{name}.{each}" for each in COORDINATES[own.kind]]
            if own.kind in NAMED_BY_COORDINATE
            else [name]
            for name, own in graph.places.items()
        }
        self.transitions = dict(present(graph.transitions))
        self.arcs: dict[int, tuple[list[str], list[str]]] = {}
        self.makers: dict[str, list[int]] = {}
        self.unclear = float(sum(name not in self.known for name in graph.report))
        data = faults.document.at("transitions")
        if not isinstance(data, list) or not data:
            # Every place seems unused: the key itself may be misspelt.
            self.unclear = math.inf
        for index, item in enumerate(data if isinstance(data, list) else ()):
            entry = item if isinstance(item, dict) else {}
            inputs = _names(entry.get("in", [] if entry.get("do") == "meas" else None))
            outputs = _names(entry.get("out"))
            self.arcs[index] = (inputs or [], outputs or [])
            for name in dict.fromkeys(outputs or ()):
                self.makers.setdefault(name, []).append(index)
            named = (*(inputs or ()), *(outputs or ()))
            readable = inputs is not None and outputs is not None
            self.unclear += sum(n not in self.known for n in named) if readable else math.inf

    def steps(self) -> list[Step]:
        """The sound transitions, less those that make a place a second time: what follows from
        that is not their fault.
        """
        steps = (self.step(index, item) for index, item in self.transitions.items())
        return [step for step in steps if step is not None]

    def step(self, index: int, item: Transition) -> Step | None:
        """A transition against its signature; None with its faults."""
        path, before = ("transitions", index), len(self.faults.findings)
        for key, owner in ONLY.items():
            if getattr(item, key) is not None and item.do != owner:
                self.faults.add((*path, key), "misplaced", key=key, where=owner)
        for side, listed in (("in", item.in_), ("out", item.out)):
            self.check_known((*path, side), enumerate(listed))
        self.faults.once((*path, "out"), enumerate(item.out), "the output")
        formula = self.formula(item, path) if item.do == "compute" else None
        variant = self.variant(item, path)
        known = all(name in self.graph.places for name in (*item.in_, *item.out))
        again = any(self.makers[name][0] != index for name in item.out)
        if variant is None or again or not known or len(self.faults.findings) > before:
            return None
        return Step(
            index=index,
            do=item.do,
            variant=variant.name,
            inputs=tuple(item.in_),
            outputs=tuple(item.out),
            formula=formula,
        )

    def check_known(self, path: YamlPath, listed: Iterable[tuple[int, str]]) -> None:
        for at, name in listed:
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
        with self.faults.collected((*path, "formula")):
            node = parse(item.formula, BUDGET_FUNCTIONS, DOTTED)
            used = names(node)
            # Of a place that is at fault itself no name is wrong.
            known = {name for name in used if place_of(name) in {*item.in_} - {*self.names}}
            check_known(node, known.union(*(self.names.get(n, ()) for n in item.in_)), "input")
            for at, name in enumerate(item.in_):
                if name not in map(place_of, used):
                    reason = "the formula does not use this input"
                    self.faults.add((*path, "in", at), "unused-place", reason=reason, value=name)
            return node
        return None

    def variant(self, item: Transition, path: YamlPath) -> Variant | None:
        """The variant that takes these inputs and gives these outputs, or None with its fault."""
        given = [self.kinds.get(name, UNKNOWN) for name in item.in_]
        out = [self.kinds.get(name, UNKNOWN) for name in item.out]
        variants = TRANSITIONS[item.do]
        taking = [variant for variant in variants if fits(variant.inputs, given)]
        making = [variant for variant in taking if fits(variant.outputs, out)]
        axes = {kind for kind in (*given[:1], *out[:1]) if kind.startswith("a coordinate ")}
        turned = item.do == "displace" and len(axes) > 1
        if turned or not making:
            side, verb, of = ("out", "make", out) if taking else ("in", "take", given)
            slots = [own.outputs if taking else own.inputs for own in taking or variants]
            known = dict.fromkeys(", ".join(map(str, own)) or "nothing" for own in slots)
            facts = {"do": item.do, "verb": verb, "places": ", ".join(of) or "nothing"}
            expected = given[0] if turned and taking else "; or ".join(known)
            self.faults.add((*path, side), "wrong-connection", expected=expected, **facts)
            return None
        if item.do == "meas" and len(making) == 1:
            is_point = making[0].name == "point"
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
                unmade.append((name, place))
        for name, place in unmade if len(unmade) > self.unclear else ():
            own = "`value:`, or " if place.kind == "constant" else ""
            given = {"reason": f"no transition makes this {place.kind}"}
            expected = f"{own}a transition with `out: {name}`"
            self.faults.add(("places", name), "unused-place", **given, expected=expected)
        used = {name for inputs, _ in self.arcs.values() for name in inputs}
        measured = {index for index, item in self.transitions.items() if item.do == "meas"}
        computed = {name for name, by in self.makers.items() if not measured.issuperset(by)}
        ends = used | (set(self.graph.report) or computed)
        idle = [name for name in self.graph.places if name not in ends]
        for name in idle if len(idle) > self.unclear else ():
            expected = "an input of a transition, or listed under `report:`"
            given = {"reason": "the place leads nowhere", "expected": expected}
            self.faults.add(("places", name), "unused-place", **given)

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
        other = self.made_by(index)
        maker = self.transitions.get(index)
        computed = maker is not None and maker.do != "meas"
        for key in ("known", "value", *(["nominal_mm"] if computed else [])):
            if key in place.stated and place.kind in KEYS[key]:
                self.faults.add((*path, key), "contradicts", other=other, expected="one of the two")
        if maker is not None and not computed and place.kind in NOMINAL and not place.nominal_mm:
            self.faults.lacks(path, "nominal_mm", "where it is measured")

    def made_by(self, index: int) -> str:
        line = self.faults.document.line_of("transitions", index)
        return f"the transition of line {line}, which makes the place"

    def check_names(self) -> None:
        """What is reported and correlated; that no place is made twice or depends on itself."""
        for name, (first, *others) in self.makers.items():
            for index in others:
                path, other = ("transitions", index, "out"), self.made_by(first)
                self.faults.add(path, "contradicts", other=other, value=name)
        report = present(self.graph.report)
        self.check_known(("report",), report)
        self.faults.once(("report",), report, "the place")
        before: dict[str, list[str]] = {}
        for inputs, outputs in self.arcs.values():
            for name in outputs:
                before.setdefault(name, []).extend(inputs)
        for cycle in cycles(before):
            index = self.makers[cycle[1]][0]
            self.faults.add(("transitions", index), "graph-cycle", places=" -> ".join(cycle))

        def judge(path: YamlPath, name: str) -> None:
            place = self.graph.places.get(name)
            if name not in self.known:
                self.faults.unknown(path, name, self.known, "place")
            elif place is not None and not (place.u and place.distribution == "normal"):
                expected = "a normal constant with `value` and `u`"
                given = {"reason": "it cannot be correlated", "expected": expected}
                self.faults.add(path, "wrong-correlation", value=name, **given)

        self.faults.correlated(present(self.graph.correlations), judge)
