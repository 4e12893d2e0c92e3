"""What a budget file must say beyond the kinds of its values, all faults at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import get_args

from mtu_cli.files.budget_contract import Budget, Contribution, DistributionName, Input
from mtu_cli.files.contracts import Findings, present
from mtu_cli.files.yaml_file import YamlPath

SHAPED = frozenset(get_args(DistributionName)) - {"normal", "t"}
WAYS = ("u", "half_width", "low", "U")
LEAST_BOUNDED_DOF = 0.5
"""Fewer would let the half-width be uncertain by more than itself."""
ROUNDING = 1e-9


def check_inputs(budget: Budget, findings: Findings) -> None:
    """Every input and each of its contributions."""
    for name, item in (budget.inputs or {}).items():
        path = ("inputs", name)
        _check_contribution(item, path, findings)
        _check_value(item, path, findings)
        for index, part in present(item.contributions):
            own = (*path, "contributions", index)
            _check_contribution(part, own, findings)
            if part.low is not None and part.high is not None:
                what = "`low` and `high` of a further contribution have no place to stand at"
                findings.add(own, what, expected="half_width, about the input's value")
            elif not _stated(part) and "readings" not in findings.keys(*own):
                findings.add(own, "nothing says how large it is", expected="u, half_width or U")


def _stated(item: Contribution) -> list[str]:
    stated = [way for way in WAYS if getattr(item, way) is not None]
    if item.high is not None and "low" not in stated:
        stated.append("low")
    return stated


def _check_contribution(item: Contribution, path: YamlPath, findings: Findings) -> None:
    stated = _stated(item)
    if len(stated) > 1:
        named = " and ".join("low/high" if way == "low" else way for way in stated)
        what = f"{named} are given for one contribution"
        findings.add(path, what, expected="one of u, half_width, low/high, U with k")
        return
    for one, other in (("low", "high"), ("high", "low"), ("U", "k"), ("k", "U")):
        if getattr(item, one) is not None and getattr(item, other) is None:
            findings.add((*path, one), f"`{one}` without `{other}`", expected="both of them, or u")
    if item.low is not None and item.high is not None and not item.low < item.high:
        findings.add((*path, "low"), "`low` is not below `high`", value=item.low)
        return
    _check_dof(item, stated, path, findings)
    _check_kind(item, stated, path, findings)


def _check_dof(
    item: Contribution, stated: Sequence[str], path: YamlPath, findings: Findings
) -> None:
    if item.dof is None:
        if item.distribution == "t":
            findings.add(path, "a t distribution without `dof`", expected="`dof: 9`, say")
        return
    if not stated:
        what = "`dof` without an uncertainty of its own"
        readings = item.readings if isinstance(item, Input) else None
        rest = "" if readings is None else "; readings have n - 1"
        findings.add((*path, "dof"), what, expected=f"u, half_width or U beside it{rest}")
    elif item.distribution in SHAPED and item.dof < LEAST_BOUNDED_DOF:
        what = "limits with so few degrees of freedom are no limits (GUM G.4.2)"
        findings.add(
            (*path, "dof"), what, value=item.dof, expected=f"{LEAST_BOUNDED_DOF:g} or more"
        )
    if item.inexact is not None:
        what = "`inexact` and `dof` say the same: dof = (half_width/inexact)^2 / 2 (GUM G.4.2)"
        findings.add((*path, "dof"), what, expected="one of them")


def _check_kind(
    item: Contribution, stated: Sequence[str], path: YamlPath, findings: Findings
) -> None:
    kind = item.distribution or "normal"
    if kind not in SHAPED and stated in (["half_width"], ["low"]):
        default = ", and it is normal unless it says otherwise" if item.distribution is None else ""
        what = f"a {kind} distribution has no limits{default}"
        findings.add(path, what, expected="`distribution: rectangular`, say, or u")
    if item.distribution is not None and not stated:
        what, width = "a distribution without a width", "`u`, `half_width` or `low` and `high`"
        findings.add((*path, "distribution"), what, value=kind, expected=width)
    if item.top is not None and kind != "trapezoidal":
        findings.add((*path, "top"), "`top` belongs to trapezoidal", value=item.top)
    if item.inexact is not None and kind != "curvilinear-trapezoidal":
        findings.add((*path, "inexact"), "`inexact` belongs to curvilinear-trapezoidal")
    if kind == "trapezoidal" and item.top is None:
        findings.add_missing(path, "top", expected="half-width of the flat top")
    if kind == "curvilinear-trapezoidal" and item.inexact is None and item.dof is None:
        findings.add_missing(path, "inexact", expected="half-range of the half-width")
    half = _half_width(item)
    if half is not None:
        for key in ("top", "inexact"):
            value = getattr(item, key)
            if value is not None and value > half:
                what = f"`{key}` is larger than the half-width"
                findings.add((*path, key), what, value=value, expected=f"at most {half:g}")
    elif item.top is not None and item.u is not None and item.top > math.sqrt(3.0) * item.u:
        most = math.sqrt(3.0) * item.u
        what = "no trapezoid with this u has so wide a top"
        findings.add((*path, "top"), what, value=item.top, expected=f"at most {most:.6g}")
    elif item.inexact is not None and item.u is not None and item.inexact > 1.5 * item.u:
        what = "no curvilinear trapezoid with this u is so inexact"
        findings.add((*path, "inexact"), what, expected=f"at most {1.5 * item.u:.6g}")


def _half_width(item: Contribution) -> float | None:
    if item.half_width is not None:
        return item.half_width
    if item.low is not None and item.high is not None:
        return 0.5 * (item.high - item.low)
    return None


def _check_value(item: Input, path: YamlPath, findings: Findings) -> None:
    limits = item.low is not None and item.high is not None
    if item.readings is not None and item.value is not None:
        what = "`value` beside `readings`, whose mean is the value"
        findings.add((*path, "value"), what, expected="one of them")
    if item.readings is not None and limits:
        what = "`low` and `high` beside `readings`"
        findings.add((*path, "low"), what, expected="half_width, about the mean of the readings")
    stated = item.value is not None or item.readings is not None or limits
    if not stated and not _within(item, path, findings):
        findings.add_missing(path, "value", expected="a value or readings")
    if item.value is not None and item.low is not None and item.high is not None:
        middle = 0.5 * (item.low + item.high)
        if abs(item.value - middle) > ROUNDING * max(abs(item.low), abs(item.high)):
            what = "the value is not the middle of `low` and `high`, where their distribution is"
            findings.add((*path, "value"), what, value=item.value, expected=f"{middle:g}, or none")


def _within(item: Input, path: YamlPath, findings: Findings) -> bool:
    """Whether readings stand in a further contribution, which is told: they give the value."""
    parts = ((*path, "contributions", index) for index, _ in present(item.contributions))
    return any("readings" in findings.keys(*part) for part in parts)


def check_joint(budget: Budget, findings: Findings) -> None:
    """Correlations and simultaneous readings: known names, sensible numbers, no pair twice."""
    known = findings.keys("inputs")
    grouped: dict[str, int] = {}
    for index, group in present(budget.simultaneous):
        path: YamlPath = ("simultaneous", index)
        for place, name in enumerate(group):
            if name not in known:
                findings.add_unknown((*path, place), "unknown input", name, known)
            elif name in grouped:
                findings.add((*path, place), "the input stands in two places", value=name)
            grouped[name] = index
        _check_group(budget, group, path, findings)
    pairs: set[frozenset[str]] = set()
    for index, (first, second, r) in present(budget.correlations):
        path = ("correlations", index)
        for name in (first, second):
            if name not in known:
                findings.add_unknown(path, "unknown input", name, known)
            elif name in (budget.inputs or {}) and _exact(budget.inputs[name]):
                what = "correlated, but it has no uncertainty"
                findings.add(path, what, value=name, expected="an input with a width of its own")
        if not -1.0 <= r <= 1.0:
            findings.add(path, "a correlation beyond 1", value=r, expected="-1 to 1")
        if first == second:
            findings.add(path, "an input correlated with itself", value=first)
        elif frozenset((first, second)) in pairs:
            findings.add(path, "the pair stands twice", value=f"{first}, {second}")
        pairs.add(frozenset((first, second)))
        if first in grouped and grouped[first] == grouped.get(second):
            what = "the correlation of these comes from their simultaneous readings"
            findings.add(path, what, value=f"{first}, {second}", expected="one of both")


def _exact(item: Input) -> bool:
    """Whether nothing an entry says makes it vary."""
    widths = ("u", "half_width", "U", "inexact")
    stated = [getattr(part, way) for part in (item, *item.contributions) for way in widths]
    apart = item.low is not None and item.high is not None and item.low < item.high
    scattered = len(set(item.readings or [])) > 1
    return not (scattered or apart or any(stated))


def _check_group(budget: Budget, group: Sequence[str], path: YamlPath, findings: Findings) -> None:
    items = {name: budget.inputs[name] for name in group if name in (budget.inputs or {})}
    counts = {}
    for name, item in items.items():
        if item.readings is None:
            findings.add(path, f"{name!r} has no readings", expected="readings of every input")
        else:
            counts[name] = len(item.readings)
    if len(set(counts.values())) > 1:
        listed = ", ".join(f"{name} {count}" for name, count in counts.items())
        what = f"readings taken together are equally many, these are not: {listed}"
        findings.add(path, what, expected="one reading of each input at a time")


def check_coverage(budget: Budget, findings: Findings) -> None:
    """A probability or a factor."""
    coverage = budget.coverage
    if coverage is not None and coverage.probability is not None and coverage.k is not None:
        findings.add(("coverage",), "both `probability` and `k` are given", expected="one of them")
