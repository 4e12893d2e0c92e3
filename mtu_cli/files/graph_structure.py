"""The net of a graph file: what makes each place, what uses it, cycles, the firing order."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence

from mtu_cli.files.contracts import Findings, duplicates, present
from mtu_cli.files.graph_contract import Graph, Place
from mtu_cli.files.graph_cycles import Arcs, cycles
from mtu_cli.files.graph_names import known_places
from mtu_cli.files.graph_steps import Step

SHOWN_REPORT = 6
"""Reported places above which a hint does not list them again."""
Makers = dict[str, list[int]]
OUT, IN = "out", "in"


def firing_order(steps: Iterable[Step], start: Iterable[str]) -> list[list[Step]]:
    """Rounds of transitions: each fires once, as soon as all its inputs hold a marker.

    Places of `start` hold one from the beginning (Stryczek: M0). Measurements, which have no
    input, fire in the first round; within a round the file's order counts. Transitions that never
    fire (in or behind a cycle, or behind a fault) are left out.
    """
    markers = set(start)
    missing: dict[int, int] = {}
    users: dict[str, list[Step]] = {}
    ready = []
    for step in steps:
        unmarked = set(step.inputs) - markers
        missing[step.index] = len(unmarked)
        for name in unmarked:
            users.setdefault(name, []).append(step)
        if not unmarked:
            ready.append(step)
    rounds: list[list[Step]] = []
    while ready:
        rounds.append(ready)
        found = []
        for name in dict.fromkeys(name for step in ready for name in step.outputs):
            for step in users.pop(name, []):
                missing[step.index] -= 1
                if not missing[step.index]:
                    found.append(step)
        ready = sorted(found, key=lambda step: step.index)
    return rounds


def marked(places: Mapping[str, Place]) -> list[str]:
    """Constants with a value and known points: they carry a marker from the start."""
    return [name for name, item in places.items() if item.marked]


def sinks(graph: Graph) -> list[str]:
    """Computed places that no transition uses, in the order of the file."""
    used = {name for item in graph.transitions for name in item.in_}
    made = {name for item in graph.transitions if item.do != "meas" for name in item.out}
    return [name for name in graph.places if name in made - used]


def _arcs(findings: Findings) -> Arcs:
    """(index, inputs, outputs) of all transitions as the file has them, faulty ones included:
    a place whose maker is at fault is not without one.
    """
    data = findings.document.data.get("transitions")
    items = data if isinstance(data, list) else []
    return [
        (index, _names(item.get("in")), _names(item.get("out")))
        for index, item in enumerate(items)
        if isinstance(item, dict)
    ]


def _names(value: object) -> list[str]:
    listed = value if isinstance(value, list) else [value]
    return [str(item) for item in listed if isinstance(item, (str, int))]


def check_net(graph: Graph, findings: Findings) -> None:
    """Everything that concerns more than one transition."""
    arcs = _arcs(findings)
    makers: Makers = {}
    used: set[str] = set()
    for index, inputs, outputs in arcs:
        used.update(inputs)
        for name in dict.fromkeys(outputs):
            makers.setdefault(name, []).append(index)
    _check_made_once(makers, findings)
    unclear = _unclear_sides(graph, findings)
    unmade = [name for name, place in graph.places.items() if not (name in makers or place.marked)]
    for name, place in graph.places.items():
        _check_own_keys(name, place, findings)
        if name not in unmade or len(unmade) > unclear[OUT]:
            _check_origin(name, place, makers.get(name, []), graph, findings)
    _check_report(graph, findings)
    _check_used(graph, used, makers, unclear[IN], findings)
    for cycle in cycles(arcs):
        index = makers[cycle[1]][0]
        findings.add(("transitions", index), f"a cycle: {' -> '.join(cycle)}")
    _check_correlations(graph, findings)


def _unclear_sides(graph: Graph, findings: Findings) -> dict[str, float]:
    """How many places may be meant by what is wrong with `out` and `in`: one by each name that is
    not known or no text, any by a transition that lacks its list. So many that nothing makes are
    not told: that fault is.
    """
    known = findings.keys("places")
    data = findings.document.data.get("transitions")
    if not isinstance(data, list):
        return {OUT: math.inf, IN: math.inf}
    unknown: dict[str, float] = {OUT: 0.0, IN: 0.0}
    for item in data:
        entry = item if isinstance(item, dict) else {}
        for side in (OUT, IN):
            unknown[side] += _unclear_names(entry.get(side, []), known)
        if OUT not in entry:
            unknown[OUT] = math.inf
        if entry.get("do") != "meas" and not isinstance(entry.get(IN), list):
            unknown[IN] = math.inf
    return unknown


def _unclear_names(value: object, known: Collection[str]) -> int:
    listed = value if isinstance(value, list) else [value]
    groups = [item for item in listed if isinstance(item, (list, dict))]
    names = _names(value)
    rest = len(listed) - len(groups) - len(names)
    return sum(name not in known for name in names) + sum(map(len, groups)) + rest


def _check_made_once(makers: Makers, findings: Findings) -> None:
    for name, indices in makers.items():
        for index in indices[1:]:
            line = findings.document.line_of("transitions", indices[0])
            what = f"the place is made twice, first in line {line}"
            findings.add(("transitions", index, "out"), what, value=name)


_KEYS = {
    "axis": ("coordinate",),
    "nominal_mm": ("coordinate", "point"),
    "value": ("constant",),
    "u": ("constant",),
    "unit": ("constant",),
}


def _check_own_keys(name: str, place: Place, findings: Findings) -> None:
    if "." in name:
        what = "a name with a dot, which stands between a place and its coordinate"
        findings.add(("places", name), what, value=name, expected=name.replace(".", "_"))
    for key, kinds in _KEYS.items():
        if getattr(place, key) is not None and place.kind not in kinds:
            expected = f"it at a {' or a '.join(kinds)} only"
            findings.add(("places", name, key), f"a {place.kind} has no {key}", expected=expected)
    if place.kind == "coordinate" and place.axis is None and "axis" not in _raw(name, findings):
        findings.add(
            ("places", name), "a coordinate without its axis", expected="`axis:` x, y or z"
        )
    wanted = {"coordinate": 1, "point": 3}.get(place.kind)
    if place.nominal_mm is not None and wanted not in (None, len(place.nominal_mm)):
        expected = "one number" if wanted == 1 else "[x, y, z]"
        findings.add(
            ("places", name, "nominal_mm"),
            f"the nominal of a {place.kind}",
            value=list(place.nominal_mm),
            expected=expected,
        )
    if place.known and place.kind != "point":
        findings.add(("places", name, "known"), f"a {place.kind} is not known", expected="a point")
    if place.u is not None and place.value is None:
        findings.add(("places", name, "u"), "an uncertainty without a value")


def _raw(name: str, findings: Findings) -> tuple[str, ...]:
    return findings.given("places", name)


def _check_origin(
    name: str, place: Place, indices: Sequence[int], graph: Graph, findings: Findings
) -> None:
    path = ("places", name)
    raw = _raw(name, findings)
    if not indices:
        _check_start(name, place, raw, findings)
        return
    line = findings.document.line_of("transitions", indices[0])
    maker = graph.transitions[indices[0]] if graph.transitions else None
    if place.known:
        what = f"is known, and the transition in line {line} makes it"
        findings.add((*path, "known"), what, expected="one of the two")
    if place.value is not None:
        what = f"has a value, and the transition in line {line} makes it"
        findings.add((*path, "value"), what, expected="one of the two")
    if maker is None:
        return
    measured = maker.do == "meas"
    misspelt = len(findings.keys(*path)) > len(place.model_fields_set)
    measurable = place.kind in ("coordinate", "point") and not misspelt
    if measured and measurable and "nominal_mm" not in raw:
        findings.add(path, "measured, but without a nominal", expected="`nominal_mm:`")
    if not measured and place.nominal_mm is not None:
        what = f"the transition in line {line} computes it: its nominal follows"
        findings.add((*path, "nominal_mm"), what, expected="no nominal here")


def _check_start(name: str, place: Place, raw: Sequence[str], findings: Findings) -> None:
    if place.known and place.kind == "point":
        if "nominal_mm" not in raw:
            findings.add(("places", name), "known, but where?", expected="`nominal_mm:`")
    elif place.kind != "constant":
        expected = f"a transition with `out: {name}`"
        findings.add(("places", name), f"no transition makes this {place.kind}", expected=expected)
    elif "value" not in raw:
        what = "a constant without a value that no transition makes"
        findings.add(
            ("places", name), what, expected=f"`value:`, or a transition with `out: {name}`"
        )


def _check_report(graph: Graph, findings: Findings) -> None:
    known = findings.keys("places")
    reported = list(graph.report)
    for index, name in enumerate(reported):
        if name is not None and name not in known:
            findings.add_unknown(("report", index), "unknown place", name, known, known_places)
    for index, name, _ in duplicates(present(reported)):
        findings.add(("report", index), "the place is reported twice", value=name)


def _check_used(
    graph: Graph, used: set[str], makers: Makers, unclear: float, findings: Findings
) -> None:
    known = findings.keys("places")
    reported = list(graph.report)
    # Where nothing is listed, the places that end the graph are what it is for.
    ends = set(reported) if reported else _computed(graph, makers)
    shown = reported or [name for name in graph.places if name in ends - used]
    listed = [name for name in dict.fromkeys(shown) if name in known]
    idle = [name for name in graph.places if name not in used and name not in ends]
    # A place leads nowhere mostly because what was to use it is at fault: that comes first.
    if not unclear and len(idle) > sum(name not in known for name in reported):
        for name in idle:
            hint = f"`report: [{', '.join([*listed, name])}]`"
            hint = hint if len(listed) < SHOWN_REPORT else "listed under `report:`"
            expected = f"an input of a transition, or {hint}{_left_out(name, graph, makers)}"
            findings.add(("places", name), "leads nowhere", expected=expected)


def _left_out(name: str, graph: Graph, makers: Makers) -> str:
    """That a radius need not be put out, where the place is one."""
    for index in makers.get(name, []):
        item = graph.transitions[index] if graph.transitions else None
        if item is not None and item.do in ("circle", "sphere") and item.out[1:] == [name]:
            return f"; or without the radius: `out: {item.out[0]}`"
    return ""


def _computed(graph: Graph, makers: Makers) -> set[str]:
    measured = {index for index, item in present(graph.transitions) if item.do == "meas"}
    return {name for name, indices in makers.items() if not measured.issuperset(indices)}


def _check_correlations(graph: Graph, findings: Findings) -> None:
    seen: set[frozenset[str]] = set()
    for index, (first, second, r) in present(graph.correlations):
        path = ("correlations", index)
        for at, name in enumerate((first, second)):
            _check_correlated(name, (*path, at), graph, findings)
        if not -1.0 <= r <= 1.0:
            findings.add((*path, 2), "a correlation beyond 1", value=f"{r:g}", expected="-1 to 1")
        pair = frozenset((first, second))
        if first == second:
            findings.add(path, "a correlation of a constant with itself", value=first)
        elif pair in seen:
            findings.add(path, "the correlation is given twice", value=f"{first}, {second}")
        seen.add(pair)


def _check_correlated(
    name: str, path: tuple[str | int, ...], graph: Graph, findings: Findings
) -> None:
    known = findings.keys("places")
    place = graph.places.get(name)
    if name not in known:
        findings.add_unknown(path, "unknown place", name, known, known_places)
    elif place is not None and (place.value is None or not place.u):
        expected = "a constant with `value` and `u`"
        findings.add(path, "has no uncertainty of its own", value=name, expected=expected)
    elif place is not None and place.distribution != "normal":
        what = f"correlated, but {place.distribution}"
        findings.add(path, what, value=name, expected="normal constants")
