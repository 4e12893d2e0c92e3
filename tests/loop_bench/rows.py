"""The table: measures in the order of the bar, each on designs A and B."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from shop_day import NOISES, OUTSIDE
from shop_day.day import Kind

from loop_bench.cells import Record
from loop_bench.figures import (
    Figure,
    class_holds,
    class_size,
    detected,
    exact_pair,
    flagged,
    lone_wrong,
    median,
    oracle_share,
    right_first,
    share,
    tellable,
    where,
)

Drawn = Mapping[tuple[Kind, str], Sequence[Record]]
ALL = (0.35, 0.5, 1.0, 2.0)
GAINS = {0.5: (0.75, 0.87), 1.0: (0.90, 0.95), 2.0: (0.97, 0.99)}
"""Shares of the oracle's gain to reach, and beyond."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One measure on one design."""

    measure: str
    kind: Kind
    figure: Figure


def rows(drawn: Drawn, kind: Kind) -> Iterator[Row]:
    """All measures of a design; those of cells that were not drawn have no data sets."""

    def of(*cells: str) -> list[Record]:
        return [record for cell in cells for record in drawn.get((kind, cell), ())]

    def row(measure: str, figure: Figure) -> Row:
        return Row(measure=measure, kind=kind, figure=figure)

    for noise in NOISES:
        alarms = [record["alarm"] for record in of(f"null-{noise}")]
        yield row(f"false alarms, {noise}", share(alarms, (0.03, 0.07), (0.04, 0.06)))
    library = {a: of(f"library-{a:g}") for a in ALL}
    yield from (row(*item) for item in _names(library))
    misshapen = {a: of(f"misshapen-{a:g}") for a in ALL[1:]}
    yield from (row(*item) for item in _wrong(library, misshapen))
    for a, (reach, beyond) in GAINS.items():
        limits = (reach, np.inf), (beyond, np.inf)
        blocks = oracle_share(library[a], *limits, "_blocks", reported=True)
        yield row(f"share of the oracle's held-out gain, {a:g} sigma", blocks)
        unseen = oracle_share(library[a], of="_blocks")
        yield row("  whether the whole data name it or not", unseen)
        best = oracle_share(library[a], of="_blocks", oracle="best", reported=True)
        yield row("  of what can be had (posterior mean)", best)
        always = oracle_share(library[a], of="_blocks", oracle="always", reported=True)
        yield row("  of an oracle that fits it in every fold", always)
        between = oracle_share(library[a], *limits)
        yield row(f"  every third part held out, {a:g} sigma", between)
    outside = {name: of(f"outside-{name}-1") for name in OUTSIDE}
    yield from (row(*item) for item in _outside(outside))
    judged = [r["covers"] for a in ALL for r in library[a] if r["covers"] is not None]
    yield row("95 % intervals cover", share(judged, (0.93, 0.97), (0.94, 0.96)))
    pairs = of("pairs-1")
    exact = share((exact_pair(r) for r in pairs), (0.75, 1.0), (0.90, 1.0))
    yield row("two effects at once, exact pair, 1 sigma", exact)
    quiet = share(exact_pair(r) and not flagged(r) for r in pairs)
    yield row("  and no check fired", quiet)
    beside = [r for r in pairs if r["standing"]]
    yield row("  of `unexplained`, a name that stands is right", share(map(_right, beside)))
    times = [r["ms"] for r in of("null-normal") if not r["gross"]]
    yield row("ms a diagnosis after calibration (median, 5-95 %)", median(times))
    yield from (row(*item) for item in _of_readings(of("laser-clean"), of("laser-1")))
    commands = of("command-1")
    right = share(right_first(r) for r in detected(commands))
    yield row("by the command: right name first, 1 sigma", right)
    times = [r["seconds"] for r in commands]
    limits = ((0.0, 5.0), (0.0, 1.0))
    yield row("s a command on 21 x 24 x 5 (median, 5-95 %)", median(times, *limits))


def _names(library: Mapping[float, Sequence[Record]]) -> Iterator[tuple[str, Figure]]:
    every = [record for a in ALL for record in library[a]]
    told = where(every, tellable)
    reach, beyond = (0.95, 1.0), (0.98, 1.0)
    yield (
        "right name first where d >= 4, given detection",
        share((right_first(r) for r in detected(told)), reach, beyond),
    )
    yield (
        "  and ranked first, detected or not",
        share(r["ranked_first"] in (*r["truths"], *r["aliases"][0]) for r in told),
    )
    yield "  detected where d >= 4", share(bool(r["names"]) for r in told)
    found = detected(library[0.5])
    yield (
        "class holds the truth, 0.5 sigma, given detection",
        share((class_holds(r) for r in found), (0.95, 1.0), (0.97, 1.0)),
    )
    yield (
        "class size, 1 sigma, mean over families",
        class_size(library[1.0], (1.0, 2.0), (1.0, 1.4)),
    )
    for a in ALL:
        yield f"  detected, {a:g} sigma", share(bool(r["names"]) for r in library[a])
        yield f"  check fired or nameless, {a:g} sigma", share(flagged(r) for r in library[a])


