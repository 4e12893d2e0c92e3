"""Which numbers `mtu simulate` takes: all its options at once, in the words of every command."""

from __future__ import annotations

from mtu_cli.cli.options import Options
from mtu_cli.findings import Finding, InputError, finding

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


def option_name(name: str) -> str:
    """The option of a parameter: --sensor-noise-degC of sensor_noise_degc."""
    return f"--{name.replace('_', '-')}".replace("degc", "degC")


def _problem(option: str, value: float, expected: str) -> Finding:
    return finding("out-of-range", path=option, value=str(value), expected=expected)
