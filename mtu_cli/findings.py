"""What is wrong or odd about an input: one form for every file, check and command.

A `Finding` is one entry of the `CATALOGUE` (code, severity, sentence) with the place where it
stands and the facts of the case, which the braces of its sentence name. File, row, column, value
and expectation are put around the sentence by `Finding.message`. What a code means, why it matters
and what to do stands in ``help/findings.md``. Errors travel in an `InputError`, all of a file at
once; warnings and notes travel in results.
"""

from __future__ import annotations

import difflib
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from string import Formatter
from typing import Any, Literal

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of finding; a `suspicious` one is of the checks and meets --fail-if suspicious."""

    severity: Severity
    template: str
    suspicious: bool = False


_error, _warning, _note = partial(Kind, "error"), partial(Kind, "warning"), partial(Kind, "note")
_impossible, _odd = partial(_error, suspicious=True), partial(_warning, suspicious=True)

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
    # Measurement graphs and effects.
    "graph-cycle": _error("a cycle: {places}"),
    "unused-place": _error("{reason}"),
    "wrong-connection": _error("{do} does not {verb} {places}"),
    # Checks of readings and sensors.
    "distances-not-errors": _impossible(
        "{component}: the errors are distances that follow the position ({rows}): subtract "
        "the position"
    ),
    "swapped-columns": _impossible(
        "{component}: the same errors in every pass at other positions: position_mm and error "
        "are swapped ({rows})"
    ),
    "unit-of-errors": _impossible(
        "errors of up to {size} {unit} are those of no machine; the unit is probably {meant} "
        "({rows})"
    ),
    "position-beyond-travel": _impossible(
        "beyond three times the travel of {axis} ({travel} mm){hint}"
    ),
    "unit-of-positions": _odd(
        "positions of {names} are within a twentieth of the travel of {axis} ({travel} mm)"
        "{hint} ({rows})"
    ),
    "copied-values": _odd(
        "the same values to the last digit, more than chance explains: {names} ({rows})"
    ),
    "unlike-pass": _odd("{component}: pass {number} {how} ({rows})"),
    "outlying-value": _odd(
        "{what}: {count} outlying, up to {off} {unit} off {beside}, whose s is {s} {unit} ({rows})"
    ),
    "sensor-unit": _impossible("the temperatures are in {unit}, not degC ({rows})"),
    "sensor-out-of-range": _impossible(
        "outside {low:g} to {high:g} degC: no temperature of a machine"
    ),
    "sensor-spike": _odd(
        "a spike of the sensor, or its code for no reading: far off its neighbours ({rows})"
    ),
    "stuck-sensor": _odd(
        "the sensor is stuck at one value while others moved by {others} K ({rows})"
    ),
    # Checks of points, parts and machines.
    "unit-of-points": _impossible("the points are typically {off} mm off: {looks} ({rows})"),
    "far-from-nominal": _odd(
        "{what}: {off} mm from nominal, more than a machine errs: {looks} ({rows})"
    ),
    "implausible-size": _odd("{what} is hardly meant; probably {meant}"),
    "alike": _odd("{what}: {names}"),
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
    "effect-not-written": _warning("{effect} is not added to the machine: {reason}"),
    "written-class": _warning("of effects that this data cannot separate one is written: {names}"),
    # Comparison and correction.
    "not-tested": _warning("{what} not tested ({items}): {reason}"),
    "outside-measured-range": _warning(
        "{what} is outside the measured range of {names}, {low:g} to {high:g} {unit}: extrapolated"
    ),
    # The model.
    "nominals-differ": _odd(
        "{names}: more than one nominal place; each error is taken at its own ({rows})"
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


EXIT_INPUT = 2
EXIT_GATE = 3

SUSPICIOUS = "suspicious"
"""The gate of every command that reads data: a warning of the checks meets it."""
MOST_SHOWN = 20
"""Findings of an error that are shown; the rest is counted."""
SHOWN_RUNS = 6
"""Runs of rows that a finding names."""
MOST_ALIKE = 20
"""Warnings of one code that are shown."""
SHOWN_NAMES = 6
LONGEST_VALUE = 60
LONGEST_NAME = 200
LONGEST_TEXT = 500


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One finding: a `code` of the catalogue, its place, and the facts that its template names.

    `line` is a line of a YAML file, `row` a row of a CSV file, both counted as a text editor does;
    `path` a place inside a document (``components.dx_x.unit``); `column` the name of a CSV column,
    or the character of an equation counted from 1. `value` is what stands there, `expected` what
    should, `meant` the known names that are nearest to it.
    """

    code: str
    facts: Mapping[str, Any] = field(default_factory=dict)
    file: str | None = None
    line: int | None = None
    row: int | None = None
    column: str | int | None = None
    path: str | None = None
    value: str | None = None
    expected: str | None = None
    meant: tuple[str, ...] = ()

    @property
    def kind(self) -> Kind:
        """Its entry of the catalogue."""
        return CATALOGUE[self.code]

    @property
    def severity(self) -> Severity:
        """``error``, ``warning`` or ``note``."""
        return self.kind.severity

    @property
    def text(self) -> str:
        """What is wrong, without its place.

        >>> Finding(code="unused", facts={"what": "component", "name": "dx_x"}).text
        "the component 'dx_x' is in no equation"
        """
        return _WORDS.vformat(self.kind.template, (), self.facts)

    @property
    def message(self) -> str:
        """The whole sentence: place, text, value, expectation.

        >>> print(Finding(code="wrong-type", facts={"kind": "a number"}, file="a.csv", row=3,
        ...               column="error", value="1.2.3", expected="a number").message)
        a.csv, row 3, column 'error': not a number: '1.2.3'; expected a number
        """
        return self._sentence([] if self.row is None else [self.row])

    def _sentence(self, rows: Sequence[int]) -> str:
        """The sentence of this finding in each of the `rows`."""
        text = self.text
        if isinstance(self.column, int):
            text += f" at column {self.column}"
        if self.path:
            text = f"{shorten(self.path, LONGEST_NAME)}: {text}"
        steps = [shorten(self.file, LONGEST_NAME)] if self.file else []
        if self.line is not None:
            steps = [f"{steps[0]}:{self.line}" if steps else f"line {self.line}"]
        steps += [f"row{'s' * (len(rows) > 1)} {runs(rows)}"] if rows else []
        if isinstance(self.column, str):
            steps.append(f"column {shorten(self.column)!r}")
        text = f"{', '.join(steps)}: {text}" if steps else text
        if self.value is not None:
            text += f": {shorten(self.value)!r}"
        if self.meant:
            text += f"; did you mean {' or '.join(map(repr, self.meant))}?"
        elif self.expected:
            text += f"; expected {shorten(self.expected, LONGEST_TEXT)}"
        return printable(text)

    def __str__(self) -> str:
        return self.message

    def __hash__(self) -> int:
        return hash((self.code, self.file, self.line, self.row, self.column, self.value))

    def at(self, **place: Any) -> Finding:
        """The same finding with the missing parts of its place (file, line, row, column, path)."""
        missing = {name: x for name, x in place.items() if getattr(self, name) in (None, ())}
        return replace(self, **missing)

    def to_dict(self) -> dict[str, Any]:
        """As reports list it: `file`, `line`, `row` and `column` where they apply."""
        result = {"code": self.code, "severity": self.severity, "message": self.message}
        place = {"file": self.file, "line": self.line, "row": self.row, "column": self.column}
        stated = {name: x for name, x in place.items() if x is not None}
        return {**result, "facts": plain(self.facts), **stated}


