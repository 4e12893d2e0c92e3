"""Warnings of a fit: what limits its figures."""

from __future__ import annotations

from collections.abc import Container, Iterable
from typing import Any

import numpy as np

from mtu_cli.findings import Finding, finding, listed
from mtu_cli.model.fit import MachineFit
from mtu_cli.stats.family import significant
from mtu_cli.stats.pass_tests import Shift

SCATTERS = 1e-12
"""Less, in mm or rad, is rounding: the readings do not scatter."""
NO_SCATTER = "they do not scatter, and their uncertainty counts as 0"
ONE_RUN = "read in one run there and back: scatter from run to run is not seen"
ALL_REPEATABILITY = "one pass, or no column `pass`: all of it counts as repeatability"
LIMITS = ("reversal", "passes-drift", "instruments-disagree")
"""Warnings of what u of a part holds nothing of. A misfit is among its repeatability."""


def scatter_warnings(fit: MachineFit) -> list[Finding]:
    """That readings do not give all of the scatter: what is predicted from them has less of it."""
    mixed: list[str] = []
    kinds = [("readings", ONE_RUN), ("readings", NO_SCATTER), ("means of the passes", NO_SCATTER)]
    unknown: dict[tuple[str, str], list[str]] = {kind: [] for kind in kinds}
    for name, component in fit.components.items():
        fits, known = [x.fit for x in component.instruments], component.estimate
        if not all(each.separated for each in fits):
            mixed.append(name)
        if any(each.separated and each.n_passes == 2 == 2 * len(each.pairs) for each in fits):
            unknown["readings", ONE_RUN].append(name)
        if known.independent_s is not None and known.independent_s < SCATTERS:
            unknown["readings", NO_SCATTER].append(name)
        elif not np.diag(known.covariance).all():
            unknown["means of the passes", NO_SCATTER].append(name)
    warnings = []
    if mixed:
        facts = {"what": f"the scatter from pass to pass of {listed(mixed)}", "names": mixed}
        facts |= {"others": ["repeatability"], "consequence": ALL_REPEATABILITY}
        warnings.append(finding("not-separable", **facts))
    for (what, consequence), names in unknown.items():
        if names:
            facts = {"what": what, "names": names, "consequence": consequence}
            warnings.append(finding("no-scatter-known", **facts))
    return warnings


def fit_warnings(fit: MachineFit) -> list[Finding]:
    """Warnings on scatter that cannot be split, reversal, trend, lack of fit, disagreement."""
    misfits = _significant(fit, "lack_of_fit", "lack-of-fit")
    return [*fit.warnings, *scatter_warnings(fit), *misfits, *limit_warnings(fit)]


def limit_warnings(fit: MachineFit) -> list[Finding]:
    """What limits the truth of u of a part (LIMITS), of all components that were read."""
    p_values = {name: x.agreement_p for name, x in fit.components.items()}
    apart = significant({name: p for name, p in p_values.items() if p is not None})
    return [
        *_significant(fit, "reversal", "reversal"),
        *_significant(fit, "trend", "passes-drift"),
        *(finding("instruments-disagree", component=name, p=p) for name, p in apart.items()),
    ]


def limits_of(warnings: Iterable[Finding], used: Container[str]) -> list[Finding]:
    """Those of the warnings of a fit that are LIMITS of one of the components `used`, once each."""
    return [
        item
        for item in dict.fromkeys(warnings)
        if item.code in LIMITS and item.facts["component"] in used
    ]


def _significant(fit: MachineFit, test: str, code: str) -> list[Finding]:
    """The warnings of one kind of test on the passes."""
    warnings = []
    for (name, role), p in fit.significant[test].items():
        component = fit.components[name]
        item = next(x for x in component.instruments if x.role == role)
        found, unit = item.tests[test], component.unit
        facts: dict[str, Any] = {"component": name, "p": p, "unit": unit.name}
        if isinstance(found, Shift):
            facts["size"] = found.value / unit.to_internal
        if test == "trend":
            facts["each"] = "a pass there and back" if len(item.fit.pairs) else "a pass"
        warnings.append(finding(code, **facts))
    return warnings
