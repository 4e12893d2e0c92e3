"""Values that agree by more than chance: copies of passes, components, parts and repeats, and
those of the drawing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mtu_cli.checks import Floats, Mask, Odd, PointsData, ReadingsData, Rows, check, limits
from mtu_cli.checks.readings import profiles
from mtu_cli.files.readings import SAME_MM
from mtu_cli.stats.resolution import step_of

MEAN_RANGE = 1.128
"""Mean difference of two normal readings in standard deviations (Tippett, 1925)."""


def agreeing(one: Floats, other: Floats) -> float:
    """The share of values (pairs, cells) that agree: of all, or of the pair that is most alike.
    Values of one part are not independent: where it lies as a whole decides on all of them.
    """
    count = (np.isfinite(one) & np.isfinite(other)).sum(axis=1)
    alike = (one == other).sum(axis=1)
    enough = count >= limits.FEWEST_EQUAL
    largest = (alike[enough] / count[enough]).max(initial=0.0)
    return float(max(largest, (alike.sum() + 1) / (count.sum() + 1)))


def copies(values: Floats, group: Rows, least: float = 0.0) -> Rows:
    """Pairs (k, 2) of rows of a table (n, cells), the first of which is equal to the second, an
    earlier one, by more than chance.

    m values agree by chance in n^2/2 q^m pairs of rows. q is the share of `agreeing` neighbours
    that are no copies, within the groups (n,) or across them; without any it is what the last
    digit hides of an instrument that repeats to s = `least`, q = 1 - 1.128 s/digit.
    """
    first: dict[bytes, int] = {}
    indices = np.arange(len(values))
    rows = enumerate(values + 0.0)  # -0.0 is 0.0
    twin = np.array([first.setdefault(row.tobytes(), i) for i, row in rows], np.int64)
    duplicates = np.flatnonzero(twin != indices)
    originals = np.flatnonzero(twin == indices)
    originals = originals[np.argsort(group[originals], kind="stable")]
    neighbours = np.array([originals[:-1], originals[1:]])
    result = [np.zeros((0, 2), np.int64)]
    for same_group in (True, False):
        neighbour_pairs, pairs = (
            pair[:, (group[pair[0]] == group[pair[1]]) == same_group]
            for pair in (neighbours, np.array([duplicates, twin[duplicates]]))
        )
        if not pairs.size:
            continue
        if neighbour_pairs.size:
            share = agreeing(*values[neighbour_pairs])
        else:
            # Values of nothing but zeros have no last digit.
            share = max(1.0 - MEAN_RANGE * least / (step_of(values) or 1.0), 0.0)
        count = np.isfinite(values[pairs[0]]).sum(axis=1)
        by_chance = len(values) ** 2 / 2 * share**count
        mask = (count >= limits.FEWEST_EQUAL) & (by_chance < limits.CHANCE)
        result.append(pairs[:, mask].T)
    return np.concatenate(result)


@check("copied-values", of="readings")
def copied_passes(data: ReadingsData) -> Iterator[Odd]:
    """A pass that is another one to the last digit."""
    number = data.table.pass_number
    for name, group in profiles(data):
        for pair in copies(data.table.error[group], np.arange(len(group))):
            one, other = number[group[pair, 0]]
            yield Odd(group[pair[0]], {"names": [f"pass {one} of {name} as pass {other}"]}, "error")


@check("copied-values", of="readings")
def copied_components(data: ReadingsData) -> Iterator[Odd]:
    """A component whose readings are those of another one."""
    first: dict[bytes, str] = {}
    for name, rows in data.by_component:
        errors = data.table.error[rows]
        other = first.setdefault(errors.tobytes(), name)
        if other != name and len(np.unique(errors)) >= limits.FEWEST_EQUAL:
            yield Odd(rows, {"names": [f"{name} as {other}"]}, "error")


@check("copied-values", of="points")
def copied_points(data: PointsData) -> Iterator[Odd]:
    """Measurements of parts with the values of another one, of the same part or of another."""
    visits, axes = data.visits, list(data.axes)
    measured = visits.errors[:, :, axes] + visits.nominal[:, axes]
    pairs = copies(measured.reshape(len(measured), -1), visits.part, limits.LEAST_REPEAT_MM)
    pairs = pairs[~of_drawing(visits.errors[pairs[:, 0]][:, :, axes]).all(axis=(1, 2))]
    if len(pairs):
        names = dict.fromkeys(
            f"part {one!r} as part {other!r}" if one != other else f"a repeat of part {one!r}"
            for one, other in data.named(visits.part[pairs])
        )
        odd = np.flatnonzero(np.isin(visits.of_point, pairs[:, 0]))
        yield Odd(odd, {"names": [*names]})


@check("copied-values", of="points")
def drawn(data: PointsData) -> Iterator[Odd]:
    """Measurements, or axes, whose values are those of the drawing to the last digit."""
    table, visits = data.table, data.visits
    errors = visits.errors[:, :, list(data.axes)]
    axes = of_drawing(errors).all(axis=(0, 1)) & (len(table) >= limits.FEWEST_EQUAL)
    for k in np.flatnonzero(axes):
        letter = "xyz"[data.axes[k]]
        names = [f"{letter} of all points as the drawing"]
        yield Odd(np.arange(len(table)), {"names": names}, f"{letter}_mm")
    errors = errors[:, :, ~axes].reshape(len(errors), -1)
    exact = of_drawing(errors)
    whole = exact.all(axis=1)
    if whole.all() or not whole.any():
        return
    share = agreeing(np.where(exact, 0.0, errors)[~whole], np.zeros_like(errors[~whole]))
    count = np.isfinite(errors).sum(axis=1)
    sure = whole & (count >= limits.FEWEST_EQUAL) & (len(errors) * share**count < limits.CHANCE)
    if sure.any():
        parts = data.named(np.unique(visits.part[sure]))
        names = [f"part {name!r} as the drawing" for name in parts]
        yield Odd(np.flatnonzero(sure[visits.of_point]), {"names": names}, "part")


def of_drawing(errors: Floats) -> Mask:
    """Which errors are those of the drawing, or not measured."""
    return ~(np.abs(errors) > SAME_MM)
