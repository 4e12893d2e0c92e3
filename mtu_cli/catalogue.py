"""Every finding of the package: its code, severity and sentence.

Names in braces are the facts of a finding. File, row, column, value and expectation are put
around the sentence by `Finding.message`. What a code means, why it matters and what to do stands
in ``help/findings.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of finding; a `suspicious` one is of the checks and meets --fail-if suspicious."""

    severity: Severity
    template: str
    suspicious: bool = False


def _error(template: str, suspicious: bool = False) -> Kind:
    return Kind("error", template, suspicious)


def _warning(template: str, suspicious: bool = False) -> Kind:
    return Kind("warning", template, suspicious)


def _note(template: str) -> Kind:
    return Kind("note", template)


CATALOGUE: dict[str, Kind] = {
    # Files and cells.
    "no-such-file": _error("no such file"),
    "not-a-file": _error("a {kind}, no file"),
    "empty-file": _error("holds no {what}"),
    "not-writable": _error("cannot be written: {reason}"),
    "not-readable": _error("cannot be read: {reason}"),
    "other-table": _error("holds {kind}"),
    "row-length": _error("a row of {cells}"),
    "missing-column": _error("the column is missing"),
    "wrong-type": _error("not {kind}"),
    "empty-cell": _error("empty cell"),
    "copied-rows": _error("the same as {other}"),
    "exclusive": _error("{names} are given together"),
    "incomplete": _error("{what} without {other}"),
    "missing-input": _error("{what} is missing"),
    # Instruments' files.
    "fits-no-format": _error("fits no format of an instrument: {seen}"),
    "undecided": _error("cannot be decided: {what}"),
    "instrument-file": _note("read as {how}"),
    "instrument-doubt": _warning("{doubt}"),
    # YAML files, JSON files and their contracts.
    "yaml-feature": _error("{what} is not accepted"),
    "missing-key": _error("the key '{key}' is missing"),
    "wrong-value": _error("wrong value"),
    "unknown-name": _error("unknown {what}"),
    "too-large": _error("more than {most} {what}"),
    "name-taken": _error("the name is taken: it is {taken}"),
    "appears-twice": _error("{what} appears twice"),
    "wrong-count": _error("{found}"),
    "wrong-correlation": _error("{reason}"),
    "contradicts": _error("contradicts {other}"),
    # Language.
    "equation-syntax": _error("unexpected {token}"),
    "no-finite-value": _error("{what} has no finite value{where}"),
    "not-linear": _error("the equation is not linear in {names}: {how}"),
    "wrong-unit": _error("{of} is {unit}, not {wanted}"),
    "misplaced": _error("`{key}` belongs to {where}"),
    "not-applicable": _error("{reason}"),
    # Budgets.
    "no-limits": _error("a {distribution} distribution has no limits"),
    "equal-readings": _warning(
        "all {n} readings are equal, so that u is 0; add the resolution r as half_width: r/2 "
        "with distribution: rectangular (JCGM 100, F.2.2.1)"
    ),
    "not-differentiable": _warning(
        "{output}: {reason}: no first-order uncertainty exists, use the Monte Carlo"
    ),
    "second-order": _warning("{output}: {reason}; to the second order {second}"),
    "correlated-inputs": _warning("{names} are correlated and not {how}: {assumed}"),
    # The machine.
    "unused": _warning("the {what} '{name}' is in no equation"),
    # Calls.
    "option-not-used": _warning("changes nothing{why}"),
    "usage": _error("{reason}"),
    "out-of-range": _error("out of range"),
    "too-little-data": _error("too little data: {what}"),
    "gate-undefined": _error("the gate {gate} is undefined"),
    # Files to write.
    "output-form": _error("{reason}"),
    "not-overwritten": _error("not overwritten, as {reason}"),
    # Simulation.
    "reported": _warning("{message}"),
    "one-direction": _warning(
        "{names} has one value for all features: a reversal cancels between them"
    ),
    # Figures that do not exist, and what validation and correction show.
    "not-estimable": _note("not estimable: {quantity} ({names}); {reason}"),
    "not-converged": _warning("{trials} Monte Carlo trials: not converged to {goal}"),
    "validation-failed": _warning(
        "{names}: the first-order and the Monte Carlo interval differ by {difference}, beyond the "
        "tolerance of JCGM 101, clause 8: use the Monte Carlo interval"
    ),
    "validation-undecided": _warning(
        "too few Monte Carlo trials to judge the first-order interval of {names} (JCGM 101, "
        "clause 8)"
    ),
    "no-formula": _warning("no formula: {reason}"),
    "unrelated": _warning("{output} does not depend on {names}"),
    "form-left": _warning(
        "{names}: form after the correction beyond what the model's uncertainty and the scatter of "
        "the points explain ({worst}: rms {rms_um:.3g} um, expected {explained_um:.3g} um): the "
        "rings are not round, or the model lacks a squareness or a scale"
    ),
    "no-uncertainty": _warning("{names} without an uncertainty, taken as exactly known"),
    "machine-written-anew": _warning(
        "comments are lost: values of the file are written anew with the effects"
    ),
    # The part and the study.
    # Measurement graphs and effects.
    "graph-cycle": _error("a cycle: {places}"),
    "unused-place": _error("{reason}"),
    "wrong-connection": _error("{do} does not {verb} {places}"),
    # Checks of readings and sensors.
    "distances-not-errors": _error(
        "{component}: the errors are distances that follow the position ({rows}): subtract "
        "the position",
        True,
    ),
    "swapped-columns": _error(
        "{component}: the same errors in every pass at other positions: position_mm and error "
        "are swapped ({rows})",
        True,
    ),
    "unit-of-errors": _error(
        "errors of up to {size} {unit} are those of no machine; the unit is probably {meant} "
        "({rows})",
        True,
    ),
    "position-beyond-travel": _error(
        "beyond three times the travel of {axis} ({travel} mm){hint}",
        True,
    ),
    "unit-of-positions": _warning(
        "positions of {names} are within a twentieth of the travel of {axis} ({travel} mm)"
        "{hint} ({rows})",
        True,
    ),
    "copied-values": _warning(
        "the same values to the last digit, more than chance explains: {names} ({rows})", True
    ),
    "unlike-pass": _warning("{component}: pass {number} {how} ({rows})", True),
    "outlying-value": _warning(
        "{what}: {count} outlying, up to {off} {unit} off {beside}, whose s is {s} {unit} ({rows})",
        True,
    ),
    "sensor-unit": _error("the temperatures are in {unit}, not degC ({rows})", True),
    "sensor-out-of-range": _error(
        "outside {low:g} to {high:g} degC: no temperature of a machine", True
    ),
    "sensor-spike": _warning(
        "a spike of the sensor, or its code for no reading: far off its neighbours ({rows})", True
    ),
    "stuck-sensor": _warning(
        "the sensor is stuck at one value while others moved by {others} K ({rows})", True
    ),
    # Checks of points, parts and machines.
    "unit-of-points": _error("the points are typically {off} mm off: {looks} ({rows})", True),
    "far-from-nominal": _warning(
        "{what}: {off} mm from nominal, more than a machine errs: {looks} ({rows})", True
    ),
    "implausible-size": _warning("{what} is hardly meant; probably {meant}", True),
    "alike": _warning("{what}: {names}", True),
    "partial-circle": _warning("a trace is an arc, no circle"),
    # Measured parts.
    "few-parts": _warning("too few parts ({parts} for {items}): {consequence}"),
    "no-repeats": _warning("no part was measured twice ({items}): {consequence}"),
    "negative-variance": _warning(
        "the estimate of the {what} variance is negative ({items}): {consequence}"
    ),
    "few-degrees-of-freedom": _warning(
        "{names}: few degrees of freedom, {how}: use the 95 % interval, not u"
    ),
    "paper-method": _warning(
        "--method paper takes MS_between for the part-to-part variance, without an interval, and "
        "leaves it out of the uncertainties (Gilsinn & Ling 2004, eqs. (29)-(34))"
    ),
    "missing-values": _warning("{what} missing ({names}): {consequence}"),
    "not-measured": _warning("{names} left out: {reason}"),
    "axis-without-equation": _warning("the machine has no equation E{axis}: {consequence}"),
    "axis-not-measured": _warning("{what} have no {axis}_mm: {consequence}"),
    # The closed loop.
    "too-few": _warning("not judged: {what}"),
    "outliers-set-aside": _warning("excluded as outliers from the search{of}: {entries}"),
    "max-effects": _warning(
        "the search{of} stopped at {most}, and more would pass (--max-effects)"
    ),
    "datum-freed": _warning(
        "the best-fit alignment ({datum}) was removed from each part; it takes these effects with "
        "it: {unseen}"
    ),
    "effect-not-written": _warning("{effect} is not added to the machine: {reason}"),
    "nothing-added": _warning("no effect is added: what is written is the machine as it was"),
    "written-class": _warning(
        "of effects that this data cannot separate the likeliest is written: {names}"
    ),
    "written-unexplained": _warning(
        "{names}: written as tentative, as a part of the errors remains unexplained"
    ),
    # Comparison and correction.
    "not-tested": _warning("{what} not tested ({items}): {reason}"),
    "no-thermal-component": _warning(
        "the points are off the reference of {reference:.4g} degC ({sensor} reads {reading:.4g} "
        "degC), but the model has no thermal component"
    ),
    "outside-measured-range": _warning(
        "{what} is outside the measured range of {names}, {low:g} to {high:g} {unit}: extrapolated"
    ),
    # The model.
    "nominals-differ": _warning(
        "{names}: more than one nominal place; each error is taken at its own ({rows})", True
    ),
    "settled-temperatures": _warning(
        "the drift of {components} follows its temperatures with lags of up to {minutes:g} min: "
        "without a history they count as settled"
    ),
    "sensor-still": _warning("{sensor} stands still{where}: {consequence}"),
    "outside-effect-range": _warning(
        "the data of {effects} have {covariate} {range}: {consequence}"
    ),
    "not-separable": _warning("{what} not separable from {others}: {consequence}"),
    "not-used": _warning("{what} not used ({names}): {reason}"),
    "no-scatter-known": _warning("the scatter of the {what} is unknown ({names}): {consequence}"),
    "reversal": _warning(
        "{component} reverses by {size:.2g} {unit} (p = {p:.1g}): predictions are for the mean of "
        "both directions; a feature approached from one side is off by half of it"
    ),
    "passes-drift": _warning(
        "{component} drifts by {size:.2g} {unit} {each} (p = {p:.1g}): its passes are not "
        "exchangeable, the next part may lie beyond them"
    ),
    "lack-of-fit": _warning(
        "{component} is not a polynomial of the degree that the machine file gives (p = {p:.1g}): "
        "raise its degree"
    ),
    "instruments-disagree": _warning(
        "the instruments disagree on {component} (p = {p:.2g}): u of the combined line is too small"
    ),
    # Tables of readings.
    "drift-not-removed": _warning(
        "the readings of {component} do not have {columns} in every row: its known drift with "
        "temperature stays in them"
    ),
    # Tests of ISO 230.
    "test-conditions": _warning("{component}: {what}; {clause} asks for {wanted}"),
    "corrected-to-20": _note(
        "{component}: the readings are corrected to 20 degC, by {rise:.3g} um/m, {size:.3g} um "
        "over the travel (already_at_20: false)"
    ),
    "not-proven": _warning(
        "{names}: within U of the limit, so neither conformity nor nonconformity is proven "
        "(ISO 14253-1)"
    ),
    # Thermal models.
    "no-effect-of-temperature": _warning("{component}: no sensor in the model: {reason}"),
    "order-of-cycles": _warning("{component}: {reason}"),
    "not-held-out": _warning(
        "{component}: {cycles}: no cycle can be held out, and the rms of the fit says little of "
        "the next warm-up"
    ),
    # Compensation.
    "backlash-varies": _warning(
        "the backlash of {component} varies by {range_um:.3g} um along the travel (mean "
        "{mean_um:.3g} um, p = {p:.1g}): one value of backlash over-corrects somewhere"
    ),
    "unlike-first-test": _warning(
        "{component}: beyond what the table does, the readings of --verify differ from the first "
        "test by more than its scatter (chi2/dof {ratio:.3g}, p = {p:.1g}): the axis or the "
        "control has changed, too"
    ),
    "no-better": _warning(
        "{component}: on held-out cycles the temperatures {effect}: the model is not to be used"
    ),
}
