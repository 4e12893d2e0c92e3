"""The drift test and the sensors of `mtu simulate`, from its options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.option_values import no_number
from mtu_cli.cli.options import Options
from mtu_cli.cli.simulate_checks import MOST
from mtu_cli.cli.simulate_options import by_component, read_at
from mtu_cli.files.covariates import is_covariate
from mtu_cli.findings import InputError, error, suggestion
from mtu_cli.model.calibrated_places import growth
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.simulate import SimulatedPoints
from mtu_cli.model.simulate_drift import Climate, DriftPlan, as_read, sensors_for, settled
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import ANGLE, ARCSEC, LENGTH, UM, UNITS

ROOMS_DEGC = (-50.0, 200.0)
"""Rooms that a machine may stand in: a slip of the keyboard beyond."""
MAX_MOMENTS = 1_000_000
"""Moments of a whole test, soaking included: a slip of the keyboard beyond."""


def drifting(inputs: Inputs, model: MachineModel) -> tuple[ThermalEstimate, ...]:
    """The machine's thermal models.

    Raises InputError where it has none.
    """
    drifts = model.drifts()
    if not drifts:
        raise error(
            "no-thermal-model",
            file=inputs.machine.source.shown,
            expected="a `thermal` key in a component of the equations",
        )
    return drifts


def drift_plan(inputs: Inputs, drifts: tuple[ThermalEstimate, ...]) -> DriftPlan:
    """The drift test that the options ask for.

    Raises InputError for options that are out of range or of unknown components.
    """
    options = inputs.options
    machine = inputs.machine
    names = [drift.component for drift in drifts]
    low, high = _pair("--room", options.room, "20:26", (-np.inf, np.inf))
    check_rooms("--room", [low, high], options.room)
    check_rooms("--cmm-room", options.cmm_room or [])
    positions = read_at(options, machine, drifts)
    asked = by_component("--settled-drift", options.settled_drift, names)
    for name, values in asked.items():
        if len(values) != len(positions[name]):
            raise error(
                "option-form",
                path=f"--settled-drift {name}",
                form="one value a position",
                value=f"{len(values)} values",
                expected=f"{len(positions[name])}",
            )
    factors = {name: UNITS[machine.machine.components[name].unit].to_internal for name in names}
    plan = DriftPlan(
        climate=_climate(options, machine.machine.reference_temperature_degC, low, high),
        cycles=options.cycles,
        minutes=options.cycle_minutes,
        interval=options.interval_min,
        soak=options.soak_minutes,
        positions=positions,
        noise={
            LENGTH: options.reading_noise_um * UM,
            ANGLE: options.reading_noise_arcsec * ARCSEC,
        },
        settled={name: values * factors[name] for name, values in asked.items()},
        limits={LENGTH: options.most_drift_um * UM, ANGLE: options.most_drift_arcsec * ARCSEC},
        twins=_twins(options, {sensor for drift in drifts for sensor in drift.sensors}),
    )
    moments = plan.cycles * (plan.minutes + plan.soak) / plan.interval
    if moments > MAX_MOMENTS:
        raise error(
            "out-of-range",
            path="--cycles, --interval-min",
            value=f"{moments:g} moments",
            expected=f"at most {MAX_MOMENTS}",
        )
    return plan


def _climate(options: Options, reference: float, low: float, high: float) -> Climate:
    return Climate(
        reference=reference,
        low=low,
        high=high,
        room_lag=options.room_lag_min,
        room_wobble=options.room_wobble_degc,
        sensor_lag=_pair("--sensor-lag-min", options.sensor_lag_min, "5:25", (0.0, MOST)),
        sensor_spread=options.sensor_spread,
        sensor_wobble=options.sensor_wobble_degc,
        sensor_noise=options.sensor_noise_degc,
    )


def check_rooms(option: str, rooms: Sequence[float], text: str = "") -> None:
    """Refuses temperatures that no machine stands in.

    Raises InputError with the option."""
    low, high = ROOMS_DEGC
    for room in rooms:
        if not low <= room <= high:
            raise error(
                "out-of-range",
                path=option,
                value=text or f"{room:g}",
                expected=f"from {low:g} to {high:g} degC",
            )


def check_cmm_room(options: Options) -> None:
    """Refuses rooms of a measurement that is not written.

    Raises InputError for --cmm-room without --write-cmm.
    """
    if options.cmm_room and options.write_cmm is None:
        raise error(
            "option-without-effect",
            path="--cmm-room",
            value=" ".join(f"{room:g}" for room in options.cmm_room),
            expected="--write-cmm FILE beside it, or --room LOW:HIGH of the drift test",
        )


def _pair(option: str, text: str, example: str, bounds: tuple[float, float]) -> tuple[float, float]:
    ends = text.split(":")
    if len(ends) != 2 or not all(end.strip() for end in ends):
        raise error(
            "option-form", path=option, form="LOW:HIGH", value=text, expected=f"{example}, say"
        )
    for end in ends:
        if bad := no_number(option, end):
            raise InputError(bad)
    low, high = map(float, ends)
    if low > high:
        raise error("out-of-range", path=option, value=text, expected="LOW below HIGH")
    if not bounds[0] <= low <= high <= bounds[1]:
        expected = f"from {bounds[0]:g} to {bounds[1]:g}"
        raise error("out-of-range", path=option, value=text, expected=expected)
    return low, high


def _twins(options: Options, sensors: set[str]) -> tuple[tuple[str, str], ...]:
    found: dict[str, str] = {}
    for text in options.twin or ():
        name, _, sensor = (item.strip() for item in text.partition(":"))
        if sensor not in sensors:
            near = suggestion(sensor, sorted(sensors))
            raise error("unknown-name", path="--twin", what="sensor", value=text, **near)
        if name in sensors or name in found or not is_covariate(name) or name[:2] != "T_":
            raise error("not-a-name", path="--twin", value=text, expected="'T_18_degC: ...', say")
        found[name] = sensor
    return tuple(found.items())


def sensors_heading(plan: DriftPlan, drifts: tuple[ThermalEstimate, ...], seed: int) -> str:
    """Comment lines that say how the sensors follow the room."""
    sensors = sensors_for(drifts, plan, seed)
    each = [
        f"{name} {share:.3f} {lag:.1f}"
        for name, share, lag in zip(sensors.names, sensors.shares, sensors.lags, strict=True)
    ]
    lines = [", ".join(each[i : i + 4]) for i in range(0, len(each), 4)]
    return (
        "# Readings are the drift alone, zeroed at the reference temperature; odd cycles warm up,\n"
        "# even ones cool down. Sensors, share of the room's rise and lag in min; the shares are\n"
        "# moved from the drawn ones as little as the drifts of the settled room ask for:\n"
        + "".join(f"#   {line}\n" for line in lines)
    )


def temperatures(
    plan: DriftPlan, drifts: tuple[ThermalEstimate, ...], rooms: list[float], wobble: float,
    parts: int, features: int, seed: int,
) -> dict[str, FloatArray]:  # fmt: skip
    """True temperatures (parts, features) of sensors and twins; parts take the rooms in turn."""
    sensors = sensors_for(drifts, plan, seed)
    each = np.array([rooms[part % len(rooms)] for part in range(parts)])
    true = settled(plan.climate, sensors, each, wobble, seed)
    columns = dict(zip(sensors.names, true.T, strict=True))
    columns |= {name: columns[of] for name, of in sensors.twins}
    return {name: np.repeat(column[:, None], features, axis=1) for name, column in columns.items()}


def with_readings(
    found: SimulatedPoints, plan: DriftPlan, drifts: tuple[ThermalEstimate, ...], seed: int
) -> SimulatedPoints:
    """The temperatures of points as the sensors read them, with a noise of each point's own."""
    sensors = sensors_for(drifts, plan, seed)
    read = as_read(plan.climate, sensors, found.covariates, seed, part=1)
    return replace(found, covariates=found.covariates | read)


def grown(
    found: SimulatedPoints, inputs: Inputs, ids: Sequence[str], points: FloatArray
) -> SimulatedPoints:
    """Points of calibrated circles on the diameter that they have at their temperature."""
    moved = growth(found, ids, points, inputs.part.part.circles)
    return replace(found, measured=found.measured + moved)