class InputError(Exception):
    """The input or the call is at fault (exit code 2, no traceback); carries every finding.

    `uncounted`: how many more there are that were not listed, such as the bad cells of a file
    beyond the first thousands.
    """

    def __init__(self, findings: Finding | Iterable[Finding], uncounted: int = 0) -> None:
        items = [findings] if isinstance(findings, Finding) else list(findings)
        # Those of one file by line or row, files in the order in which they come.
        files = {name: i for i, name in enumerate(dict.fromkeys(each.file for each in items))}
        items.sort(key=lambda each: (files[each.file], each.line or 0, each.row or 0))
        self.findings = tuple(items)
        self.uncounted = uncounted
        super().__init__(str(self))

    def __str__(self) -> str:
        # One line for findings that differ in the row only, as of a column in another unit.
        groups: dict[Finding, list[int | None]] = {}
        for each in self.findings:
            groups.setdefault(replace(each, row=None), []).append(each.row)
        first = [*groups.items()][:MOST_SHOWN]
        rest = len(self.findings) + self.uncounted - sum(len(rows) for _, rows in first)
        lines = [each._sentence([n for n in rows if n is not None]) for each, rows in first]
        return "\n".join([*lines, *([f"... and {rest} more"] if rest else [])])


@contextmanager
def located(**place: Any) -> Iterator[None]:
    """Raises the InputError of its block with the missing parts of each finding's place."""
    try:
        yield
    except InputError as fault:
        findings = (each.at(**place) for each in fault.findings)
        raise InputError(findings, fault.uncounted) from None


@contextmanager
def collected(add: Callable[[Finding], None]) -> Iterator[None]:
    """Adds what an InputError of its block has found, and leaves out what follows there."""
    try:
        yield
    except InputError as fault:
        for each in fault.findings:
            add(each)


def error(code: str, **place_and_facts: Any) -> InputError:
    """An InputError of one finding; names that are no fields of a Finding are its facts.

    >>> print(error("no-such-file", file="a.csv", meant=("b.csv",)))
    a.csv: no such file; did you mean 'b.csv'?
    """
    return InputError(finding(code, **place_and_facts))


def finding(code: str, **place_and_facts: Any) -> Finding:
    """A Finding from its place and its facts, both by name."""
    fields = Finding.__dataclass_fields__
    place = {name: value for name, value in place_and_facts.items() if name in fields}
    facts = {name: value for name, value in place_and_facts.items() if name not in fields}
    return Finding(code=code, **{**place, "facts": {**facts, **place.get("facts", {})}})


