"""What columns of points hold beside covariates: errors again, and rounded values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from compare_trials import made, study
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.model import columns as written_errors
from mtu_cli.close_loop_sealed.model.columns import (
    FEWEST,
    resolution,
    without_written_errors,
)
from mtu_cli.files.points import Points
from mtu_cli.stats.least_squares import FloatArray

Covariates = dict[str, FloatArray | NDArray[np.object_]]


def measured(seed: int = 1, digits: int = 4) -> Points:
    """As a CMM writes it: 0.1 um unless said, errors of some 5 um."""
    _, truth, part = study()
    found = made(truth, part, seed, parts=6)
    return replace(found, measured=np.round(found.measured, digits))


def errors(found: Points) -> FloatArray:
    return np.asarray(found.measured - found.nominal)


def told(found: Points, column: FloatArray, needed: tuple[str, ...] = ()) -> str | None:
    """The message on a column, which is taken out where there is one."""
    load = np.mod(np.arange(len(found), dtype=np.float64), 7.0)
    given = replace(found, covariates={"own": column, "load": load})
    left, warned = without_written_errors(given, needed)
    assert ("own" in left.covariates) == (not warned)
    assert "load" in left.covariates
    return warned[0].message if warned else None


WRITTEN = {
    "the error along x, mm": lambda e, m: e[:, 0],
    "the error along y, um": lambda e, m: np.round(1e3 * e[:, 1], 1),
    "the error along y with the other sign, mm": lambda e, m: -e[:, 1],
    "the coordinate x, mm": lambda e, m: m[:, 0],
    "the length of the error, um": lambda e, m: np.round(1e3 * np.hypot(e[:, 0], e[:, 1]), 2),
    "the position by its diameter, mm": lambda e, m: np.round(2 * np.hypot(e[:, 0], e[:, 1]), 4),
}


@pytest.mark.parametrize("words", WRITTEN)
def test_what_a_measuring_machine_writes_of_the_error_is_taken_out(words: str) -> None:
    found = measured()
    message = told(found, WRITTEN[words](errors(found), found.measured))
    assert message is not None
    assert f"'own' ({words})): they repeat what was measured" in message


def test_the_nominal_places_are_called_so() -> None:
    """Their distances are no last digit, within which the places as measured agree as well."""
    found = measured()
    for column, unit in ((found.nominal[:, 0], "mm"), (1e3 * found.nominal[:, 0], "um")):
        message = told(found, column)
        assert message is not None
        assert f"'own' (the nominal x, {unit})): they repeat the nominal place" in message
        assert "what was measured" not in message
    both: Covariates = {"own": errors(found)[:, 0], "nomx": found.nominal[:, 0]}
    _, warned = without_written_errors(replace(found, covariates=both), ())
    assert [item.code for item in warned] == ["not-tested"] * 2


def test_what_is_written_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not for every column: a CMM writes dozens beside the points."""
    found = measured()
    calls: list[Points] = []
    make = written_errors._written

    def counted(points: Points) -> Iterator[written_errors._Written]:
        calls.append(points)
        return make(points)

    monkeypatch.setattr(written_errors, "_written", counted)
    columns: Covariates = {f"c{i}": np.arange(len(found), dtype=np.float64) for i in range(5)}
    without_written_errors(replace(found, covariates=columns), ())
    assert len(calls) == 1


def test_more_digits_than_the_coordinates_have() -> None:
    """The deviation was made before the coordinate was rounded."""
    whole = measured(digits=9)
    rounded = replace(whole, measured=np.round(whole.measured, 3))
    column = np.round(1e3 * errors(whole)[:, 0], 1)
    assert np.abs(column - 1e3 * errors(rounded)[:, 0]).max() > 0.4
    assert told(rounded, column) is not None


def test_what_only_goes_with_the_error_stays() -> None:
    """A cause of nearly all of it, the error less a part's own, one entry that is another."""
    found = measured()
    own = errors(found)[:, 0]
    noise = np.random.default_rng(3).normal(scale=0.1 * own.std(), size=len(own))
    other = own.copy()
    other[5] += 0.5 * own.std()
    for column in (own + noise, 1.02 * own, other, own - own.mean(), np.sign(own)):
        assert told(found, column) is None


@pytest.mark.parametrize("count", [FEWEST - 1, FEWEST])
def test_of_few_points_nothing_is_said(count: int) -> None:
    """Of one feature, so that the last digit of the coordinates shows."""
    found = measured()
    kept = np.flatnonzero(found.feature == found.feature[0])[:count]
    assert len(kept) == count
    few = replace(
        found, **{name: getattr(found, name)[kept]
                  for name in ("measured", "nominal", "part", "feature")},
    )  # fmt: skip
    given = replace(few, covariates={"own": errors(few)[:, 0]})
    assert bool(without_written_errors(given, ())[1]) == (count == FEWEST)


def test_of_coarse_points_nothing_is_said() -> None:
    coarse = measured(digits=2)
    assert told(coarse, errors(coarse)[:, 0]) is None


def test_a_column_that_the_machine_needs_stays() -> None:
    found = measured()
    assert told(found, errors(found)[:, 0], needed=("own",)) is None


def test_texts_and_columns_of_other_numbers_are_left_alone() -> None:
    found = measured()
    words = np.array(["a"] * len(found), object)
    hot = np.linspace(20, 25, len(found))
    given = replace(found, covariates={"word": words, "T_a_degC": hot})
    assert without_written_errors(given, ()) == (given, ())


EXACT = np.random.default_rng(1).uniform(-500, 500, 200)


@pytest.mark.parametrize("step", [1e-3, 5e-4, 1e-4, 1e-5])
def test_the_step_is_found(step: float) -> None:
    assert resolution(np.round(EXACT / step) * step) == step


def test_what_is_not_rounded_has_none_and_coarser_steps_count_as_1_um() -> None:
    assert resolution(EXACT) == 0.0
    assert resolution(np.round(EXACT, 2)) == 1e-3
