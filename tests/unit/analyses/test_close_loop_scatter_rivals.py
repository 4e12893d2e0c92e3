"""What a scatter of parts or operations could be mistaken for, and what not."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from loop_tables import candidate, crossed, offset, prepared_with, residuals

from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.scatter_rivals import apart_from
from mtu_cli.close_loop_sealed.analyses.loop.state import Step

P, H = 12, 10
SCATTERS = ("rotation-scatter", "scale-scatter")


@cache
def ready() -> Prepared:
    """Effects of x on the places of a table: of the column alone, of the part, of both."""
    table = residuals(crossed(np.random.default_rng(1), (P, H, 2), part=0.5, column=0.2))
    x, y = (table.places[:1, :, i] - table.places[:1, :, i].mean() for i in (0, 1))
    lines = np.column_stack([np.ones(H), x[0], y[0]])
    wave = np.cos(np.arange(H) ** 2)
    waves = (wave - lines @ np.linalg.lstsq(lines, wave, rcond=None)[0])[None]
    drift = np.linspace(-1.0, 1.0, P)[:, None]
    return prepared_with(
        table,
        candidate("scale", ({0: x},)),
        candidate("curvature", ({0: x**2 - np.mean(x**2)},)),
        candidate("trend", ({0: drift},)),
        candidate("growth", ({0: drift * x},)),
        # From a corner of the parts, as temperatures make it: with a shift of the whole part.
        candidate("growth-from-corner", ({0: drift * (x - 2 * x.min())},)),
        candidate("turn", ({0: -drift * y, 1: drift * x},)),
        candidate("growth-or-trend", ({0: drift},), ({0: drift * x},)),
        candidate("entries", ({0: drift * waves},)),
        offset("x"),
        *(candidate(name, kind="scatter") for name in SCATTERS),
    )


def rivals(name: str) -> set[str]:
    prepared = ready()
    names = prepared.scan.names
    step = Step(
        index=names.index(name), member=-1, p=0.01, log_bayes=1.0, posterior=0.1,
        credible=tuple(range(len(names))),
    )  # fmt: skip
    apart = {names[i] for i in apart_from(prepared, step)}
    assert name not in apart
    return set(names) - apart - {name}


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("scale-scatter", {"growth", "growth-from-corner", "growth-or-trend"}),
        ("rotation-scatter", {"turn"}),
    ],
)
def test_only_what_differs_from_part_to_part_as_the_scatter_does_is_a_rival(
    name: str, known: set[str]
) -> None:
    assert rivals(name) == known


def test_a_mean_error_keeps_its_class() -> None:
    prepared = ready()
    index = prepared.scan.names.index("offset-x")
    credible = tuple(range(len(prepared.scan.names)))
    step = Step(index=index, member=-1, p=0.01, log_bayes=1.0, posterior=0.1, credible=credible)
    assert apart_from(prepared, step) == ()
