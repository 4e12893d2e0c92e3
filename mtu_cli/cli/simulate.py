"""`mtu simulate`."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import numpy as np

from mtu_cli.cli.inputs import Inputs
from mtu_cli.cli.modelling import modelled
from mtu_cli.cli.parameters import Options
from mtu_cli.errors import fault
from mtu_cli.files.write import write_files
from mtu_cli.language import EquationError, Node, parse
from mtu_cli.model.features import feature_points
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.settings import DEFAULT_SEED
from mtu_cli.model.simulate import PartsPlan, ReadingsPlan, simulate_points, simulate_readings
from mtu_cli.reports.simulate import points_csv, readings_csv
from mtu_cli.stats.least_squares import FloatArray

DEFAULT_POSITIONS = 8
MAX_POSITIONS = 10_000
_NAMED = re.compile(r"\s*([A-Za-z_][A-Za-z_0-9]*)\s*:(.*)", re.DOTALL)


def run(options: Options) -> None:
    """Writes the readings and points of a virtual machine."""
    if options.write_lbb is None and options.write_cmm is None:
        raise fault("nothing to write", expected="--write-lbb FILE, --write-cmm FILE, or both")
    inputs = Inputs(options)
    study = inputs.study.study.settings if inputs.study else None
    seed = options.seed
    if seed is None:
        seed = study.seed if study is not None and study.seed is not None else DEFAULT_SEED
    if seed < 0:
        raise fault("--seed is out of range", value=str(seed), expected="0 or more")
    model = modelled(inputs).model
    files: dict[Path, bytes] = {}
    heading = _heading(options, seed)
    if options.write_lbb is not None:
        readings = simulate_readings(model, _readings_plan(inputs, model), seed)
        files[options.write_lbb] = readings_csv(readings, heading).encode()
    if options.write_cmm is not None:
        ids, points, _ = feature_points(inputs.part, model)
        simulated = simulate_points(model, ids, points, _parts_plan(options, model), seed)
        files[options.write_cmm] = points_csv(simulated, heading).encode()
    write_files(files, inputs=[source.path for source in inputs.sources])
    if not options.quiet:
        for path, content in files.items():
            rows = content.count(b"\n") - heading.count("\n") - 1
            print(f"{path}: {rows} synthetic rows", file=sys.stdout)


def _heading(options: Options, seed: int) -> str:
    """Comment lines that say the file is synthetic and how it came about."""
    from mtu_cli import __version__

    given = [
        f"--{name.replace('_', '-')} {shlex.quote(str(item))}"
        for name, value in options.values.items()
        if name in ("effect", "covariate", "passes", "parts", "repeats", "cmm_u_um", "positions",
                    "part_offset_um", "reverse_every", "minutes")
        and value not in (None, [], 0)
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
    effects = []
    for text in options.effect or ():
        name, node = _equation("--effect", text)
        axis = name[1:]
        if name[:1] != "E" or axis not in model.axes:
            raise fault(
                "--effect is of an unknown equation",
                value=text,
                expected=" or ".join(f"E{axis}: ..." for axis in model.axes),
            )
        effects.append((axis, node))
    covariates = [_equation("--covariate", text) for text in options.covariate or ()]
    return PartsPlan(
        parts=options.parts,
        repeats=options.repeats,
        cmm_u=options.cmm_u_um * 1e-3,
        part_offset=options.part_offset_um * 1e-3,
        reverse_every=options.reverse_every,
        minutes=options.minutes,
        effects=tuple(effects),
        covariates=tuple(covariates),
    )


def _equation(option: str, text: str) -> tuple[str, Node]:
    match = _NAMED.fullmatch(text)
    if match is None:
        raise fault(f"{option} is not NAME: EQUATION", value=text, expected="'Ex: 0.004*dir_x'")
    try:
        return match[1], parse(match[2])
    except EquationError as error:
        raise fault(
            f"{option} {match[1]}: {error.what}",
            column=error.column + match.start(2),
            value=text,
            expected=error.expected,
        ) from None
