"""`mtu simulate`."""

from __future__ import annotations

import math
import re
import shlex
import sys
from pathlib import Path

import numpy as np

from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.modelling import modelled
from mtu_cli.cli.parameters import Options
from mtu_cli.errors import InputError, Problem, fault
from mtu_cli.files.write import check_targets, write_files
from mtu_cli.language import EquationError, Node, parse
from mtu_cli.model.features import feature_points
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.settings import DEFAULT_SEED
from mtu_cli.model.simulate import PartsPlan, ReadingsPlan, simulate_points, simulate_readings
from mtu_cli.reports.simulate import points_csv, readings_csv
from mtu_cli.stats.least_squares import FloatArray

DEFAULT_POSITIONS = 8
MAX_POSITIONS = 10_000
MAX_ROWS = 10_000_000
_NAMED = re.compile(r"\s*([A-Za-z_][A-Za-z_0-9]*)\s*:(.*)", re.DOTALL)


def run(options: Options) -> None:
    """Writes the readings and points of a virtual machine."""
    if options.write_lbb is None and options.write_cmm is None:
        raise fault("nothing to write", expected="--write-lbb FILE, --write-cmm FILE, or both")
    outputs = [path for path in (options.write_lbb, options.write_cmm) if path is not None]
    check_targets(outputs)
    inputs = Inputs(options)
    study = inputs.study.study.settings if inputs.study else None
    seed = options.seed
    if seed is None:
        seed = study.seed if study is not None and study.seed is not None else DEFAULT_SEED
    _check_numbers(options, seed)
    model = modelled(inputs).model
    files: dict[Path, bytes] = {}
    heading = _heading(options, seed)
    if options.write_lbb is not None:
        readings_plan = _readings_plan(inputs, model)
        _check_rows("--write-lbb", _readings_rows(readings_plan, model))
        readings = simulate_readings(model, readings_plan, seed)
        files[options.write_lbb] = readings_csv(readings, heading).encode()
    if options.write_cmm is not None:
        ids, points, _ = feature_points(inputs.part, model)
        parts_plan = _parts_plan(options, model)
        most = max(parts_plan.repeats, parts_plan.first_repeats[1])
        _check_rows("--write-cmm", len(ids) * parts_plan.parts * most)
        simulated = simulate_points(model, ids, points, parts_plan, seed)
        files[options.write_cmm] = points_csv(simulated, heading).encode()
    write_files(files, inputs=[source.path for source in inputs.sources])
    if not options.quiet:
        for path, content in files.items():
            rows = content.count(b"\n") - heading.count("\n") - 1
            print(f"{path}: {rows} synthetic rows", file=sys.stdout)


def _check_numbers(options: Options, seed: int) -> None:
    checks = [(seed >= 0, "--seed", seed, "0 or more")]
    checks += [
        (math.isfinite(value), f"--{name.replace('_', '-')}", value, "a finite number")
        for name in ("cmm_u_um", "part_offset_um", "minutes")
        for value in [options.values[name]]
    ]
    problems = [
        Problem(what=f"{option} is out of range", value=str(value), expected=expected)
        for good, option, value, expected in checks
        if not good
    ]
    if problems:
        raise InputError(problems)


def _readings_rows(plan: ReadingsPlan, model: MachineModel) -> int:
    axes = [term.estimate.of for term in model.terms]
    each = [1 if of is None else len(plan.positions[of]) * len(plan.directions) for of in axes]
    return plan.passes * sum(each)


def _check_rows(option: str, rows: int) -> None:
    if rows > MAX_ROWS:
        raise fault(f"{option}: {rows} rows to write", expected=f"at most {MAX_ROWS}")


def _heading(options: Options, seed: int) -> str:
    """Comment lines that say the file is synthetic and how it came about."""
    from mtu_cli import __version__

    given = [
        f"--{name.replace('_', '-')} {shlex.quote(' '.join(str(item).split()))}"
        for name, value in options.values.items()
        if name in ("one_way", "effect", "covariate", "passes", "parts", "repeats", "cmm_u_um",
                    "positions",
                    "scatter", "operation", "first_repeats", "part_offset_um", "reverse_every",
                    "minutes")
        and value is not None
        and value != []
        for item in (value if isinstance(value, list) else [value])
    ]  # fmt: skip
    return (
        f"# Synthetic, no machine made it: mtu simulate {__version__}, seed {seed}\n"
        f"# {' '.join(given)}\n"
    )


def _readings_plan(inputs: Inputs, model: MachineModel) -> ReadingsPlan:
    options = inputs.options
    return ReadingsPlan(
        passes=options.passes,
        directions=(1,) if options.one_way else (1, -1),
        positions=_positions(inputs, model),
    )


def _positions(inputs: Inputs, model: MachineModel) -> dict[str, FloatArray]:
    needed = {term.estimate.of for term in model.terms if term.estimate.of is not None}
    text = inputs.options.positions
    if text is not None:
        places = _range(text)
        return dict.fromkeys(needed, places)
    _, points, _ = feature_points(inputs.part, model)
    found: dict[str, FloatArray] = {}
    for axis in needed:
        column = points[:, AXES.index(axis)]
        low, high = np.nanmin(column), np.nanmax(column)
        if not np.isfinite(low) or low == high:
            raise fault(
                f"the part does not extend along {axis}", expected="--positions LOW:HIGH:COUNT"
            )
        found[axis] = np.linspace(low, high, DEFAULT_POSITIONS)
    return found


def _range(text: str) -> FloatArray:
    parts = text.split(":")
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except (ValueError, IndexError):
        low, high, count = 0.0, 0.0, 0
    good = len(parts) == 3 and np.isfinite([low, high]).all() and low < high
    if not good or not 2 <= count <= MAX_POSITIONS:
        raise fault(
            "--positions is not LOW:HIGH:COUNT",
            value=text,
            expected=f"such as 0:140:8, two to {MAX_POSITIONS} positions",
        )
    return np.linspace(low, high, count)


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
        raise fault(
            "--first-repeats is not PARTS:REPEATS", value=text, expected="such as 4:5, both above 0"
        )
    return parts, repeats


def _by_axis(
    option: str, texts: list[str] | None, model: MachineModel
) -> tuple[tuple[str, Node], ...]:
    """Equations named Ex, Ey or Ez, by their axis."""
    found = []
    for text in texts or ():
        name, node = _equation(option, text)
        axis = name[1:]
        if name[:1] != "E" or axis not in model.axes:
            raise fault(
                f"{option} is of an unknown equation",
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
        name, node = _equation("--covariate", text)
        if name in taken:
            raise fault(
                f"--covariate: the name {name!r} is taken",
                value=text,
                expected="a name of its own, such as T_spindle_degC",
            )
        taken.add(name)
        found.append((name, node))
    return found


def _equation(option: str, text: str) -> tuple[str, Node]:
    match = _NAMED.fullmatch(text)
    if match is None:
        raise fault(f"{option} is not NAME: EQUATION", value=text, expected="'Ex: 0.004*dir_x'")
    try:
        # Blanks for the name: columns count from the start of the option's text.
        return match[1], parse(" " * match.start(2) + match[2])
    except EquationError as error:
        raise fault(
            f"{option} {match[1]}: {error.what}",
            column=error.column,
            value=text,
            expected=error.expected,
        ) from None
