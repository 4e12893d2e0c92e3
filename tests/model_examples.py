"""Small machines, estimates and readings made in memory, for the tests of models."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import dedent
from typing import Any

import numpy as np
from made_tables import made_readings, source
from numpy.typing import NDArray

from mtu_cli.files.machine import LoadedMachine, load_machine
from mtu_cli.files.part import LoadedPart, load_part
from mtu_cli.files.readings import Readings
from mtu_cli.language import parse
from mtu_cli.model.estimates import ComponentEstimate, JointPasses
from mtu_cli.model.fit import estimates_from_fit
from mtu_cli.model.machine_model import MachineModel, Term, build_model
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UNITS


def loaded(folder: Path, text: str) -> LoadedMachine:
    """A machine file of `text`, without its first two lines."""
    path = folder / "machine.yaml"
    path.write_text("schema: mtu/machine/1\nname: m\n" + dedent(text))
    return load_machine(path)


def stated(folder: Path, text: str) -> MachineModel:
    """The model of a machine file that states all its components."""
    machine = loaded(folder, text)
    return build_model(machine, estimates_from_fit(machine, None))


def part_of(folder: Path, text: str) -> LoadedPart:
    """A part file of `text`, without its first two lines."""
    path = folder / "part.yaml"
    path.write_text("schema: mtu/part/1\nname: p\n" + dedent(text))
    return load_part(path)


def estimate(
    name: str,
    of: str | None,
    coefficients: Sequence[float] | FloatArray,
    *,
    C: FloatArray | None = None,
    D: FloatArray | None = None,
    s: float = 0.0,
    pass_dof: float = np.inf,
    repeat_dof: float = np.inf,
    n_passes: int | None = None,
) -> ComponentEstimate:
    """An estimate in mm with the given matrices, zero where not given."""
    k = len(coefficients)
    return ComponentEstimate(
        name=name,
        of=of,
        unit=UNITS["mm"],
        coefficients=np.asarray(coefficients, float),
        covariance=np.zeros((k, k)) if C is None else np.asarray(C, float),
        pass_covariance=np.zeros((k, k)) if D is None else np.asarray(D, float),
        s_repeat=s,
        pass_dof=pass_dof,
        repeat_dof=repeat_dof,
        n_passes=n_passes,
    )


def model_of(
    terms: Sequence[tuple[ComponentEstimate, Mapping[str, str]]],
    axes: tuple[str, ...] = ("x", "y"),
    joint: tuple[JointPasses, ...] = (),
) -> MachineModel:
    """A model from estimates and their lever arms, written as equations by axis."""
    return MachineModel(
        name="m",
        axes=axes,
        terms=tuple(
            Term(estimate=item, levers={axis: parse(text) for axis, text in levers.items()})
            for item, levers in terms
        ),
        remainders=dict.fromkeys(axes, ()),
        constants={},
        joint=joint,
    )


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Readings of one component by one instrument, in mm or rad."""

    name: str
    position: FloatArray | None
    error: FloatArray
    passes: NDArray[np.int64] | None = None
    direction: NDArray[np.int64] | None = None
    role: str = "lbb"
    setup: str | None = None
    time: FloatArray | None = None


def readings(segments: Sequence[Segment]) -> Readings:
    """The segments as if they had been read, one file an instrument."""
    names = tuple(dict.fromkeys(item.name for item in segments))
    roles = tuple(dict.fromkeys(item.role for item in segments))
    sizes = [len(item.error) for item in segments]

    def each(values: Sequence[Any]) -> NDArray[Any]:
        return np.concatenate(
            [np.broadcast_to(value, size) for value, size in zip(values, sizes, strict=True)]
        )

    setups = each([item.setup or "" for item in segments]).astype(object)
    found = made_readings(
        each([item.error for item in segments]),
        names,
        code=each([names.index(item.name) for item in segments]),
        position=each([np.nan if s.position is None else s.position for s in segments]),
        passes=each([-1 if s.passes is None else s.passes for s in segments]),
        direction=each([0 if s.direction is None else s.direction for s in segments]),
        time=each([np.nan if item.time is None else item.time for item in segments]),
        covariates={"setup": setups} if any(item.setup for item in segments) else {},
    )
    return replace(
        found,
        has_pass=each([item.passes is not None for item in segments]).astype(bool),
        file_index=each([roles.index(item.role) for item in segments]).astype(np.int64),
        sources=tuple(map(source, roles)),
    )


def permuted(given: Readings, order: NDArray[np.int64]) -> Readings:
    return given.where(order)  # rows by their numbers
