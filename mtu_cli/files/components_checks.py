"""Whether the matrices of a report of fit-components can be those of its components."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from math import isnan

from mtu_cli.errors import Problem, counted
from mtu_cli.files.components_contract import ReportedComponent, ReportedEffects, ReportedGroup
from mtu_cli.files.covariance import covariance_fault
from mtu_cli.files.machine_checks import PASSES
from mtu_cli.files.report_file import any_estimated, no_dof, unit_problem
from mtu_cli.files.source import Source
from mtu_cli.findings import Finding
from mtu_cli.units import PARAMETER_UNITS


def component_problems(source: Source, name: str, item: ReportedComponent) -> list[Finding]:
    """Of the sizes, covariances, degrees of freedom and the unit of a component."""
    k = len(item.coefficients)
    q = min(2, k)
    wanted = [("covariance", item.covariance, k), ("pass_covariance", item.pass_covariance, q)]
    wanted.append(("pass_covariance_moment", item.pass_covariance_moment, q))
    if item.covariance_independent is not None:
        wanted.append(("covariance_independent", item.covariance_independent, k))
    if item.half_difference_mean_square is not None:
        wanted.append(("half_difference_mean_square", item.half_difference_mean_square, q))
    if item.run_covariance is not None:
        wanted.append(("run_covariance", item.run_covariance, q))
    problems = []
    for key, matrix, size in wanted:
        # Differences of mean squares: negative where passes, or runs, hardly differ.
        moment = key in ("pass_covariance_moment", "run_covariance")
        what = covariance_fault(matrix, size, difference=moment)
        if what is not None:
            path = f"results.components.{name}.{key}"
            problems.append(Problem(what=what, file=source.shown, path=path))
    problems += _half_known(source, name, item)
    problems += _without_dof(source, name, item)
    if item.degree != k - 1:
        problems.append(
            Problem(
                what=f"{counted(k, 'coefficient')} of a component of degree {item.degree}",
                file=source.shown,
                path=f"results.components.{name}.coefficients",
                expected=f"{item.degree + 1}",
            )
        )
    return problems + unit_problem(source, name, item.unit)


def _half_known(source: Source, name: str, item: ReportedComponent) -> Iterator[Finding]:
    """A fit of as many readings as coefficients tells neither a covariance nor a repeatability; any
    other tells all of both.
    """
    path = f"results.components.{name}"
    lacks = [(i, j) for i, row in enumerate(item.covariance) for j, v in enumerate(row) if isnan(v)]
    if len(lacks) == sum(map(len, item.covariance)):
        return
    places = [f"{path}.covariance.{i}.{j}" for i, j in lacks[:1]]
    places += [f"{path}.s_repeat"] * isnan(item.s_repeat)
    for place in places:
        yield Problem(what="is not known", file=source.shown, path=place, expected="a number")


def _without_dof(source: Source, name: str, item: ReportedComponent) -> Iterator[Finding]:
    """Of `pass_dof` and `repeat_dof`: 0 where something was estimated with it.

    pass_dof 0 alone says that one mean square stands behind all, with `repeat_dof`.
    """
    one_square = item.pass_dof == 0 and any_estimated(item.covariance)
    for key, value, what, estimated in (
        ("pass_dof", item.pass_dof, PASSES, any_estimated(item.pass_covariance)),
        ("repeat_dof", item.repeat_dof, "a repeatability", item.s_repeat > 0 or one_square),
    ):
        if value == 0 and estimated:
            yield no_dof(source, f"results.components.{name}.{key}", what)


def group_problems(
    source: Source, i: int, group: ReportedGroup, known: dict[str, ReportedComponent]
) -> list[Finding]:
    """Of the i-th group of components that were fitted together."""
    path = f"results.joint_pass_covariance.{i}"
    unknown = [name for name in group.components if name not in known]
    widths = [len(known[name].coefficients) for name in group.components if name in known]
    problems = [
        Problem(
            what="not among results.components",
            file=source.shown,
            path=f"{path}.components",
            value=name,
        )
        for name in unknown
    ]
    if not unknown and group.widths != widths:
        problems.append(
            Problem(
                what="not the numbers of coefficients of the components",
                file=source.shown,
                path=f"{path}.widths",
                value=str(group.widths),
                expected=str(widths),
            )
        )
    if problems:
        return problems
    matrices = (group.pass_covariance, group.coefficient_covariance)
    if group.pass_dof == 0 and any(map(any_estimated, matrices)):
        problems.append(no_dof(source, f"{path}.pass_dof", PASSES, known=False))
    return [*problems, *_matrix_problems(source, path, group, known)]


def _matrix_problems(
    source: Source, path: str, group: ReportedGroup, known: dict[str, ReportedComponent]
) -> Iterator[Finding]:
    # Of as many readings as coefficients nobody can tell a covariance, but of passes everybody can.
    bare = {name for name, own in known.items() if any(map(isnan, chain(*own.covariance)))}
    for key, may_lack in (("coefficient_covariance", bare), ("pass_covariance", set[str]())):
        matrix = getattr(group, key)
        what = covariance_fault(matrix, sum(group.widths), difference=key == "pass_covariance")
        where = None if what is not None else _unknown_entry(matrix, group, may_lack)
        if what is not None:
            yield Problem(what=what, file=source.shown, path=f"{path}.{key}")
        if where is not None:
            entry = f"{path}.{key}.{where[0]}.{where[1]}"
            yield Problem(what="is not known", file=source.shown, path=entry, expected="a number")
    if group.half_difference_mean_square is not None:
        what = covariance_fault(group.half_difference_mean_square, sum(group.widths))
        if what is not None:
            halves = f"{path}.half_difference_mean_square"
            yield Problem(what=what, file=source.shown, path=halves)


def _unknown_entry(
    matrix: list[list[float]], group: ReportedGroup, may_lack: set[str]
) -> tuple[int, int] | None:
    """Row and column of an entry that is not known, and that is none of these components."""
    widths = zip(group.components, group.widths, strict=True)
    lacks = [name in may_lack for name, width in widths for _ in range(width)]
    return next(
        (
            (i, j)
            for i, row in enumerate(matrix)
            for j, value in enumerate(row)
            if isnan(value) and not (lacks[i] or lacks[j])
        ),
        None,
    )


def effect_problems(source: Source, effects: ReportedEffects) -> list[Finding]:
    """Of the parameters of declared effects, their units and covariance."""
    path = "results.effects"
    size = len(effects.parameters)
    problems = [
        Problem(
            what=f"{counted(len(values), 'entry', 'entries')} for {counted(size, 'parameter')}",
            file=source.shown,
            path=f"{path}.{key}",
        )
        for key, values in (("units", effects.units), ("values", effects.values))
        if len(values) != size
    ]
    if len(set(effects.parameters)) < size:
        problems.append(
            Problem(what="a parameter twice", file=source.shown, path=f"{path}.parameters")
        )
    problems += [
        Problem(
            what="unknown unit",
            file=source.shown,
            path=f"{path}.units",
            value=unit,
            expected=", ".join(PARAMETER_UNITS),
        )
        for unit in effects.units
        if unit not in PARAMETER_UNITS
    ]
    what = covariance_fault(effects.covariance, size)
    if what is not None:
        problems.append(Problem(what=what, file=source.shown, path=f"{path}.covariance"))
    return problems