def _wrong(
    library: Mapping[float, Sequence[Record]], misshapen: Mapping[float, Sequence[Record]]
) -> Iterator[tuple[str, Figure]]:
    every = [record for a in ALL for record in library[a]]
    yield (
        "wrong single name, effect in the library",
        share((lone_wrong(r) for r in every), (0.0, 0.01), (0.0, 0.005)),
    )
    for a in ALL:
        yield f"  {a:g} sigma", share(lone_wrong(r) for r in library[a])
    bent = [record for own in misshapen.values() for record in own]
    limits = ((0.0, 0.10), (0.0, 0.03))
    yield "wrong single name, effect of another shape", share(map(lone_wrong, bent), *limits)
    for a, own in misshapen.items():
        yield f"  {a:g} sigma", share((lone_wrong(r) for r in own), *limits)
    yield (
        "more than one name, one effect in the library",
        share(len(r["names"]) > 1 for r in detected(every)),
    )


def _outside(outside: Mapping[str, Sequence[Record]]) -> Iterator[tuple[str, Figure]]:
    every = [record for own in outside.values() for record in own]
    limits = ((0.90, 1.0), (0.98, 1.0))
    yield "outside the library flagged, 1 sigma", share((flagged(r) for r in every), *limits)
    for name, own in outside.items():
        yield f"  {name}", share((flagged(r) for r in own), *limits)
    yield (
        "outside the library, a lone name, 1 sigma",
        share((bool(r["lone"]) for r in every), None, (0.0, 0.0)),
    )
    for name, own in outside.items():
        yield f"  {name}", share((bool(r["lone"]) for r in own), None, (0.0, 0.0))
    yield "outside the library, `named`, 1 sigma", share(map(_as_named, every))
    yield "  with one name", share(_as_named(r) and len(r["names"]) == 1 for r in every)
    yield "  a name that stands beside `unexplained`", share(bool(r["standing"]) for r in every)


def _of_readings(
    clean: Sequence[Record], planted: Sequence[Record]
) -> Iterator[tuple[str, Figure]]:
    alarms = share((r["alarm"] for r in clean), (0.03, 0.07), (0.04, 0.06))
    yield "false alarms, laser runs of one axis", alarms
    found = detected(planted)
    yield "laser runs: detected, 1 sigma", share(bool(r["names"]) for r in planted)
    holds = share((class_holds(r) for r in found), (0.95, 1.0), (0.97, 1.0))
    yield "  class holds the truth, given detection", holds
    wrong = share((lone_wrong(r) for r in planted), (0.0, 0.01), (0.0, 0.005))
    yield "  wrong single name", wrong
    yield "  right name first, given detection", share(map(right_first, found))
    judged = [r["covers"] for r in planted if r["covers"] is not None]
    yield "  95 % intervals cover", share(judged, (0.93, 0.97), (0.94, 0.96))


def _right(record: Record) -> bool:
    """Whether all names that stand are true."""
    true = {name for own in (record["truths"], *record["aliases"]) for name in own}
    return true.issuperset(record["standing"])


def _as_named(record: Record) -> bool:
    return bool(record["verdict"] == "named")


def in_words(found: Sequence[Row]) -> Iterator[str]:
    """The table as text."""
    yield (
        f"{'measure':52s} {'':1s} {'sets':>5s} {'measured':>9s} {'95 % interval':>16s} "
        f"{'to reach':>10s} {'beyond':>10s}  holds"
    )
    for row in found:
        f = row.figure
        yield (
            f"{row.measure:52s} {row.kind} {f.count:5d} {_number(f.value, f):>9s} "
            f"{_number(f.low, f) + ' - ' + _number(f.high, f):>16s} {_limit(f.reach, f):>10s} "
            f"{_limit(f.beyond, f):>10s}  {f.holds()}"
        )


def _number(value: float, figure: Figure) -> str:
    if np.isnan(value):
        return "-"
    return f"{100 * value:.1f} %" if figure.percent else f"{value:.3g}"


def _limit(limits: tuple[float, float] | None, figure: Figure) -> str:
    if limits is None:
        return ""
    times, unit = (100, " %") if figure.percent else (1, "")
    low, high = (f"{times * value:g}" for value in limits)
    if limits[0] == limits[1]:
        return f"{low}{unit}"
    if limits[0] <= 0 or (not figure.percent and limits[0] == 1.0):
        return f"<= {high}{unit}"
    if limits[1] >= 1 and (figure.percent or np.isinf(limits[1])):
        return f">= {low}{unit}"
    return f"{low}-{high}{unit}"