def warning_lines(warnings: Iterable[Finding]) -> list[str]:
    """Warnings and notes as lines for standard error, each once, of one code MOST_ALIKE at most."""
    distinct = {(each.code, each.message): each for each in warnings}.values()
    count, ordinal, lines = Counter(each.code for each in distinct), Counter[str](), []
    for each in distinct:
        ordinal[each.code] += 1
        rest, more = count[each.code] - MOST_ALIKE, ""
        if ordinal[each.code] == MOST_ALIKE and rest > 0:
            more = f"; and {rest} more such, all in the report (-o)"
        if ordinal[each.code] <= MOST_ALIKE:
            lines.append(f"{each.severity}: {each.message}{more} [{each.code}]")
    return lines


def runs(numbers: Sequence[int]) -> str:
    """Whole numbers as runs.

    >>> runs([3, 4, 5, 9])
    '3 to 5, 9'
    """
    values = sorted(set(numbers))
    starts = [i for i, n in enumerate(values) if i == 0 or n != values[i - 1] + 1]
    spans = [values[a:b] for a, b in pairwise([*starts, len(values)])]
    texts = [f"{run[0]} to {run[-1]}" if len(run) > 1 else f"{run[0]}" for run in spans]
    more = f" and {sum(map(len, spans[SHOWN_RUNS:]))} more" if len(spans) > SHOWN_RUNS else ""
    return ", ".join(texts[:SHOWN_RUNS]) + more


def listed(names: Iterable[object], most: int = SHOWN_NAMES, between: str = ", ") -> str:
    """Names for a sentence: the first few and how many more.

    >>> listed("abcdefgh", 3)
    'a, b, c and 5 more'
    """
    texts = list(dict.fromkeys(map(str, names)))
    more = f" and {len(texts) - most} more" if len(texts) > most else ""
    return between.join(texts[:most]) + more


def counted(number: int, noun: str, several: str = "") -> str:
    """``1 row``, ``2 rows``; ``1 entry``, and of `several` ``2 entries``."""
    return f"{number} {noun}" if number == 1 else f"{number} {several or noun + 's'}"


def nearest(name: str, names: Iterable[str]) -> tuple[str, ...]:
    """The known name that `name` was probably meant to be, if there is one: the only one that goes
    on behind it, with a unit say, else the closest.

    >>> nearest("coverge_factor", ["seed", "coverage_factor"])
    ('coverage_factor',)
    >>> nearest("device_U", ["device_U_um_per_m", "device"])
    ('device_U_um_per_m',)
    """
    words = {str(x).casefold(): str(x) for x in names if len(str(x)) <= LONGEST_NAME}
    key = name.casefold()[:LONGEST_NAME]
    longer = [each for each in words if key and each.startswith(f"{key}_")]
    near = longer if len(longer) == 1 else difflib.get_close_matches(key, words, 1, 0.65)
    return tuple(words[each] for each in near)


def suggestion(name: str, names: Iterable[str]) -> dict[str, Any]:
    """Facts of a Finding of an unknown name: `meant`, the nearest names, else `expected`, all."""
    choices = list(names)
    if near := nearest(name, choices):
        return {"meant": near}
    text = ", ".join(map(shorten, choices[:12])) + (", ..." if len(choices) > 12 else "")
    return {"expected": f"one of: {text}" if choices else "no such name: none is known here"}


def shorten(text: str, width: int = LONGEST_VALUE) -> str:
    """Text cut to `width` characters, so that one message stays one line."""
    return text if len(text) <= width else text[: width - 3] + "..."


def printable(text: str) -> str:
    """Text in which control characters (of a file name, say) are escaped: no terminal obeys it."""
    return "".join(x if x.isprintable() else x.encode("unicode_escape").decode() for x in text)


def plain(value: Any) -> Any:
    """The value in types of JSON: lists for arrays, None for what is not finite, or its text."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, Mapping):
        return {str(name): plain(each) for name, each in value.items()}
    if hasattr(value, "tolist"):  # numbers and arrays of numpy, which is not imported here
        finite = value.dtype.kind == "f" and math.isfinite(abs(value).max(initial=0.0))
        return value.tolist() if finite else plain(value.tolist())
    return [plain(each) for each in value] if isinstance(value, Iterable) else str(value)


class _Words(Formatter):
    """Facts in a sentence: names are listed, whole numbers are rows, floats have four digits."""

    def format_field(self, value: Any, format_spec: str) -> Any:
        if isinstance(value, tuple) and value and all(isinstance(each, int) for each in value):
            return f"row{'s' if len(value) > 1 else ''} {runs(value)}"
        if isinstance(value, (list, tuple, set, frozenset)):
            return listed(sorted(value) if isinstance(value, (set, frozenset)) else value)
        if isinstance(value, float) and not format_spec:
            return f"{value:.4g}"
        return format(
            shorten(value, LONGEST_TEXT) if isinstance(value, str) else value, format_spec
        )


_WORDS = _Words()
