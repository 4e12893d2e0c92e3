"""What a fit must tell its user before the figures are believed."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable
from statistics import median

import numpy as np

from mtu_cli.errors import Warned, reworded
from mtu_cli.findings import Finding
from mtu_cli.model.estimation import InstrumentFit
from mtu_cli.model.fit import MachineFit
from mtu_cli.stats.family import FAMILY_RATE, significant
from mtu_cli.units import LENGTH, Unit

SCATTERS = 1e-12
"""Less, in mm or rad, is rounding: the readings do not scatter."""
TOO_WELL = 1 / 300
"""Components of a machine differ less in repeatability; units differ by 1000."""
FEWEST_OTHERS = 3
LARGER_UNIT = {"nm": "um", "um": "mm", "urad": "mrad", "mrad": "rad", "arcsec": "deg"}
LIMITS = ("reversal", "passes-drift", "instruments-disagree")
"""Warnings of what u of a part holds nothing of. A misfit is among its repeatability."""
SINGLE = ("outlying-reading",)
"""Doubts of single rows, which alone may make a line misfit."""
RAISE = "raise its degree"
FIRST = "a single row of it looks mistaken, put that right first; else raise its degree"
DISAGREE = "the instruments disagree on "
"""Other warnings of LIMITS begin with the component."""


def scatter_warnings(fit: MachineFit) -> list[Finding]:
    """That readings do not give all of the scatter: what is predicted from them has less of it."""
    return [*_not_separated(fit), *_one_run(fit), *_without_scatter(fit)]


def fit_warnings(fit: MachineFit, doubts: Iterable[Finding] = ()) -> list[Finding]:
    """Warnings on scatter that cannot be split, reversal, trend, lack of fit, disagreement.

    A component of which the `doubts` of the readings name a single row is not advised to be given
    a higher degree.
    """
    named = {item.facts["component"] for item in doubts if item.code in SINGLE}
    return [
        *fit.warnings,
        *scatter_warnings(fit),
        *_too_well(fit),
        *(
            reworded(item, item.text.replace(RAISE, FIRST))
            if item.code == "lack-of-fit" and named.intersection(item.facts.get("about", ()))
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
        if item.code in LIMITS and item.message.removeprefix(DISAGREE).partition(" ")[0] in used
    ]


def _significant(fit: MachineFit, codes: Iterable[str]) -> list[Finding]:
    """Of each kind of test on the passes those that hold out among all of it."""
    warnings = []
    for code in codes:
        p_of, message = TESTS[code]
        tested: dict[str, float] = {}
        where: dict[str, tuple[str, Unit, InstrumentFit]] = {}
        for name, component in fit.components.items():
            for instrument in component.instruments:
                p = p_of(instrument)
                if p is not None:
                    key = f"{name} ({instrument.role})"
                    tested[key] = p
                    where[key] = (name, component.unit, instrument)
        warnings += [
            Warned(code=code, message=message(*where[key], p), about=where[key][:1])
            for key, p in significant(tested).items()
        ]
    return warnings


def _disagreeing(fit: MachineFit) -> list[Finding]:
    return [
        Warned(
            code="instruments-disagree",
            message=f"{DISAGREE}{name} (p = {component.agreement_p:.2g}): "
            "the combined line is too sure of itself",
        )
        for name, component in fit.components.items()
        if component.agreement_p is not None
        and component.agreement_p * len(fit.components) <= FAMILY_RATE
    ]


def _not_separated(fit: MachineFit) -> list[Finding]:
    names = [
        name
        for name, component in fit.components.items()
        if not all(instrument.fit.separated for instrument in component.instruments)
    ]
    if not names:
        return []
    return [
        Warned(
            code="pass-drift-not-separated",
            message=f"the readings of {', '.join(names)} do not tell pass-to-pass drift from "
            "repeatability (one pass, or no pass column): all scatter counts as repeatability, "
            "and lengths may scatter more than is said",
        )
    ]


def _one_run(fit: MachineFit) -> list[Finding]:
    """Components of which an instrument read one run there and back alone."""
    names = [
        name
        for name, component in fit.components.items()
        if any(
            item.fit.separated and item.fit.n_passes == 2 == 2 * len(item.fit.pairs)
            for item in component.instruments
        )
    ]
    if not names:
        return []
    return [
        Warned(
            code="one-run",
            message=f"the readings of {', '.join(names)} are of one run there and back: its two "
            "passes stand for all scatter of passes, which what runs share is not in; read more",
        )
    ]


def _without_scatter(fit: MachineFit) -> list[Finding]:
    still = [
        name
        for name, component in fit.components.items()
        if component.estimate.independent_s is not None
        and component.estimate.independent_s < SCATTERS
    ]
    alike = [
        name
        for name, component in fit.components.items()
        if name not in still and not np.diag(component.estimate.covariance).all()
    ]
    rest = "their uncertainty counts as 0, where the instrument's resolution at least remains"
    found = []
    if still:
        text = f"the readings of {', '.join(still)} do not scatter: {rest}"
        found.append(Warned(code="no-scatter", message=text))
    if alike:
        text = f"the passes of {', '.join(alike)} have the same means to the last digit: of these "
        found.append(Warned(code="no-scatter", message=text + rest))
    return found


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
        text = (
            f"{name} repeats to {own / unit.to_internal:.2g} {unit.name} where the other {kind} "
            f"typically do to {median(others) / unit.to_internal:.2g} {unit.name}: are its errors "
            f"in {meant}?"
        )
        found.append(Warned(code="readings-small", message=text))
    return found


def _reversal(name: str, unit: Unit, found: InstrumentFit, p: float) -> str:
    value = found.reversal.value / unit.to_internal if found.reversal else 0.0
    forward, reverse = int((found.direction > 0).sum()), int((found.direction < 0).sum())
    mean = "the mean of both directions"
    if forward != reverse:
        mean += f", leaning to the one read more often ({forward} and {reverse} readings)"
    return (
        f"{name} reverses by {value:.2g} {unit.name} (p = {p:.1g}): predictions are for {mean}; "
        "a feature approached from one side is off by half of it"
    )


def _trend(name: str, unit: Unit, found: InstrumentFit, p: float) -> str:
    value = found.trend.value / unit.to_internal if found.trend else 0.0
    each = "a pass there and back" if len(found.fit.pairs) else "a pass"
    return (
        f"{name} drifts by {value:.2g} {unit.name} {each} (p = {p:.1g}): its passes are not "
        "exchangeable, the next part may lie beyond what they span"
    )


def _lack(name: str, unit: Unit, found: InstrumentFit, p: float) -> str:
    return (
        f"{name} is not a polynomial of the degree that the machine gives it (p = {p:.1g}): "
        f"{RAISE}, or look at the picture (--plot)"
    )


Message = Callable[[str, Unit, InstrumentFit, float], str]

TESTS: dict[str, tuple[Callable[[InstrumentFit], float | None], Message]] = {
    "reversal": (lambda f: f.reversal.p if f.reversal else None, _reversal),
    "passes-drift": (lambda f: f.trend.p if f.trend else None, _trend),
    "lack-of-fit": (lambda f: f.lack_of_fit.p if f.lack_of_fit else None, _lack),
}
"""By code: p of an instrument's readings (None: not tested), and what is said."""
