"""What one record says: which of its names are right, what is claimed, what its intervals hold."""

import re
from collections.abc import Callable, Iterator
from typing import Any

Record = dict[str, Any]
NAMELESS = re.compile("unnamed|nameless|walk|field")
"""Members of a class without a cause of the library; a smooth field is both name and nameless."""
ALIKE = {
    "misshapen": [
        (r"curvature-(.)", r"profile-\1"), (r"straightness-.", r"profile-.|field-xy"),
    ],
    "outside": [(r"smooth-field", r"field-xy|.*field.*")],
    "reversal": [(r"backlash", r"backlash.*|lost-motion.*|reversal.*")],
}  # fmt: skip
"""By the start of a kind: names of a truth, and other names that are as right."""
OF_COVARIATE = {"thermal-drift", "thermal-growth", "trend", "wear-approach"}
"""Families whose size is that of one column of the data."""
BOTH_SCALES = {"scale-x", "scale-y"}


def effects(record: Record) -> list[Record]:
    """Without offsets, as true effects have no mean here, and without the drift of a growth that
    is counted from another place than the middle.
    """
    grows = record["kind"] == "hidden-scale"
    left = ("offset", "thermal-drift") if grows else "offset"
    return [effect for effect in record["report"]["effects"] if not effect["name"].startswith(left)]


def names(record: Record) -> list[str]:
    return [effect["name"] for effect in effects(record)]


def right(record: Record, name: str, truth: int) -> bool:
    """Whether a name is that of a truth, or of what is the same on this data."""
    true = record["truth"]
    called = true["names"][truth] or true["families"][truth]
    if name in (called, *true["aliases"][truth]):
        return True
    if called == "scale" and name in BOTH_SCALES:
        return {*names(record)} == BOTH_SCALES
    kind = record["kind"].split("-")[0]
    return any(
        (match := re.fullmatch(of, called)) and re.fullmatch(match.expand(also), name)
        for of, also in ALIKE.get(kind, [])
    )


def any_right(record: Record, name: str) -> bool:
    return any(right(record, name, i) for i in range(len(record["truth"]["names"])))


def detected(record: Record) -> bool:
    return bool(names(record))


def right_first(record: Record) -> bool:
    return detected(record) and any_right(record, names(record)[0])


def first_class(record: Record) -> list[str]:
    for effect in effects(record)[:1]:
        return list(effect.get("class") or [effect["name"]]) + list(effect.get("aliases") or [])
    return []


def class_holds(record: Record) -> bool:
    return any(any_right(record, name) for name in first_class(record))


def flagged(record: Record) -> bool:
    """Whether it is said that something without a name is there, or may be."""
    report = record["report"]
    stated = [*names(record), *first_class(record)]
    return unexplained(record) or report["unexplained"] or any(map(NAMELESS.match, stated))


def unexplained(record: Record) -> bool:
    return bool(record["report"]["verdict"] == "unexplained")


def alarm(record: Record) -> bool:
    """Whether more is said than is there; a noisy operation may be named."""
    also = "operation-scatter" if record["noise"] == "noisy-operation" else ""
    return unexplained(record) or not all(
        name == also or any_right(record, name) for name in names(record)
    )


def lone_wrong(record: Record) -> bool:
    """One cause is claimed, and it is another one."""
    claimed = record["report"]["verdict"] == "named" and len(first_class(record)) == 1
    return claimed and not right_first(record)


def named_wrong(record: Record) -> bool:
    """All that is reported is claimed, and some of it is not there."""
    return record["report"]["verdict"] == "named" and not all(
        any_right(record, name) for name in names(record)
    )


def exact(record: Record) -> bool:
    """Each truth named once, and nothing else."""
    stated, left = names(record), list(range(len(record["truth"]["names"])))
    if {*stated} == BOTH_SCALES and record["truth"]["names"] == ["scale"]:
        return True
    for name in stated:
        match = [i for i in left if right(record, name, i)]
        if not match:
            return False
        left.remove(match[0])
    return not left


def tellable(record: Record, least: float = 4.0) -> bool:
    d = record["truth"]["d"]
    return bool(d) and all(value is not None and value >= least for value in d)


def sizes_hold(record: Record) -> Iterator[bool]:
    """Of each right name's parameters that mean what the truth's do: its 95 % interval."""
    true = record["truth"]
    for effect in record["report"]["effects"]:
        for parameter, value in (true["sizes"].get(effect["name"]) or {}).items():
            stated = effect["parameters"].get(parameter)
            if stated is None or len(stated) < 4 or not _same(record, effect):
                continue
            # Which of two operations carries the shift is a matter of sign.
            signs = (1, -1) if effect["family"] == "operation" else (1,)
            yield any(stated[2] <= sign * value <= stated[3] for sign in signs)


def _same(record: Record, effect: Record) -> bool:
    true = record["truth"]
    if effect["family"] in ("step", "backlash-step"):
        return bool(effect["searched"]["at"][0] == true["searched"].get("at"))
    if effect["family"] == "feature-outlier":
        return str(effect.get("chosen")) == str(int(true["searched"].get("feature", -2)) + 1)
    if effect["family"] not in OF_COVARIATE or true["covariate"] is None:
        return True
    return bool(effect.get("covariate") == true["covariate"])


def searched_hold(record: Record) -> Iterator[bool]:
    """Of each right name's searched parameters: its 95 % set, one interval or several."""
    for effect in record["report"]["effects"]:
        for name, value in record["truth"]["searched"].items():
            stated = (effect["searched"].get(name) or [None, None])[1]
            if stated and effect["name"] in record["truth"]["names"]:
                several = stated if isinstance(stated[0], list) else [stated]
                # An end that the data leave open is null.
                yield any(
                    (low is None or low <= value) and (high is None or value <= high)
                    for low, high in several
                )


def classes(record: Record) -> list[set[str]]:
    """Of each effect its name, and all that it might be instead."""
    return [{effect["name"], *(effect.get("class") or [])} for effect in effects(record)]


def held(record: Record, truth: int = 0) -> bool:
    """Whether a truth is among the names or their rivals."""
    members = {name for group in classes(record) for name in group}
    return any(right(record, name, truth) for name in members)


def beside(record: Record) -> bool:
    """Whether an effect is reported that is not there, nor any of its class."""
    also = "operation-scatter" if record["noise"] == "noisy-operation" else ""
    return not all(
        any(name == also or any_right(record, name) for name in group) for group in classes(record)
    )


def of_family(family: str) -> Callable[[Record], bool]:
    """Whether one of the truths was asked for by this name."""
    return lambda record: family in record["truth"]["families"]


def foretold(record: Record) -> Iterator[list[float]]:
    """Rows (value, -, low, high, mean, future, half width if all were known) of the written machine
    at places and times not measured, of axes that the truth or the machine moves, where an equation
    was written.
    """
    report = record["report"]
    if any(effect["equations"] for effect in report["effects"]):
        for ask in report.get("predicted", []):
            # Records of before have predictions at measured places, too.
            if ask.get("inside"):
                yield from (row for row in ask["rows"] if row[0] or row[4])
