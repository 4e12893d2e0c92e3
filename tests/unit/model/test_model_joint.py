"""Covariance between components that share passes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from model_examples import Segment, loaded, readings
from numpy.typing import NDArray

from mtu_cli.model.estimation import shared_passes
from mtu_cli.model.fit import fit_machine
from mtu_cli.stats.least_squares import FloatArray

P = np.linspace(0.0, 90.0, 4)
CENTRE = P.mean()
PASSES = 5
MACHINE = """
components: {a: {of: x, unit: mm}, b: {of: y, unit: mm}, t: {unit: rad}}
equations: {Ex: a - y*t, Ey: b + x*t}
"""
# Level and slope of a, of b, and the angle, at the centre of the readings.
D = np.array(
    [
        [1.0, 4e-3, 0.9, 0.0, 3e-3],
        [4e-3, 1e-4, 2e-3, 3e-5, 1e-5],
        [0.9, 2e-3, 2.0, -6e-3, 4e-3],
        [0.0, 3e-5, -6e-3, 2e-4, 0.0],
        [3e-3, 1e-5, 4e-3, 0.0, 5e-5],
    ]
)
TO_ORIGIN = np.array([[1.0, -CENTRE], [0.0, 1.0]])
T = np.block(
    [
        [TO_ORIGIN, np.zeros((2, 3))],
        [np.zeros((2, 2)), TO_ORIGIN, np.zeros((2, 1))],
        [np.zeros((1, 4)), np.ones((1, 1))],
    ]
)
S_REPEAT = (0.8, 1.5)


def segments(states: FloatArray, rng: np.random.Generator) -> list[Segment]:
    """Passes with the given states (passes, 5)."""
    n = len(states)
    number = np.repeat(np.arange(1, n + 1), len(P))
    found = []
    for c, (name, s) in enumerate(zip("ab", S_REPEAT, strict=True)):
        lines = states[:, 2 * c, None] + states[:, 2 * c + 1, None] * (P - CENTRE)
        noise = s * rng.standard_normal(lines.shape)
        error = (lines + noise).ravel()
        found.append(Segment(name=name, position=np.tile(P, n), error=error, passes=number))
    found.append(Segment(name="t", position=None, error=states[:, 4], passes=np.arange(1, n + 1)))
    return found


def test_joint_covariances_are_unbiased(tmp_path: Path) -> None:
    """C, D and a future part's covariance over many machines, against what drew them."""
    machine = loaded(tmp_path, MACHINE)
    rng = np.random.default_rng(1)
    half = np.linalg.cholesky(D)
    machines = 400
    found_C, found_D, coefficients = [], [], []
    for _ in range(machines):
        states = rng.standard_normal((PASSES, 5)) @ half.T
        fit = fit_machine(machine, readings(segments(states, rng)))
        (group,) = fit.joint
        assert group.components == ("a", "b", "t")
        assert (group.pass_dof, group.n_passes) == (PASSES - 1, PASSES)
        found_C.append(group.covariance)
        found_D.append(group.pass_covariance)
        coefficients.append(
            np.concatenate([fit.components[name].estimate.coefficients for name in "abt"])
        )
    X = np.column_stack([np.ones_like(P), P])
    of_noise = np.zeros((5, 5))
    for c, s in enumerate(S_REPEAT):
        of_noise[2 * c : 2 * c + 2, 2 * c : 2 * c + 2] = s**2 * np.linalg.inv(X.T @ X)
    in_origin = T @ D @ T.T
    of_C = (in_origin + of_noise) / PASSES
    for found, wanted in ((found_D, in_origin), (found_C, of_C)):
        sample = np.array(found)
        error = sample.std(axis=0, ddof=1) / np.sqrt(machines)
        assert (np.abs(sample.mean(axis=0) - wanted) < 4.5 * error).all()
        # The test can tell: cross terms stand out from zero.
        assert abs(wanted[0, 2]) > 4.5 * error[0, 2]
    seen = np.cov(np.array(coefficients).T)
    scale = np.sqrt(np.outer(np.diag(of_C), np.diag(of_C)) + of_C**2) / np.sqrt(machines)
    assert (np.abs(seen - of_C) < 4.5 * scale).all()


def two(rng: np.random.Generator, **changes: object) -> list[Segment]:
    """Two components in the same passes, the second with changes."""
    first, second, _ = segments(rng.standard_normal((PASSES, 5)), rng)
    return [first, replace(second, **changes)]  # type: ignore[arg-type]  # fields by name


def groups(tmp_path: Path, given: list[Segment]) -> int:
    machine = loaded(
        tmp_path, MACHINE.replace(", t: {unit: rad}", "").replace("- y*t", "").replace("+ x*t", "")
    )
    return len(shared_passes(fit_machine(machine, readings(given)).components))


def test_who_shares_passes(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    assert groups(tmp_path, two(rng)) == 1
    # Another instrument, other pass numbers, fewer passes, no pass column.
    assert groups(tmp_path, two(rng, role="laser")) == 0
    number: NDArray[np.int64] = np.repeat(np.arange(2, PASSES + 2), len(P))
    assert groups(tmp_path, two(rng, passes=number)) == 0
    direction = np.tile(np.repeat([1, -1], [2, 2]), PASSES)
    assert groups(tmp_path, two(rng, direction=direction)) == 0
    assert groups(tmp_path, two(rng, passes=None)) == 0


def test_set_ups_decide_where_they_are_given(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    first, second = two(rng)
    same = [replace(first, setup="A"), replace(second, setup="A")]
    other = [replace(first, setup="A"), replace(second, setup="B")]
    assert groups(tmp_path, same) == 1
    assert groups(tmp_path, other) == 0
    assert groups(tmp_path, [replace(first, setup="A"), second]) == 0
