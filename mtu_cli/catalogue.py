"""Every finding that the house can make: its code, severity and sentence.

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
    "empty-file": _error("the file is empty"),
    "not-writable": _error("cannot be written: {reason}"),
    "not-readable": _error("cannot be read: {reason}"),
    "not-text": _error("not UTF-8 text: {reason}"),
    "not-gzip": _error("not gzip-compressed"),
    "not-a-table": _error("{kind}, no table"),
    "other-table": _error("holds {kind}"),
    "no-rows": _error("holds no rows"),
    "other-separator": _error("the columns are separated by {separator}"),
    "row-unreadable": _error("the row cannot be read: {reason}"),
    "short-row": _error("a short row of {cells} cells"),
    "long-row": _error("a long row of {cells} cells"),
    "too-few-positions": _error("{component!r} of degree {degree} is measured at {count} only"),
    "missing-column": _error("the column {name!r} is missing"),
    "doubled-column": _error("the column stands twice, as column {first} and {second}"),
    "nameless-column": _error("column {place} has no name"),
    "exclusive-columns": _error("both {first!r} and {second!r} are given"),
    "misnamed-column": _error("the column {other!r} would not be read as {name!r}"),
    "not-a-number": _error("not a number"),
    "not-finite": _error("not a finite number"),
    "not-a-time": _error("not a time"),
    "times-mixed": _error("times with and without an offset from UTC"),
    "not-a-direction": _error("not a direction"),
    "empty-cell": _error("empty cell"),
    "same-file": _error("the same bytes as {other!r}: its rows would count twice"),
    "equal-row": _error("the same as row {other} in every column"),
    "wrong-kind-of-unit": _error("wrong kind of unit for {component!r}"),
    "drift-readings": _error("these look like drift readings (cycles and {sensors}, no passes)"),
    "other-nominal": _error("the nominal place of {feature!r} is not the part file's"),
    "no-nominal": _error("no nominal place is known of {features}"),
    # YAML files, JSON files and their contracts.
    "not-yaml": _error("not readable as YAML: {reason}"),
    "not-json": _error("not readable as JSON: {reason}"),
    "no-values": _error("the file holds no values"),
    "yaml-tag": _error("the tag '{tag}' is not accepted"),
    "odd-key": _error("an alias, list or mapping stands as a key"),
    "merge-key": _error("merge keys (<<) are not part of YAML 1.2"),
    "duplicate-key": _error("key '{key}' appears twice (lines {lines})"),
    "alias-in-itself": _error("an alias stands inside its own anchor"),
    "too-deep": _error("values are nested deeper than {most} levels"),
    "too-many-values": _error("more than {most} values"),
    "decimal-comma": _error("a comma ends a number of a list"),
    "other-kind": _error("not {kind}"),
    "missing-key": _error("the key '{key}' is missing"),
    "no-value": _error("no value"),
    "wrong-value": _error("wrong value"),
    "unknown-name": _error("unknown {what}"),
    "too-large": _error("the number is too large to calculate with"),
    "not-printable": _error("not a name that a table can show"),
    "not-a-name": _error("not a name that equations can use"),
    "name-taken": _error("the name is taken: it is {taken}"),
    "appears-twice": _error("{what} appears twice"),
    "wrong-count": _error("{found}"),
    "not-a-covariance": _error("{reason}"),
    "without-dof": _error("{what} without degrees of freedom"),
    "contradicts": _error("contradicts {other}"),
    # Language.
    "equation-syntax": _error("unexpected {token}"),
    "equation-too-large": _error("the equation has {number} {unit}"),
    "function-arguments": _error("{function} has {number} arguments"),
    "no-finite-value": _error("'{operation}' of these constants has no finite value"),
    "no-value-here": _error("{operation} has no finite value or no derivative at {at}"),
    "no-derivative": _error("{operation} has no derivative at {at}"),
    "name-without-value": _error("'{name}' has no value"),
    "not-linear": _error("the equation is not linear in {names}: {how}"),
    "units-differ": _error("{one} and {other} are {verb}"),
    "argument-unit": _error("{function} of {unit}"),
    "wrong-unit": _error("{of} is {unit}, not {wanted}"),
    "term-without-parameter": _error("a term without a parameter"),
    # YAML contracts.
    "keys-exclude": _error("{keys} are given together"),
    "key-needs": _error("`{key}` without {other}"),
    "key-elsewhere": _error("`{key}` belongs to {where}"),
    "number-extreme": _error("the number is too large or too small to calculate with"),
    # Budgets.
    "no-limits": _error("a {distribution} distribution has no limits"),
    "unequal-counts": _error("readings that are taken together are not equally many: {counts}"),
    "equal-readings": _warning(
        "all {n} readings are equal, so that u is 0; add the resolution r as half_width: r/2 "
        "with distribution: rectangular (JCGM 100, F.2.2.1)"
    ),
    "taken-as-exact": _warning(
        "without an uncertainty {names} are taken as exact; write u: 0 for a constant"
    ),
    "unit-not-checked": _warning("no unit of {names} is known: no term with them is checked"),
    "trials-not-finite": _error(
        "{output!r} is not finite in {count} of the first {trials} Monte Carlo trials"
    ),
    "covers-nothing": _error("a coverage factor that covers nothing"),
    "no-such-correlation": _error("{names} cannot be correlated like this: {reason}"),
    "not-differentiable": _warning(
        "{output}: {reason}: no first-order uncertainty exists, use the Monte Carlo"
    ),
    "second-order": _warning(
        "{output}: the equation is not linear over the uncertainties of its inputs; to the second "
        "order the value is {second_value:.10g} and {u}"
    ),
    "first-order-zero": _warning(
        "{output}: the first-order u is 0 ({reason}); to the second order u is {second_u}"
    ),
    "heavy-tails": _warning("the Monte Carlo u of {outputs} may not settle: {reason}; {remedy}"),
    "coverage-beyond-check": _warning(
        "k = {k:g} covers more than the {percent:g} % that a Monte Carlo checks: the intervals are "
        "for {percent:g} %"
    ),
    "gaussian-copula": _warning(
        "{names} are correlated and not all normal: the Monte Carlo takes a Gaussian copula{weaker}"
    ),
    "correlated-dof": _warning(
        "{names} are correlated and differ in degrees of freedom: Welch-Satterthwaite takes the "
        "smallest for all of them{weaker}"
    ),
    "rare-jump": _warning(
        "{output} jumps by {change:.0f} u {radius:g} standard deviations out along {along}; few of "
        "{trials} trials go there (1 in {one_in}), u would be {times:.3g} times as large"
    ),
    # The machine.
    "unused": _warning("the {what} '{name}' is in no equation"),
    # Calls.
    "option-form": _error("not {form}"),
    "option-without-effect": _error("changes nothing in what is written"),
    "option-not-used": _warning("changes nothing in what is written"),
    "usage": _error("{reason}"),
    "out-of-range": _error("out of range"),
    "not-a-whole-number": _error("not a whole number"),
    "not-a-temperature": _error("not the name of a temperature"),
    "outside-travel": _error("outside the travel of {axis}"),
    "no-input": _error("no {role} is given"),
    "too-little-data": _error("too little to judge by: {what}"),
    "gate-undefined": _error("the gate {gate} is undefined"),
    "factor-like-probability": _warning(
        "{setting} is {k:g}, so U is {k:g} u: it is a factor and no probability"
    ),
    # Files to write.
    "names-no-file": _error("names no file"),
    "wrong-ending": _error("{option} writes {kind}"),
    "extra-missing": _error("{what} cannot be written by this installation"),
    "standard-output": _error("{option} cannot go to standard output"),
    "input-overwritten": _error("is an input of {owner} and is not overwritten"),
    "data-overwritten": _error("does not begin with '{mark}': measured data is not overwritten"),
    "grid-without-map": _error("no map can be drawn of this grid"),
    # Simulation.
    "no-thermal-model": _error("no component of the equations has a thermal model"),
    "no-extent": _error("the part does not extend along {axis}"),
    "effect-too-large": _warning(
        "{effect} is {value_mm:.3g} mm{where}, more than a machine errs by"
    ),
    # The model of a call.
    "no-estimate": _error("neither readings nor coefficients of {names}"),
    "covariate-not-needed": _warning("no equation needs --at {name}"),
    "readings-not-used": _warning(
        "{report} gives the {what}; it was fitted to other files than {files}, which are not read"
    ),
    "readings-of-report": _note("{report} gives the {what}: its readings are not read again"),
    "reported": _warning("{message}"),
    "one-direction": _warning(
        "{names} has one value for all features: a reversal cancels between them"
    ),
    # Figures that do not exist, and what validation and correction show.
    "not-estimable": _note("not estimable: {quantity} ({names}); {reason}"),
    "no-standard-uncertainty": _warning(
        "{names} has a source with two degrees of freedom or fewer: no standard uncertainty "
        "exists, the 95 % interval does"
    ),
    "order-of-files": _warning(
        "{names}: several files and no times; the trend takes the files in the order given"
    ),
    "not-converged": _warning("{trials} Monte Carlo trials: not converged to {goal}"),
    "validation-failed": _warning(
        "the first-order 95 % interval of {names} differs from the Monte Carlo one by more than "
        "the tolerance of JCGM 101, clause 8 ({difference})"
    ),
    "validation-undecided": _warning(
        "too few Monte Carlo trials to judge the first-order interval of {names} (JCGM 101, "
        "clause 8)"
    ),
    "no-formula": _warning("no formula: {reason}"),
    "formula-does-not-fit": _warning(
        "the formula is up to {error_percent:.2g} % off, more than the scatter of the Monte Carlo "
        "explains (p {p:.2g})"
    ),
    "unrelated": _warning("{output} does not depend on {names}"),
    "errors-grown": _warning(
        "the correction increases the errors of {names} ({worst}: rms {rms_before_um:.3g} um "
        "before, {rms_after_um:.3g} um after): {cause}"
    ),
    "errors-left": _warning(
        "after the correction the mean errors of {names} exceed their uncertainty ({worst}: "
        "{mean_um:.3g} um, 95 % within {half_width_um:.3g} um): {cause}"
    ),
    "heights-differ": _warning(
        "the points of {names} lie at different heights along {axis} ({worst}: inclined by "
        "{angle_deg:.3g} degrees, which makes it {larger_um:.3g} um larger)"
    ),
    "oval-left": _warning(
        "{names} stay oval after the correction ({worst}): the rings are not round, or the model "
        "lacks {lacks}"
    ),
    "no-uncertainty": _warning("{names} without an uncertainty, taken as exactly known"),
    "incomplete-component": _warning("{keys} without coefficients, not used"),
    "thermal-degree": _warning(
        "a polynomial of degree {degree} misses the gradient of {sensor} at {position_mm:g} mm "
        "by {difference:.3g} {unit} per degC"
    ),
    "without-axis": _error("{what} without `of`"),
    "degree-too-high": _error("the degree is too high for the positions"),
    "not-an-axis": _error("not an axis"),
    "machine-written-anew": _warning(
        "effects cannot be appended to a file of this layout: its values are written anew, "
        "without its comments"
    ),
    # The part and the study.
    "same-place": _error("{what} at the same {where}"),
    "no-temperature-stated": _error("diameters at several temperatures without a temperature"),
    "without-outliers": _warning(
        "{component}: without {count} the {rms} falls from {before} to {after}; with them in the "
        "fit, as here, it may not"
    ),
    "unconfirmed-drift": _warning("the thermal model of {components} is unconfirmed: {reported}"),
    "second-report": _error("a second {kind} report beside {other}"),
    "not-determined": _error("the readings do not determine it"),
    # Measurement graphs and effects.
    "not-a-formula": _error("not a formula of numbers: {reason}"),
    "not-made": _error("no transition makes this {kind}"),
    "leads-nowhere": _error("the place leads nowhere"),
    "graph-cycle": _error("a cycle: {places}"),
    "wrong-input": _error("{do} does not take {place} as input {number}"),
    "input-count": _error("{do} with {inputs}"),
    "wrong-output": _error("{do} does not make {place} as output {number}"),
    "unused-place": _error("the formula does not use this input"),
    "not-a-length": _error("{do} takes a length here, this place is in {unit}"),
    "not-correlatable": _error("it cannot be correlated"),
    "correlations-contradict": _error(
        "the correlations contradict each other: their matrix is not positive semi-definite"
    ),
    "degenerate": _error("degenerate at nominal: {reason}"),
    "not-finite-in-trials": _error(
        "{do} of {places}: no finite value below {largest:g} in {count} of {trials} Monte Carlo "
        "trials{reason}"
    ),
    "several-coordinates": _error("the place has several coordinates"),
    "nothing-varies": _warning("nothing varies: nothing behind it has an uncertainty"),
    "not-in-equations": _error("it is in no equation"),
    "unit-per-minute": _warning("{unit} beside a time is read as {unit} per minute"),
    "no-variance": _error("the first-order uncertainty is 0: no shares of variance"),
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
        "{what}: position beyond three times the travel of {axis} ({travel} mm){hint}",
        True,
    ),
    "unit-of-positions": _warning(
        "{component}: the positions span {span} of {travel} mm of {axis}; in {meant} they would "
        "cover it ({rows})",
        True,
    ),
    "copied-pass": _warning(
        "{component}: all readings are the same as those of pass {other} ({rows})", True
    ),
    "copied-component": _warning(
        "{component}: all readings are the same as those of {other} ({rows})", True
    ),
    "unit-of-pass": _warning(
        "{component}: pass {number} varies {ratio} times as much as the other passes: another "
        "unit? ({rows})",
        True,
    ),
    "mirrored-pass": _warning(
        "{component}: pass {number} has the opposite sign of all other passes ({rows})", True
    ),
    "outlying-reading": _warning(
        "{component}: {count} outlying, up to {off} {unit} off the others, whose s is {s} {unit} "
        "({rows})",
        True,
    ),
    "sensor-unit": _error("the temperatures are in {unit}, not degC ({rows})", True),
    "sensor-out-of-range": _error(
        "outside {low:g} to {high:g} degC: no temperature of a machine ({rows})", True
    ),
    "sensor-spike": _warning("{looks}, far off its neighbours ({rows})", True),
    "stuck-sensor": _warning(
        "the sensor is stuck at one value while others moved by {others} K ({rows})", True
    ),
    # Checks of points, parts and machines.
    "unit-of-points": _error("the points are typically {off} mm off: {looks} ({rows})", True),
    "far-from-nominal": _warning(
        "{what}: {off} mm from nominal, more than a machine errs: {looks} ({rows})", True
    ),
    "outlying-point": _warning(
        "{count} outlying in {axis}, up to {off} um off {beside}, whose s is {s} um ({rows})",
        True,
    ),
    "copied-points": _warning(
        "the same values to the last digit, more than chance explains: {names} ({rows})", True
    ),
    "on-nominal": _warning(
        "{what}: on the nominal to the last digit, as in the drawing ({rows})", True
    ),
    "names-alike": _warning("names that differ by case or blanks only: {names}", True),
    "features-alike": _warning("features at the same nominal place: {names}", True),
    "implausible-size": _warning("{what} is hardly meant; probably {meant}", True),
    # Measured parts.
    "one-part": _warning("one part only ({items}): {consequence}"),
    "few-parts": _warning("{parts} parts are too few to {purpose}: {needed} are needed"),
    "no-repeats": _warning("no part was measured twice ({items}): {consequence}"),
    "negative-variance": _warning(
        "the part-to-part variance is estimated below zero ({items}): 0 is used for uncertainties"
    ),
    "few-degrees-of-freedom": _warning(
        "fewer than 3 effective degrees of freedom behind {names}: use the 95 % interval, not u"
    ),
    "paper-method": _warning(
        "--method paper takes MS_between for the part-to-part variance, without an interval, and "
        "leaves it out of the uncertainties (Gilsinn & Ling 2004, eqs. (29)-(34))"
    ),
    "empty-cells": _warning(
        "{count} of {total} {items} are missing (first: part {part!r} at {label}); the rest is "
        "analysed with unequal counts"
    ),
    "not-measured": _warning("{names} left out: {reason}"),
    "incomplete-datum": _warning(
        "parts with missing features: the datum is fitted to the features they have"
    ),
    "set-up-dominates": _warning(
        "an offset (x {x_um:.3g}, y {y_um:.3g} um) and a rotation explain {percent} % of the mean "
        "errors{operation}: parts set up by hand? --datum offset,rotation removes it"
    ),
    "feature-scatters": _warning(
        "feature {feature} scatters from part to part far more than the others: {s} um, they "
        "{others} um ({p} among all features)"
    ),
    "axis-without-equation": _warning("the machine has no equation E{axis}: {consequence}"),
    "axis-not-measured": _warning("{what} have no {axis}_mm: {consequence}"),
    "length-without-z": _warning(
        "{names} run along z, which was not measured at every end: taken as free of error along z"
    ),
    "no-shared-axis": _error(
        "the machine {machine!r} has equations for {axes}, the points have {columns}"
    ),
    # Comparison and correction.
    "sign-turned": _warning(
        "with the other sign the prediction would explain {percent:.0f} % of the bias (sum of "
        "squares): an error is actual minus nominal"
    ),
    "not-tested": _warning("{what} not tested ({items}): {reason}"),
    "coarse-digit": _warning(
        "{columns} of the points are given to {digits_um} um, and u = {u_um:.2g} um is predicted: "
        "the digit hides the scatter of the parts"
    ),
    "covariate-overruled": _warning(
        "--at gives {names} one value for all points: the columns of the points are not used"
    ),
    "covariate-averaged": _warning(
        "{names} differs from part to part: what the model says of it is taken out of the measured "
        "parts, beyond its mean"
    ),
    "no-part": _warning("no part file: points are corrected, no circle or length is known"),
    "no-point-scatter": _warning(
        "u holds the machine model only: the scatter of the probing is unknown without repeats of "
        "{dof} degrees of freedom or a circle of 4 points"
    ),
    "calibrated-temperature-unknown": _warning(
        "the temperature of {name}, {temperature!r}, is neither a column of the points nor given "
        "by --at: the calibrated diameter{span} is taken as it is"
    ),
    "calibrated-far-from-measured": _warning(
        "{name} measures {measured_mm:.6g} mm on part {part!r} and is calibrated as "
        "{calibrated_mm:.6g} mm"
    ),
    "no-thermal-component": _warning(
        "the points are off the reference of {reference:.4g} degC ({sensor} reads {reading:.4g} "
        "degC{others}), but the model has no thermal component"
    ),
    "outside-measured-range": _warning(
        "{what} is outside the measured range of {names}, {low:g} to {high:g} {unit}: extrapolated"
    ),
    "position-fixed": _warning(
        "the machine fixes {axis} at {at_mm:g} mm; the part's {axis} is used for nominal lengths "
        "only"
    ),
    "undetermined": _error("no {kind} goes through {points} of {name}: {reason}"),
    "no-equation": _error("the machine {machine!r} has no equation E{axis}"),
    "nothing-to-predict": _error("the part has no {what} to predict"),
    # The model.
    "contradicts-report": _error("{name} is {reported} in the report"),
    "equation-undefined": _error("the equation E{axis} of {machine!r} has no finite value{where}"),
    "missing-covariate": _error("{owner} needs {names}"),
    "no-weight": _error(
        "the readings of {component!r} by {role} do not scatter: without weight beside the others"
    ),
    "times-contradict": _error(
        "{sensor} reads {first:g} and {second:g} degC at one time{where}, and the drift lags"
    ),
    "off-axis": _error("the {kind} of {entry!r} runs {degrees:.3g} degrees off {axis}"),
    "no-component": _error("no equation contains a component"),
    "settled-drift-impossible": _error(
        "--settled-drift: no shares of the sensors in the rise of {rise:g} degC give {component} "
        "the settled drift{where}"
    ),
    "datum-takes-all": _warning(
        "{count} of {total} points stand in measurements of so few features that the datum "
        "{datum!r} takes all of their errors: left out"
    ),
    "no-points-left": _error(
        "the datum {datum!r} takes all errors: no measurement has enough features"
    ),
    "nominals-differ": _warning(
        "{names}: more than one nominal place; each error is taken at its own ({rows})", True
    ),
    "axis-left-out": _warning("{axis}_mm is left out: not every point has it with a nominal"),
    "covariate-gaps": _warning("empty cells in {names}: {consequence}"),
    "covariate-is-text": _warning("text, not numbers: no effect of {names} can be tested"),
    "covariate-is-error": _warning("{names} repeat {what}: not tested as effects"),
    "covariate-of-the-points": _warning("the points' column {name!r} is used, not --at {name}"),
    "settled-temperatures": _warning(
        "the drift of {components} follows its temperatures with lags of up to {minutes:g} min: "
        "without a history they count as settled"
    ),
    "sensor-still": _warning("{sensor} stands still{where}: {consequence}"),
    "effect-range-unknown": _warning("the data of {effects} have {covariate} {range}: {reason}"),
    "outside-effect-range": _warning(
        "the data of {effects} have {covariate} {range}: extrapolated to {at}"
    ),
    "effects-not-used": _warning("{report} has effects that {machine} has not: {names} not used"),
    "effects-differ": _warning(
        "{report} gives other values than {machine} for {names}: those of the report are used"
    ),
    "effect-not-separable": _warning(
        "the data of effects[{index}] ({effect}) do not separate it from {others}: elsewhere each "
        "predicts other errors, and u is that of this one"
    ),
    "searched-not-told": _warning(
        "the {what} of effects[{index}] ({effect}) is one of {fits} that fit alike at its {where}: "
        "it holds at those {where} alone"
    ),
    "effect-not-removed": _warning(
        "the effect {effect} is not subtracted from the readings of {component}: {reason}"
    ),
    "not-used": _warning(
        "the {what} of {names} are not used: {by}, or the report of their fit, replace them"
    ),
    "pass-drift-not-separated": _warning(
        "the readings of {names} do not separate the scatter from pass to pass from repeatability "
        "(one pass, or no column `pass`): all of it counts as repeatability"
    ),
    "one-run": _warning(
        "the readings of {names} are of one run there and back: what scatters from run to run is "
        "not seen"
    ),
    "no-scatter": _warning("the {what} of {names} do not scatter: their uncertainty counts as 0"),
    "readings-small": _warning(
        "{component} repeats to {s:.2g} {unit}, the other {kind} typically to {others:.2g} {unit}: "
        "the errors are probably in {meant_unit}",
        True,
    ),
    "reversal": _warning(
        "{component} reverses by {size:.2g} {unit} (p = {p:.1g}): predictions are for the mean of "
        "both directions{leaning}; a feature approached from one side is off by half of it"
    ),
    "passes-drift": _warning(
        "{component} drifts by {size:.2g} {unit} {each} (p = {p:.1g}): its passes are not "
        "exchangeable, the next part may lie beyond them"
    ),
    "lack-of-fit": _warning(
        "{component} is not a polynomial of the degree that the machine file gives (p = {p:.1g}): "
        "{advice}"
    ),
    "instruments-disagree": _warning(
        "the instruments disagree on {component} (p = {p:.2g}): u of the combined line is too small"
    ),
    "passes-cut": _warning(
        "the passes of {names} differ by less than their repeatability explains: what is simulated "
        "scatters more than is predicted"
    ),
    "grid-of-fewer-axes": _warning("--grid {grid}: {reason}"),
    # Thermal models.
    "collinear": _warning(
        "{component}: the sensors move together (condition number {condition:.0f}): single "
        "coefficients are not interpretable"
    ),
    "one-position": _warning(
        "{component}: the drift was read at {position_mm:g} mm only: that it is the same all along "
        "{axis} is assumed, not tested"
    ),
    "no-sensor": _warning("{component}: no sensor explains the drift{reason}"),
    "rows-out-of-order": _warning(
        "{component}: readings of one cycle are not in the order of their times, and too many to "
        "be sorted: their autocorrelation is that of the file"
    ),
    "cycle-in-two-files": _warning(
        "{component}: {cycle} is in {files} and counts as one warm-up or cool-down"
    ),
    "no-lags": _warning("{component}: no lags in the model: {reason}"),
    "reference-not-read": _warning(
        "{component}: the sensors were read from {low:.4g} to {high:.4g} degC, not at the "
        "reference of {reference:g} degC: predictions extrapolate from there"
    ),
    "not-held-out": _warning(
        "{component}: {cycles}: no cycle can be held out, and the rms of the fit says little of "
        "the next warm-up"
    ),
    "over-fit": _warning(
        "{component}: rms {fitted} on the cycles of the fit, {held_out} on held-out ones"
    ),
    "no-better": _warning(
        "{component}: on held-out cycles the temperatures {effect}: the model is not to be used"
    ),
    "cycles-begin-apart": _warning(
        "{component}{where}: the cycles begin up to {apart} apart at the same temperatures: was "
        "the probe set anew? count the readings of each cycle from its first"
    ),
}
