"""Options of `mtu simulate` that act only beside another one."""

from __future__ import annotations

from collections.abc import Iterator

from mtu_cli.cli.options import Options
from mtu_cli.cli.simulate_ranges import option_name
from mtu_cli.findings import Finding, InputError, finding

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
