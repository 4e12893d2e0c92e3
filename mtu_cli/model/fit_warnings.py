"""Warnings of a fit: what limits its figures."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np

from mtu_cli.findings import Finding, finding, listed
from mtu_cli.model.estimation import InstrumentFit
from mtu_cli.model.fit import MachineFit
from mtu_cli.stats.family import FAMILY_RATE, significant
from mtu_cli.stats.pass_tests import FTest, Shift
from mtu_cli.units import LENGTH, Unit

SCATTERS = 1e-12
"""Less, in mm or rad, is rounding: the readings do not scatter."""
TOO_WELL = 1 / 300
"""Components of a machine differ less in repeatability; units differ by 1000."""
FEWEST_OTHERS = 3
LARGER_UNIT = {"nm": "um", "um": "mm", "urad": "mrad", "mrad": "rad", "arcsec": "deg"}
NO_SCATTER = "they do not scatter, and their uncertainty counts as 0"
ONE_RUN = "read in one run there and back: scatter from run to run is not seen"
ALL_REPEATABILITY = "one pass, or no column `pass`: all of it counts as repeatability"
LIMITS = ("reversal", "passes-drift", "instruments-disagree")
"""Warnings of what u of a part holds nothing of. A misfit is among its repeatability."""
SINGLE = ("outlying-value",)
"""Doubts of single rows, which alone may make a line misfit."""
RAISE = "raise its degree"
FIRST = "correct its outlying reading first, else raise its degree"


def scatter_warnings(fit: MachineFit) -> list[Finding]:
    """That readings do not give all of the scatter: what is predicted from them has less of it."""
    mixed, one_run, still, alike = ([] for _ in range(4))
    for name, component in fit.components.items():
        fits = [instrument.fit for instrument in component.instruments]
        if not all(each.separated for each in fits):
            mixed.append(name)
        if any(each.separated and each.n_passes == 2 == 2 * len(each.pairs) for each in fits):
            one_run.append(name)
        s = component.estimate.independent_s
        if s is not None and s < SCATTERS:
            still.append(name)
        elif not np.diag(component.estimate.covariance).all():
            alike.append(name)
    warnings = []
    if mixed:
        facts = {"what": f"the scatter from pass to pass of {listed(mixed)}", "names": mixed}
        facts |= {"others": ["repeatability"], "consequence": ALL_REPEATABILITY}
        warnings.append(finding("not-separable", **facts))
    for what, names, consequence in (
        ("readings", one_run, ONE_RUN),
        ("readings", still, NO_SCATTER),
        ("means of the passes", alike, NO_SCATTER),
    ):
        if names:
            facts = {"what": what, "names": names, "consequence": consequence}
            warnings.append(finding("no-scatter-known", **facts))
    return warnings


def fit_warnings(fit: MachineFit, doubts: Iterable[Finding] = ()) -> list[Finding]:
    """Warnings on scatter that cannot be split, reversal, trend, lack of fit, disagreement.

    A component of which the `doubts` of the readings name a single row is not advised to be given
    a higher degree.
    """
    named = {item.facts["what"] for item in doubts if item.code in SINGLE}
    return [
        *fit.warnings,
        *scatter_warnings(fit),
        *_too_well(fit),
        *(
            replace(item, facts={**item.facts, "advice": FIRST})
            if item.code == "lack-of-fit" and item.facts["component"] in named
            else item
            for item in _significant(fit, ("reversal", "passes-drift", "lack-of-fit"))
        ),
        *_disagreeing(fit),
    ]


def limit_warnings(fit: MachineFit) -> list[Finding]:
    """What limits the truth of u of a part (LIMITS), of all components that were read."""
    return [*_significant(fit, ("reversal", "passes-drift")), *_disagreeing(fit)]


def limits_of(warnings: Iterable[Finding], used: Container[str]) -> list[Finding]:
    """Those of the warnings of a fit that are LIMITS of one of the components `used`, once each."""
    return [
        item
        for item in dict.fromkeys(warnings)
        if item.code in LIMITS and item.facts["component"] in used
    ]


def _significant(fit: MachineFit, codes: Iterable[str]) -> list[Finding]:
    """Of each kind of test on the passes those that hold out among all of it."""
    read = {
        f"{name} ({instrument.role})": (name, component.unit, instrument)
        for name, component in fit.components.items()
        for instrument in component.instruments
    }
    warnings = []
    for code in codes:
        test, facts_of = TESTS[code]
        tested = {
            key: found.p for key, item in read.items() if (found := test(item[2])) is not None
        }
        for key, p in significant(tested).items():
            name, unit, instrument = read[key]
            facts = {"component": name, "p": p, "unit": unit.name} | facts_of(unit, instrument)
            warnings.append(finding(code, **facts))
    return warnings


def _disagreeing(fit: MachineFit) -> list[Finding]:
    return [
        finding("instruments-disagree", component=name, p=component.agreement_p)
        for name, component in fit.components.items()
        if component.agreement_p is not None
        and component.agreement_p * len(fit.components) <= FAMILY_RATE
    ]


def _too_well(fit: MachineFit) -> list[Finding]:
    """Components that repeat so much better than all others that their unit is asked about."""
    found = []
    for name, component in fit.components.items():
        unit, own = component.unit, component.estimate.s_repeat
        others = [
            other.estimate.s_repeat
            for other in fit.components.values()
            if other is not component and other.unit.dimension == unit.dimension
        ]
        if own <= SCATTERS or len(others) < FEWEST_OTHERS or own >= TOO_WELL * median(others):
            continue
        meant = LARGER_UNIT.get(unit.name, "another unit")
        kind = "lengths" if unit.dimension == LENGTH else "angles"
        s, typical = own / unit.to_internal, median(others) / unit.to_internal
        found.append(
            finding(
                "implausible-size",
                component=name,
                what=f"a repeatability of {name} of {s:.2g} {unit.name}, where the other {kind} "
                f"typically have {typical:.2g} {unit.name},",
                facts={"meant": meant},
            )
        )
    return found


def _reversal(unit: Unit, found: InstrumentFit) -> dict[str, Any]:
    forward, reverse = int((found.direction > 0).sum()), int((found.direction < 0).sum())
    leaning = ""
    if forward != reverse:
        leaning = f", weighted by their readings ({forward} and {reverse})"
    size = found.reversal.value / unit.to_internal if found.reversal else 0.0
    return {"size": size, "leaning": leaning}


def _trend(unit: Unit, found: InstrumentFit) -> dict[str, Any]:
    size = found.trend.value / unit.to_internal if found.trend else 0.0
    return {"size": size, "each": "a pass there and back" if len(found.fit.pairs) else "a pass"}


Test = Callable[[InstrumentFit], FTest | Shift | None]
Facts = Callable[[Unit, InstrumentFit], dict[str, Any]]

TESTS: dict[str, tuple[Test, Facts]] = {
    "reversal": (lambda fit: fit.reversal, _reversal),
    "passes-drift": (lambda fit: fit.trend, _trend),
    "lack-of-fit": (lambda fit: fit.lack_of_fit, lambda unit, found: {"advice": RAISE}),
}
"""By code: the test of an instrument's readings (None: not tested), the facts of its warning."""
