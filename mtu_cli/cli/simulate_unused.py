"""Options of `mtu simulate` that act only beside another one: alone they would say nothing."""

from __future__ import annotations

from collections.abc import Iterator

from mtu_cli.cli.options import Options
from mtu_cli.cli.simulate_ranges import option_name
from mtu_cli.errors import InputError, Problem, Warned
from mtu_cli.findings import Finding

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
    problems = [problem for name, problem in found if name not in PLAN]
    if problems:
        raise InputError(problems)
    return [Warned(code="option-not-used", message=str(problem)) for _, problem in found]


def _unused(options: Options) -> Iterator[tuple[str, Finding]]:
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
                what = f"{option_name(name)} changes nothing in what is written"
                shown = _shown(options.values[name])
                yield name, Problem(what=what, value=shown, expected=expected)


def _shown(value: object) -> str | None:
    """The option's value as it was given; of several the first; nothing of a mere flag."""
    first = value[0] if isinstance(value, list) else value
    return None if isinstance(first, bool) else str(first)
