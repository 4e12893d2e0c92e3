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
    "not-a-temperature-name": _error("not the name of a temperature"),
    # Of rooms whose sentences still stand where the faults are found.
    "fault": _error("{what}"),
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
    "unknown-key": _error("unknown key"),
    "no-value": _error("no value"),
    "wrong-value": _error("wrong value"),
    "unknown-value": _error("unknown value"),
    "unknown-name": _error("unknown {what}"),
    "unknown-unit": _error("unknown unit"),
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
    "unknown-function": _error("unknown function '{name}'"),
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
    "not-an-input": _error("'{name}' is not an input of this transition"),
    "no-such-coordinate": _error("a {kind} has no coordinate '{name}'"),
    # YAML contracts.
    "keys-exclude": _error("{keys} are given together"),
    "key-needs": _error("`{key}` without {other}"),
    "key-elsewhere": _error("`{key}` belongs to {where}"),
    "number-extreme": _error("the number is too large or too small to calculate with"),
    "named-twice": _error("'{name}' stands twice"),
    # Budgets.
    "no-limits": _error("a {distribution} distribution has no limits"),
    "correlated-constant": _error("'{name}' is correlated, but it has no uncertainty"),
    "unequal-counts": _error("readings that are taken together are not equally many: {counts}"),
    "unused-input": _warning("in no equation"),
    "equal-readings": _warning(
        "all {n} readings are equal, so that u is 0; add the resolution r as half_width: r/2 "
        "with distribution: rectangular (JCGM 100, F.2.2.1)"
    ),
    "taken-as-exact": _warning(
        "without an uncertainty {names} are taken as exact; write u: 0 for a constant"
    ),
    "unit-not-checked": _warning("no unit of {names} is known: no term with them is checked"),
    # The machine.
    "unused-component": _warning("the component '{component}' is in no equation"),
    # Calls.
    "unknown-option": _error("{command} has no {option}"),
    "unknown-command": _error("unknown command"),
    "option-without-value": _error("{option} has no value"),
    "option-takes-no-value": _error("{option} takes no value"),
    "option-form": _error("not {form}"),
    "option-without-effect": _error("changes nothing in what is written"),
    "option-not-used": _warning("changes nothing in what is written"),
    "missing-argument": _error("{command} needs {argument}"),
    "extra-argument": _error("{command} takes no further argument"),
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
    "names-a-folder": _error("names a folder"),
    "wrong-ending": _error("{option} writes {kind}"),
    "standard-output": _error("{option} cannot go to standard output"),
    "input-overwritten": _error("is an input of {owner} and is not overwritten"),
    "data-overwritten": _error("does not begin with '{mark}': measured data is not overwritten"),
    "grid-without-map": _error("no map can be drawn of this grid"),
    # Simulation.
    "no-thermal-model": _error("no component of the equations has a thermal model"),
    "no-extent": _error("the part does not extend along {axis}"),
    "effect-too-large": _warning(
        "{equation} is {value_mm:.3g} mm in part {part} at feature '{feature}', more than a "
        "machine errs by"
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
        "the tolerance of JCGM 101, clause 8 (up to {difference})"
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
    "not-writable": _error("an effect cannot be written into {machine}: {reason}"),
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
    "made-twice": _error("a transition makes it already (line {line_of})"),
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
    "unused-parameter": _warning("the parameter '{parameter}' is in no equation"),
    "unit-per-minute": _warning("{unit} beside a time is read as {unit} per minute"),
    "no-variance": _error("the first-order uncertainty is 0: no shares of variance"),
    "given-twice": _error("given more than once"),
    # Checks of readings and sensors.
    "distances-not-errors": _error(
        "{component}: the errors are distances that follow the position (rows {rows}): subtract "
        "the position",
        True,
    ),
    "swapped-columns": _error(
        "{component}: the same errors in every pass at other positions: position_mm and error "
        "are swapped (rows {rows})",
        True,
    ),
    "unit-of-errors": _error(
        "errors of up to {size} {unit} are those of no machine; the unit is probably {meant} "
        "(rows {rows})",
        True,
    ),
    "position-beyond-travel": _error(
        "{component}: position beyond three times the travel of {axis} ({travel} mm){hint} "
        "(rows {rows})",
        True,
    ),
    "unit-of-positions": _warning(
        "{component}: the positions span {span} of {travel} mm of {axis}; in {meant} they would "
        "cover it (rows {rows})",
        True,
    ),
    "copied-pass": _warning(
        "{component}: all readings are the same as those of pass {other} (rows {rows})", True
    ),
    "copied-component": _warning(
        "{component}: all readings are the same as those of {other} (rows {rows})", True
    ),
    "unit-of-pass": _warning(
        "{component}: pass {number} varies {ratio} times as much as the other passes: another "
        "unit? (rows {rows})",
        True,
    ),
    "mirrored-pass": _warning(
        "{component}: pass {number} has the opposite sign of all other passes (rows {rows})", True
    ),
    "outlying-reading": _warning(
        "{component}: {count} outlying, up to {off} {unit} off the others, whose s is {s} {unit} "
        "(rows {rows})",
        True,
    ),
    "sensor-unit": _error("the temperatures are in {unit}, not degC (rows {rows})", True),
    "sensor-out-of-range": _error(
        "outside {low:g} to {high:g} degC: no temperature of a machine (rows {rows})", True
    ),
    "sensor-spike": _warning("{looks}, far off its neighbours (rows {rows})", True),
    "stuck-sensor": _warning(
        "the sensor is stuck at one value while others moved by {others} K (rows {rows})", True
    ),
}
