"""`mtu simulate`."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

from mtu_cli.cli.execute import deliver, warning_lines
from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.modelling import modelled
from mtu_cli.cli.option_values import option_name
from mtu_cli.cli.options import Options
from mtu_cli.cli.outputs import check_outputs, check_overwritten
from mtu_cli.cli.simulate_checks import (
    CLIMATE,
    DRIFT_TEST,
    check_ranges,
    check_used,
    large_warnings,
)
from mtu_cli.cli.simulate_drift import (
    check_cmm_room,
    drift_plan,
    drifting,
    grown,
    sensors_heading,
    temperatures,
    with_readings,
)
from mtu_cli.cli.simulate_options import named_equation, read_positions
from mtu_cli.findings import Finding, error
from mtu_cli.language import Node
from mtu_cli.model.effect_parameters import EFFECT_MARK
from mtu_cli.model.features import feature_points
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.settings import DEFAULT_SEED
from mtu_cli.model.simulate import PartsPlan, simulate_points
from mtu_cli.model.simulate_drift import simulate_drift
from mtu_cli.model.simulate_readings import ReadingsPlan, cut_warnings, simulate_readings
from mtu_cli.reports.simulate import drift_csv, points_csv, readings_csv

MAX_ROWS = 10_000_000
SYNTHETIC = "# Synthetic"
"""How a file of its own begins: another one holds what somebody has measured."""
OUTPUTS = ("write_lbb", "write_cmm", "write_drift")
READINGS_AND_POINTS = (
    "one_way", "effect", "covariate", "passes", "parts", "repeats", "cmm_u_um", "positions",
    "scatter", "operation", "first_repeats", "part_offset_um", "reverse_every", "minutes",
)  # fmt: skip


def run(options: Options) -> None:
    """Writes the readings, points and drift readings of a virtual machine."""
    outputs = [options.values[name] for name in OUTPUTS if options.values[name] is not None]
    if not outputs:
        expected = "--write-lbb FILE, --write-cmm FILE or --write-drift FILE"
        raise error("usage", reason="simulate has no output", expected=expected)
    inputs = Inputs(options)
    check_outputs(inputs)
    check_cmm_room(options)
    seed = _seed(inputs)
    check_ranges(options, seed)
    told = [*check_used(options), *_unused(inputs)]
    model = modelled(inputs).model
    if options.write_lbb is not None or options.write_cmm is not None:
        told += cut_warnings(model)
    files: dict[Path, str] = {}
    if options.write_lbb is not None:
        files[options.write_lbb] = _readings(inputs, model, seed)
    if options.write_cmm is not None:
        files[options.write_cmm], large = _points(inputs, model, seed)
        told += large
    if options.write_drift is not None:
        files[options.write_drift] = _drift(inputs, model, seed)
    # Last: of a call that is at fault itself, its own faults are to be mended first.
    check_overwritten(outputs, SYNTHETIC)
    content = {path: text.encode() for path, text in files.items()}
    say = partial(_say, {} if options.quiet else files)
    deliver(content, inputs, say, warning_lines(told, options=options))


def _unused(inputs: Inputs) -> list[Finding]:
    """Of components that stand in no equation nothing is simulated."""
    warnings = inputs.machine.warnings
    return [own for own in warnings if own.code == "unused" and own.facts["what"] == "component"]


def _say(files: Mapping[Path, str]) -> None:
    for path, text in files.items():
        rows = sum(not line.startswith("#") for line in text.splitlines()) - 1
        print(f"{path}: {rows} synthetic rows", file=sys.stdout)


def _seed(inputs: Inputs) -> int:
    study = inputs.study.study.settings if inputs.study else None
    given = inputs.options.seed
    if given is None and study is not None:
        given = study.seed
    return DEFAULT_SEED if given is None else int(given)


def _readings(inputs: Inputs, model: MachineModel, seed: int) -> str:
    plan = _readings_plan(inputs, model)
    _check_rows("--write-lbb", _readings_rows(plan, model))
    heading = _heading(inputs.options, seed, READINGS_AND_POINTS)
    return readings_csv(simulate_readings(model, plan, seed), heading)


def _points(inputs: Inputs, model: MachineModel, seed: int) -> tuple[str, list[Finding]]:
    """The points file, and what to ask about it."""
    options = inputs.options
    ids, points, _ = feature_points(inputs.part, model)
    plan = _parts_plan(options, model)
    most = max(plan.repeats, plan.first_repeats[1])
    _check_rows("--write-cmm", len(ids) * plan.parts * most)
    named: tuple[str, ...] = READINGS_AND_POINTS
    if options.cmm_room:
        named = (*named, *CLIMATE, "cmm_room", "cmm_wobble_degc")
        drifts = drifting(inputs, model)
        drift = drift_plan(inputs, drifts)
        rooms, wobble = options.cmm_room, options.cmm_wobble_degc
        true = temperatures(drift, drifts, rooms, wobble, plan.parts, len(ids), seed)
        found = simulate_points(model, ids, points, replace(plan, given=true), seed)
        found = with_readings(found, drift, drifts, seed)
    else:
        found = simulate_points(model, ids, points, plan, seed)
    large = large_warnings(plan, found, ids, points)
    return points_csv(grown(found, inputs, ids, points), _heading(options, seed, named)), large


def _drift(inputs: Inputs, model: MachineModel, seed: int) -> str:
    drifts = drifting(inputs, model)
    plan = drift_plan(inputs, drifts)
    places = sum(len(positions) for positions in plan.positions.values())
    _check_rows("--write-drift", plan.cycles * plan.moments * places)
    heading = _heading(inputs.options, seed, (*CLIMATE, *DRIFT_TEST))
    return drift_csv(
        simulate_drift(drifts, plan, seed), heading + sensors_heading(plan, drifts, seed)
    )


def _readings_rows(plan: ReadingsPlan, model: MachineModel) -> int:
    axes = [term.estimate.of for term in model.terms if EFFECT_MARK not in term.estimate.name]
    each = [1 if of is None else len(plan.positions[of]) * len(plan.directions) for of in axes]
    return plan.passes * sum(each)


def _check_rows(option: str, rows: int) -> None:
    if rows > MAX_ROWS:
        raise error(
            "out-of-range", path=option, value=f"{rows} rows", expected=f"at most {MAX_ROWS}"
        )


def _heading(options: Options, seed: int, names: Collection[str]) -> str:
    """Comment lines that say the file is synthetic and how it came about."""
    from mtu_cli import __version__

    given = [
        f"{option_name(name)} {shlex.quote(' '.join(str(item).split()))}"
        for name, value in options.values.items()
        if name in names and value is not None and value != []
        for item in (value if isinstance(value, list) else [value])
    ]
    return (
        f"{SYNTHETIC}, no machine made it: mtu simulate {__version__}, seed {seed}\n"
        f"# {' '.join(given)}\n"
    )


def _readings_plan(inputs: Inputs, model: MachineModel) -> ReadingsPlan:
    options = inputs.options
    return ReadingsPlan(
        passes=options.passes,
        directions=(1,) if options.one_way else (1, -1),
        positions=read_positions(inputs, model),
    )


def _parts_plan(options: Options, model: MachineModel) -> PartsPlan:
    covariates = _covariates(options)
    return PartsPlan(
        parts=options.parts,
        repeats=options.repeats,
        cmm_u=options.cmm_u_um * 1e-3,
        part_offset=options.part_offset_um * 1e-3,
        reverse_every=options.reverse_every,
        minutes=options.minutes,
        first_repeats=_first_repeats(options.first_repeats),
        scatter=_by_axis("--scatter", options.scatter, model),
        operation=options.operation,
        effects=_by_axis("--effect", options.effect, model),
        covariates=tuple(covariates),
    )


def _first_repeats(text: str | None) -> tuple[int, int]:
    if text is None:
        return 0, 0
    try:
        parts, repeats = (int(item) for item in text.split(":"))
    except ValueError:
        parts, repeats = 0, 0
    if parts < 1 or repeats < 1:
        raise error(
            "option-form",
            path="--first-repeats",
            form="PARTS:REPEATS",
            value=text,
            expected="4:5, say, both above 0",
        )
    return parts, repeats


def _by_axis(
    option: str, texts: list[str] | None, model: MachineModel
) -> tuple[tuple[str, Node], ...]:
    """Equations named Ex, Ey or Ez, by their axis."""
    found = []
    for text in texts or ():
        name, node = named_equation(option, text)
        axis = name[1:]
        if name[:1] != "E" or axis not in model.axes:
            raise error(
                "unknown-name",
                path=option,
                what="equation",
                value=text,
                expected=" or ".join(f"E{axis}: ..." for axis in model.axes),
            )
        found.append((axis, node))
    return tuple(found)


def _covariates(options: Options) -> list[tuple[str, Node]]:
    """Declared covariates; none may take a column that the points have anyway."""
    taken = {"part", "feature", "operation", "repeat", "sequence", "time", "time_min"}
    taken |= {f"{start}{axis}" for axis in AXES for start in ("", "dir_")}
    taken |= {f"{start}{axis}_mm" for axis in AXES for start in ("", "nominal_")}
    found = []
    for text in options.covariate or ():
        name, node = named_equation("--covariate", text, column=True)
        if name in taken:
            raise error(
                "name-taken",
                path="--covariate",
                taken="a column of the points",
                value=text,
                expected="a name of its own, such as T_spindle_degC",
            )
        taken.add(name)
        found.append((name, node))
    return found
