"""Transitions of a graph file against their signatures: places, kinds, counts and formulas."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mtu_cli.files.contracts import Findings, duplicates, present
from mtu_cli.files.graph_contract import Graph, Place, Transition
from mtu_cli.files.graph_formulas import formula_of
from mtu_cli.files.graph_kinds import TRANSITIONS, Given, Variant, described
from mtu_cli.files.graph_names import known_places
from mtu_cli.files.yaml_file import YamlPath
from mtu_cli.language import Node

ONLY = {"repeats": "meas", "uncertainty": "meas", "along": "meas", "formula": "compute"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A transition whose places are known and of the right kinds.

    `variant` tells the uses of one transition apart, `formula` is that of compute.
    """

    index: int
    do: str
    variant: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    formula: Node | None = None


def resolve(graph: Graph, findings: Findings) -> list[Step]:
    """The sound transitions, in the order of the file; the faults of the others to `findings`."""
    steps = []
    for index, item in present(graph.transitions):
        step = _step(index, item, graph.places, findings)
        if step is not None:
            steps.append(step)
    return steps


def _step(
    index: int, item: Transition, places: Mapping[str, Place], findings: Findings
) -> Step | None:
    path: YamlPath = ("transitions", index)
    before = len(findings.problems)
    _check_keys(item, path, findings)
    sides = {"in": item.in_, "out": item.out}
    for side, listed in sides.items():
        for at, name in enumerate(listed):
            _check_known(name, (*path, side, at), findings)
    for at, name, _ in duplicates(enumerate(item.out)):
        findings.add((*path, "out", at), "the place is put out twice", value=name)
    formula = formula_of(item, places, path, findings) if item.do == "compute" else None
    given = [_given(name, places) for name in item.in_]
    variant = _variant(item, given, places, path, findings)
    if variant is None or len(findings.problems) > before:
        return None
    if any(name not in places for listed in sides.values() for name in listed):
        return None
    return Step(
        index=index,
        do=item.do,
        variant=variant.name,
        inputs=tuple(item.in_),
        outputs=tuple(item.out),
        formula=formula,
    )


def _check_keys(item: Transition, path: YamlPath, findings: Findings) -> None:
    for key, owner in ONLY.items():
        if getattr(item, key) is not None and item.do != owner:
            findings.add((*path, key), f"only {owner} has this key", value=item.do)


def _check_known(name: str, path: YamlPath, findings: Findings) -> None:
    known = findings.keys("places")
    if name not in known:
        findings.add_unknown(path, "unknown place", name, known, known_places)


def _given(name: str, places: Mapping[str, Place]) -> Given:
    place = places.get(name)
    return (None, None) if place is None else (place.kind, place.axis)


def _variant(
    item: Transition,
    given: list[Given],
    places: Mapping[str, Place],
    path: YamlPath,
    findings: Findings,
) -> Variant | None:
    """The variant that takes these inputs and gives these outputs, or None with a finding."""
    variants = TRANSITIONS[item.do]
    fitting = [variant for variant in variants if variant.fits(given)]
    if not fitting:
        _add_misfit(item, given, variants, path, findings)
        return None
    out = [_given(name, places) for name in item.out]
    for variant in fitting:
        if _gives(variant, out):
            return _with_axis(item, given, out, variant, path, findings)
    most = max(fitting, key=lambda variant: len(variant.outputs))
    expected = " or ".join(dict.fromkeys(", ".join(item.outputs) for item in fitting))
    if len(out) > len(most.outputs):
        findings.add((*path, "out"), f"{item.do} with {len(out)} outputs", expected=expected)
        return None
    wrong = next(i for i, (kind, _) in enumerate(out) if kind not in (most.outputs[i], None))
    findings.add(
        (*path, "out", wrong),
        f"{item.do} does not make {described(out[wrong])}",
        value=item.out[wrong],
        expected=expected,
    )
    return None


def _gives(variant: Variant, out: list[Given]) -> bool:
    if len(out) > len(variant.outputs):
        return False
    pairs = zip(out, variant.outputs, strict=False)
    return all(kind in (wanted, None) for (kind, _), wanted in pairs)


def _with_axis(
    item: Transition,
    given: list[Given],
    out: list[Given],
    variant: Variant,
    path: YamlPath,
    findings: Findings,
) -> Variant | None:
    coordinate = item.do == "meas" and out[0][0] == "coordinate"
    if coordinate and item.along is not None:
        findings.add((*path, "along"), "a coordinate is probed along its own axis")
    undirected = item.do == "meas" and variant.name == "point" and item.along is None
    if undirected and out[0][0] and not _has_unknown_key(item, path, findings):
        findings.add(path, "no direction of probing", expected="`along:` x, -x, ... or [i, j, k]")
    if item.do == "displace" and variant.name == "coordinate":
        before, after = given[0][1], out[0][1]
        if before and after and before != after:
            what = f"a coordinate {before} displaced is not a coordinate {after}"
            findings.add((*path, "out"), what, value=item.out[0])
    return variant


def _has_unknown_key(item: Transition, path: YamlPath, findings: Findings) -> bool:
    """Whether a key is misspelt, which has its own message: it may be the one that is lacking."""
    return len(findings.keys(*path)) > len(item.model_fields_set)


def _add_misfit(
    item: Transition,
    given: list[Given],
    variants: tuple[Variant, ...],
    path: YamlPath,
    findings: Findings,
) -> None:
    """The first input that no variant takes there; or that there are too few or too many."""
    if not item.in_ and _has_unknown_key(item, path, findings):
        return
    expected = "; or ".join(dict.fromkeys(str(variant) for variant in variants))
    at = max(variant.reach(given)[0] for variant in variants)
    nearest = [variant for variant in variants if variant.reach(given)[0] == at]
    # A run of inputs ends at the first that does not fit: that one is at fault, not their count.
    run = any(slot.most is None for variant in nearest for slot in variant.inputs[-1:])
    if at < len(given) and (run or not any(variant.reach(given)[1] for variant in nearest)):
        findings.add(
            (*path, "in", at),
            f"{item.do} does not take {described(given[at])} as input {at + 1}",
            value=item.in_[at],
            expected=expected,
        )
        return
    count = f"{len(given)} input{'' if len(given) == 1 else 's'}"
    findings.add((*path, "in"), f"{item.do} with {count}", expected=expected)
