"""Options of `mtu simulate` that are out of range, change nothing, or are in another unit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mtu_cli.cli.option_values import option_name
from mtu_cli.cli.options import Options
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.language import Node
from mtu_cli.model.effect_ranges import LARGE_MM, STEEP
from mtu_cli.model.simulate import PartsPlan, SimulatedPoints
from mtu_cli.model.simulate_equations import Visits, error_values
from mtu_cli.stats.least_squares import FloatArray

MOST = 1e9
"""Of any number: a slip of the keyboard beyond."""
MOST_CYCLES = 1000

_COUNTS = {"passes": 1, "parts": 1, "repeats": 1, "reverse_every": 0, "cycles": 1}
_MOST = {"cycles": MOST_CYCLES}
_POSITIVE = ("interval_min",)
_NUMBERS = (
    "cmm_u_um", "part_offset_um", "minutes", "cycle_minutes", "soak_minutes", "interval_min",
    "room_lag_min", "room_wobble_degc", "sensor_wobble_degc", "sensor_noise_degc",
    "sensor_spread", "reading_noise_um", "reading_noise_arcsec", "cmm_wobble_degc",
    "most_drift_um", "most_drift_arcsec",
)  # fmt: skip


def check_ranges(options: Options, seed: int) -> None:
    """Raises InputError with every number that is out of range, and for a text that no reader
    of the files would take.
    """
    problems = [] if seed >= 0 else [_problem("--seed", seed, "0 or more")]
    for name, least in _COUNTS.items():
        count, most = options.values[name], _MOST.get(name, MOST)
        if not least <= count <= most:
            expected = f"a whole number of {least} or more, at most {most:g}"
            problems.append(_problem(option_name(name), count, expected))
    for name in _NUMBERS:
        value, positive = options.values[name], name in _POSITIVE
        if not 0 <= value <= MOST or (positive and value == 0):
            expected = f"a number {'above 0' if positive else 'of 0 or more'}, at most {MOST:g}"
            problems.append(_problem(option_name(name), value, expected))
    operation = options.values["operation"]
    if operation is not None and (not operation.strip() or not operation.isprintable()):
        expected = "a name on one line, such as drilled, or no --operation at all"
        problems.append(
            finding("not-printable", path="--operation", value=operation, expected=expected)
        )
    if problems:
        raise InputError(problems)


def _problem(option: str, value: float, expected: str) -> Finding:
    return finding("out-of-range", path=option, value=str(value), expected=expected)


READINGS = ("passes", "one_way", "positions")
POINTS = (
    "parts", "repeats", "cmm_u_um", "part_offset_um", "reverse_every", "minutes", "first_repeats",
    "operation", "scatter", "effect", "covariate",
)  # fmt: skip
CLIMATE = (
    "room", "sensor_lag_min", "sensor_spread", "sensor_wobble_degc", "sensor_noise_degc",
    "drift_positions", "settled_drift", "most_drift_um", "most_drift_arcsec", "twin",
)  # fmt: skip
DRIFT_TEST = (
    "cycles", "cycle_minutes", "soak_minutes", "interval_min", "room_lag_min",
    "room_wobble_degc", "reading_noise_um", "reading_noise_arcsec",
)  # fmt: skip
MEASURED_ROOM = ("cmm_wobble_degc",)
PLAN = (*READINGS, "parts", "repeats")
"""How, and how often, readings and parts are taken, which a script gives to all its calls, whatever
each one writes: told, not refused. What it takes for an error of the machine is refused.
"""


def check_used(options: Options) -> list[Finding]:
    """Warnings of a plan of what is not written.

    Raises InputError with every other given option that changes nothing.
    """
    found = list(_unused(options))
    problems = [item for item in found if item.severity == "error"]
    if problems:
        raise InputError(problems)
    return found


def _unused(options: Options) -> Iterator[Finding]:
    readings, points, drift = (
        getattr(options, name) is not None for name in ("write_lbb", "write_cmm", "write_drift")
    )
    room = points and bool(options.cmm_room)
    groups = (
        (READINGS, readings, "--write-lbb FILE beside it"),
        (POINTS, points, "--write-cmm FILE beside it"),
        (MEASURED_ROOM, room, "--write-cmm FILE and --cmm-room DEGC beside it"),
        (CLIMATE, drift or room, "--write-drift FILE, or --write-cmm FILE and --cmm-room DEGC"),
        (DRIFT_TEST, drift, "--write-drift FILE beside it"),
    )
    for names, used, expected in groups:
        for name in names:
            if not used and name in options.given:
                code = "option-not-used" if name in PLAN else "option-without-effect"
                shown = _shown(options.values[name])
                yield finding(code, path=option_name(name), value=shown, expected=expected)


def _shown(value: object) -> str | None:
    """The option's value as it was given; of several the first; nothing of a mere flag."""
    first = value[0] if isinstance(value, list) else value
    return None if isinstance(first, bool) else str(first)


def large_warnings(
    plan: PartsPlan, found: SimulatedPoints, ids: Sequence[str], points: FloatArray
) -> list[Finding]:
    """Asks for the unit of every --effect and --scatter that is above `LARGE_MM` at some feature,
    and above `STEEP` of how far apart the features `ids` at `points` (n, 3) mm are.
    """
    once = found.repeat == 1
    rank = {name: i for i, name in enumerate(ids)}
    code = np.array([rank[name] for name in found.feature])[once]
    visits = Visits(
        part=1,
        ids=[ids[i] for i in code],
        points=points[code],
        values={name: values[once] for name, values in found.covariates.items()},
    )
    known = np.nan_to_num(points)
    moved = float(max(np.abs(known).max(), np.ptp(known, axis=0).max()))
    parts = np.array(found.part)[once]
    warnings = []
    for option, equations in (("--effect", plan.effects), ("--scatter", plan.scatter)):
        for axis, node in equations:
            largest, row = _largest(f"{option} E{axis}", node, visits)
            if abs(largest) > max(LARGE_MM, STEEP * moved):
                warnings.append(
                    finding(
                        "effect-too-large",
                        effect=f"{option} E{axis}",
                        value_mm=largest,
                        where=f" in part {parts[row]} at feature {visits.ids[row]!r}",
                        expected="mm, 0.003 for 3 um",
                    )
                )
    return warnings


def _largest(option: str, node: Node, visits: Visits) -> tuple[float, int]:
    """The value of largest size, mm, and its row."""
    values = error_values(option, node, visits)
    row = int(np.argmax(np.abs(values)))
    return float(values[row]), row
