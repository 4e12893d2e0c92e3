"""Whether parts turn, or grow, by the same along two axes: beside what the model knows of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from close_loop_examples import effect
from crossed_tables import Floats
from effect_tables import grid_places
from effect_tables import table as points_table
from separation_examples import LIBRARY
from warm_day import found, step

from mtu_cli.close_loop_sealed.analyses.loop.found_scatter import ScatterSize
from mtu_cli.close_loop_sealed.analyses.loop.one_table import verdict_of
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.scatter_size import scatter_size
from mtu_cli.close_loop_sealed.analyses.loop.shown import verdict_on
from mtu_cli.close_loop_sealed.model.effect_library import candidates

PARTS, FEATURES, TABLES = 15, 16, 40
NOISE, TURN, SIZE = 1.5e-3, 2.5e-5, 1e-4
"""mm; rad; mm/mm or rad."""
NAMES = ("rotation-scatter", "scale-scatter", "scale-x")


def oblique() -> Floats:
    """Places (H, 3) about an oblique line: a growth of them has something of a turn in it."""
    places = grid_places(FEATURES, jitter=2.0)
    places[:, 1] += 1.5 * (places[:, 0] - places[:, 0].mean())
    return places


@cache
def ready(known: str = "") -> Prepared:
    """A table whose model knows that parts grow, or that their x axes lean, by `SIZE`."""
    table = points_table(PARTS, FEATURES, places=oblique())
    if known:
        table = replace(table, of_part=SIZE * shape(known, table.places)[:1, ..., np.newaxis])
    table = replace(table, errors=drawn(0, table.places))
    return prepare(table, [c for c in candidates(table, LIBRARY) if c.name in NAMES])


def shape(name: str, places: Floats) -> Floats:
    """Errors (P, H, 2) of parts that grow, turn or lean by 1."""
    x, y = (places[..., i] - places[..., i].mean() for i in (0, 1))
    shapes = {"growth": (x, y), "turn": (-y, x), "lean": (y, 0 * y), "turn of Y": (0 * x, x)}
    return np.stack(shapes[name], axis=-1)


def drawn(seed: int, places: Floats, **sizes: float) -> Floats:
    """Errors (P, H, 2) of parts that have shapes of some sizes."""
    rng = np.random.default_rng([3, seed])
    errors: Floats = NOISE * rng.normal(size=(PARTS, FEATURES, 2))
    for name, size in sizes.items():
        errors += size * rng.normal(size=(PARTS, 1, 1)) * shape(name.replace("_", " "), places)
    return errors


def told(own: Prepared, errors: Floats, name: str) -> ScatterSize:
    moved = own.with_table(replace(own.table, errors=errors))
    size = scatter_size(moved, (), step(moved, name))
    assert size is not None
    return size


def ps(own: Prepared, **sizes: float) -> Floats:
    p = [
        told(own, drawn(seed, own.table.places, **sizes), "rotation-scatter").p_alike
        for seed in range(TABLES)
    ]
    assert None not in p
    return np.array(p, float)


@pytest.mark.parametrize("known", ["", "growth"])
def test_growths_beside_turns_are_none_of_one_axis(known: str) -> None:
    """Whether the model knows of them or not: p is uniform, its mean to four standard errors."""
    p = ps(ready(known), turn=TURN, growth=SIZE)
    assert np.mean(p) == pytest.approx(0.5, abs=4 / np.sqrt(12 * TABLES))


def test_what_the_model_knows_of_one_axis_is_counted() -> None:
    """No more axes are told apart than by chance, to four standard errors of its share."""
    sizes = {"turn": 8 * TURN, "lean": SIZE}
    limit = 0.05 + 4 * np.sqrt(0.05 * 0.95 / TABLES)
    assert np.mean(ps(ready("lean"), **sizes) < 0.05) < limit
    assert np.mean(ps(ready(), **sizes) < 0.05) > 0.95


def test_a_known_growth_hides_no_turn_of_one_axis() -> None:
    own = ready("growth")
    assert (ps(own, turn=TURN, growth=SIZE, turn_of_Y=2 * TURN) < 1e-3).all()


@pytest.mark.parametrize("size", [0.0, SIZE])
def test_sizes_of_each_axis_have_a_u(size: float) -> None:
    """u is how far they scatter about it; of an axis that has none, by how much at most."""
    own = ready()
    sizes = [
        told(own, drawn(seed, own.table.places, lean=SIZE, turn_of_Y=size), "rotation-scatter")
        for seed in range(3 * TABLES)
    ]
    s = np.array([[value for _, value in one.by_axis] for one in sizes])
    u = np.array([one.u_by_axis for one in sizes])
    # The spread of 120 values is known to 6.5 %; of normal ones four of it are 26 %.
    assert np.mean(u[:, 0]) == pytest.approx(np.std(s[:, 0]), rel=0.26)
    error = 4 * SIZE / np.sqrt(2 * PARTS * 3 * TABLES)
    assert np.sqrt(np.mean(s[:, 0] ** 2)) == pytest.approx(SIZE, abs=error)
    if size:
        assert np.mean(u[:, 1]) == pytest.approx(np.std(s[:, 1]), rel=0.26)
    else:
        assert np.mean(s[:, 1] <= 2 * u[:, 1]) > 0.9
        assert (u[:, 1] > 0).all()


def test_what_one_axis_has_alone_is_no_name() -> None:
    own = ready()
    search = found(own, step(own, "rotation-scatter"))
    turned = effect("rotation-scatter", parameters=(), equations={}, kind="scatter")
    for sizes, verdict in (({"turn": SIZE}, "named"), ({"turn_of_Y": SIZE}, "unexplained")):
        size = told(own, drawn(1, own.table.places, **sizes), "rotation-scatter")
        one = replace(turned, scatter=size)
        assert verdict_of(search, [one], ()) == verdict
        assert verdict_of(search, [effect(), one], ()) == verdict
        assert verdict_on(one, (), without_name=False) == verdict
        assert verdict_on(effect(), (), without_name=False) == "named"
