"""Coordinates of the error strata."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.analyses.close_loop.strata import Strata, strata_of

P, H = 4, 5


def strata() -> Strata:
    line = np.arange(H) - (H - 1) / 2
    lines = [(line / np.linalg.norm(line))[:, None]] * 2
    return strata_of(P, 2, lines, H=H, features_scatter=True)


@pytest.mark.parametrize("shape", [(P, 1), (1, H), (P, H), (1, 1)])
def test_columns_in_compact_shapes_are_those_of_whole_tables(shape: tuple[int, int]) -> None:
    """A lever of parts alone has the sign that the errors have."""
    values = np.random.default_rng(1).normal(size=shape)
    whole = np.zeros((P, H, 2))
    whole[..., 1] = values
    of_errors = strata().coordinates(whole)
    at, compact = strata().of_levers([{1: values[None]}], 1)
    found = np.zeros(len(of_errors))
    found[at] = compact[0, 0]
    assert found == pytest.approx(of_errors)


def test_a_table_comes_back_but_for_its_mean() -> None:
    errors = np.random.default_rng(2).normal(size=(3, P, H, 2))
    back = strata().table(strata().coordinates(errors))
    assert back == pytest.approx(errors - errors.mean(axis=(1, 2), keepdims=True))
